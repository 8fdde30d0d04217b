"""COLLADA: few lines with instances of instances do not become billions of triangles, and each fault is one error."""

from __future__ import annotations

import pytest

from dextera_build.errors import RuleError
from dextera_build.formats import bounds
from dextera_build.sim.model.imported import collada
from tests.rules.simulate.robot_files import PRISM

PLACE = '<instance_geometry url="#g"/>'


def tenfold(depth: int) -> bytes:
    """Ten instances of a node with ten instances, and so on."""
    levels = (
        f'<node id="n{level}">' + f'<instance_node url="#n{level - 1}"/>' * 10 + "</node>"
        for level in range(1, depth + 1)
    )
    library = f'<library_nodes><node id="n0">{PLACE}</node>{"".join(levels)}</library_nodes>'
    scene = PRISM.replace(PLACE, f'<instance_node url="#n{depth}"/>')
    return scene.replace("<library_visual_scenes>", library + "<library_visual_scenes>").encode()


def test_instances_of_instances_are_read():
    once = collada.as_obj("a.dae", PRISM.encode())
    assert collada.as_obj("a.dae", tenfold(2)).count(b"\nf ") == 100 * once.count(b"\nf ")


@pytest.mark.parametrize(
    ("depth", "limit", "things", "found"),
    [(12, "MOST_PARTS", "nodes", "at least 501"), (3, "MOST_TRIANGLES", "triangles", "at least 504")],
)
def test_a_small_file_that_stands_for_billions_of_triangles_is_refused(monkeypatch, depth, limit, things, found):
    monkeypatch.setattr(bounds, limit, 500)
    with pytest.raises(RuleError, match=f"`a.dae` holds too many {things}") as caught:
        collada.as_obj("a.dae", tenfold(depth))
    assert caught.value.facts == {"found": found, "most": "500"}


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        (PLACE, '<instance_node url="#s"/>', "refer to one another in a circle"),
        ("<node>", "<node>" * 3000, "not well-formed|mismatched tag"),
        (PLACE, "<node>" * 3000 + PLACE + "</node>" * 3000, "nested too deeply"),
        ('semantic="VERTEX"', 'semantic="TANGENT"', "a <triangles> has no input VERTEX"),
        ('semantic="POSITION"', 'semantic="TANGENT"', "a <vertices> has no input POSITION"),
        ("0 0 2 0 1 0", f"0 0 {10**30} 0 1 0", "too large"),
        ("<COLLADA", '<!DOCTYPE x [<!ENTITY a "b">]><COLLADA', "it has a DOCTYPE"),
    ],
)
def test_each_fault_is_one_error(old, new, why):
    with pytest.raises(RuleError, match=r"`a\.dae` cannot be read as COLLADA") as caught:
        collada.as_obj("a.dae", PRISM.replace(old, new).encode())
    assert any(each in caught.value.facts["why"] for each in why.split("|"))
