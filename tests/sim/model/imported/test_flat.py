"""MJCF and URDF of others: nothing outside of the input is read, and few lines do not become billions of parts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.cameras.image import png
from dextera_build.errors import RuleError
from dextera_build.sim.model.imported import flat, mjcf, urdf
from dextera_build.sim.model.imported.source import WHOLE
from tests.rules.simulate.robot_files import ARM

GEOM = '<m><geom name="included" size=".1" mass="2"/></m>'
HAND = '<mujoco><worldbody><body name="h"><geom size=".1" mass="2"/></body></worldbody></mujoco>'
PICTURE = png(np.zeros((4, 4, 3), np.uint8))


def robot(tip: str = "", asset: str = "", head: str = "", base: str = "") -> str:
    """A robot of two links, with more in one of them, its assets and its head."""
    return (
        f'<mujoco>{head}<asset>{asset}</asset><worldbody><body name="base"><geom size=".1" mass="1" {base}/>'
        f'<body name="tip"><joint name="j" range="-1 1"/><geom size=".1" mass="1"/>{tip}</body></body>'
        "</worldbody></mujoco>"
    )


def read(text: str, **more: str | bytes) -> mjcf.Source:
    """The robot `in/r.xml` among further files, `__` for the slash and `_` before the suffix for the dot."""
    files = {"in/r.xml": text.encode()}
    for name, data in more.items():
        stem, _, suffix = name.replace("__", "/").rpartition("_")
        files[f"{stem}.{suffix}"] = data if isinstance(data, bytes) else data.encode()
    return mjcf.read("in/r.xml", files)


def refused(text: str, **more: str | bytes) -> RuleError:
    with pytest.raises(RuleError) as caught:
        read(text, **more)
    return caught.value


def test_includes_and_attached_models_of_the_input_are_read():
    beside = read(robot('<include file="i.xml"/>'), in__i_xml=GEOM)
    above = read(
        robot('<include file="../other/i.xml"/>'), other__i_xml='<m><include file="j.xml"/></m>', other__j_xml=GEOM
    )
    attached = read(
        robot('<frame><attach model="h" body="h" prefix="p_"/></frame>', '<model name="h" file="../s/h.xml"/>'),
        s__h_xml=HAND.replace("<geom", '<include file="i.xml"/><geom'),
        s__i_xml=GEOM,
    )
    for found in (beside, above):
        assert [geom.name for geom in found.spec.geoms][-1] == "included"
    assert attached.spec.body("p_h") is not None
    assert len(attached.spec.body("p_h").geoms) == 2


def test_several_roots_in_frames_are_put_into_one_link():
    body = '<frame pos="0 0 {0}"><body name="b{0}"><joint name="j{0}" range="-1 1"/><geom size=".1"/></body></frame>'
    text = f"<mujoco><worldbody>{body.format(1)}{body.format(2)}</worldbody></mujoco>"
    spec = mjcf.read("in/r.xml", {"in/r.xml": text.encode()}, whole=True).spec
    assert [each.name for each in spec.worldbody.bodies] == [WHOLE]
    assert spec.body("b2").parent.name == WHOLE
    assert spec.compile().body("b2").pos[2] == 2


@pytest.mark.filterwarnings("error")
def test_a_model_attached_without_a_prefix_keeps_its_classes():
    attach = ('<frame><attach model="h" body="h" prefix=""/></frame>', '<model name="h" file="../s/h.xml"/>')
    own = '<default><default class="soft"><geom friction="2"/></default></default>'
    hand = HAND.replace("<geom", '<geom class="soft"').replace("<worldbody", f"{own}<worldbody", 1)
    found = read(robot(*attach), s__h_xml=hand)
    assert found.spec.body("h").geoms[0].friction[0] == 2
    plain = HAND.replace("<worldbody", '<default><geom friction="2"/></default><worldbody', 1)
    assert "attached without a prefix" in refused(robot(*attach), s__h_xml=plain).message


@pytest.mark.parametrize("name", ["../../i.xml", "{}/i.xml", "file://{}/i.xml", "i.xml"])
@pytest.mark.parametrize("arc", ["include", "model", "nested", "in a model"])
def test_files_outside_of_the_input_are_missing(tmp_path, monkeypatch, arc, name):
    (tmp_path / "i.xml").write_text(GEOM if arc in ("include", "nested") else HAND)
    monkeypatch.chdir(tmp_path)
    name = name.format(tmp_path)
    attach = '<frame><attach model="h" body="h" prefix="p_"/></frame>'
    text = {
        "include": robot(f'<include file="{name}"/>'),
        "model": robot(attach, f'<model name="h" file="{name}"/>'),
        "nested": robot('<include file="near.xml"/>'),
        "in a model": robot(attach, '<model name="h" file="near.xml"/>'),
    }[arc]
    inner = {
        "nested": f'<m><include file="{name}"/></m>',
        "in a model": HAND.replace("<geom", f'<include file="{name}"/><geom'),
    }
    error = refused(text, **({"in__near_xml": inner[arc]} if arc in inner else {}))
    assert error.message == f"`{name}`, which `in/{'near' if arc in inner else 'r'}.xml` names, is missing in the input"
    assert error.hint


@pytest.mark.parametrize(
    ("asset", "head"),
    [
        ('<mesh name="m" file="{}"/>', ""),
        ('<texture name="t" type="2d" file="{}"/>', ""),
        ('<texture name="t" type="cube" fileright="{}"/>', ""),
        ('<hfield name="h" size="1 1 1 1" file="{}"/>', ""),
        ("", '<compiler meshdir="/"/><asset><mesh name="m" file="{}"/></asset>'),
        ("", '<worldbody><body><flexcomp name="f" type="mesh" dim="2" file="{}"/></body></worldbody>'),
    ],
)
def test_no_other_file_is_taken_from_outside(tmp_path, asset, head):
    (tmp_path / "a.png").write_bytes(PICTURE)
    for name in (tmp_path / "a.png", Path("../../a.png")):
        error = refused(robot(asset=asset.format(name), head=head.format(name)))
        assert "is missing" in error.message or "made of a file" in error.message


def test_a_skin_is_never_opened():
    found = read(robot(head='<deformable><skin name="s" file="/dev/zero"/></deformable>'))
    assert found.dropped == ["1 skins"]


def test_textures_of_a_cube_come_along():
    sides = " ".join(f'file{side}="a.png"' for side in ("right", "left", "up", "down", "front", "back"))
    asset = f'<texture name="t" type="cube" {sides}/><material name="m" texture="t"/>'
    found = read(robot(asset=asset, base='material="m"'), in__a_png=PICTURE)
    assert len(found.spec.assets) == 6


def nested(count: int, levels: int) -> str:
    return f'<replicate count="{count}" offset="0 0 1">' * levels + '<geom size=".1"/>' + "</replicate>" * levels


@pytest.mark.parametrize(
    ("text", "things"),
    [
        (robot(nested(1000, 1) + nested(1000, 3)), "elements"),
        (robot('<replicate count="1001" offset="0 0 1"><body><geom size=".1"/></body></replicate>'), "bodies"),
        (robot('<composite type="cable" count="2000 1 1" size="1"><geom size=".1"/></composite>'), "bodies"),
        (robot('<flexcomp name="f" type="grid" count="100 100 100" spacing=".1 .1 .1"/>'), "bodies"),
        (robot(asset='<hfield name="h" nrow="50000" ncol="50000" size="1 1 1 1"/>'), "cells of a height field"),
        (robot(asset='<texture name="t" builtin="checker" width="10" height="100000000"/>'), "texels of a texture"),
        (robot(asset='<texture name="t" type="cube" builtin="flat" width="1e5"/>'), "texels of a texture"),
        (robot(asset='<mesh name="m" builtin="supersphere" params="10000 1 1"/>'), "parts of a built-in mesh"),
    ],
)
def test_few_lines_do_not_become_billions_of_parts(text, things):
    error = refused(text)
    assert error.message == f"`r.xml` holds too many {things}"
    assert error.code == "DXB-A407"


def test_replicas_of_a_robot_are_made():
    assert len(read(robot(nested(3, 2))).spec.geoms) == 11


def test_attached_models_multiply():
    attach = "".join(f'<frame><attach model="m" prefix="p{number}_"/></frame>' for number in range(10))
    level = (
        '<mujoco><asset><model name="m" file="{}.xml"/></asset><worldbody><body name="b">{}</body></worldbody></mujoco>'
    )
    files = {f"in__m{depth}_xml": level.format(f"m{depth - 1}", attach) for depth in range(1, 9)}
    error = refused(robot(attach, '<model name="m" file="m8.xml"/>'), in__m0_xml=HAND, **files)
    assert error.message == "`r.xml` holds too many bodies"


@pytest.mark.parametrize(
    "section",
    [
        '<size memory="100T" nuserdata="1000000000"/>',
        '<custom><numeric name="n" size="2000000000"/></custom>',
        '<sensor><user dim="2000000000"/></sensor>',
    ],
)
def test_sections_that_reserve_memory_are_left_out(section):
    assert read(robot(head=section)).spec.body("tip") is not None


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (robot("<frame>" * 400 + "</frame>" * 400), "elements of `in/r.xml` are nested more than 200 deep"),
        (robot('<include file="i.xml"/><body><include file="i.xml"/></body>'), "`in/i.xml` is included twice"),
        (robot(asset='<model name="h" file="r.xml"/>'), "`in/r.xml` attaches itself in the end"),
        ('<!DOCTYPE mujoco [<!ENTITY a "b">]>' + robot(), "`in/r.xml` does not load"),
    ],
)
def test_what_has_no_end_is_refused(text, message):
    assert refused(text, in__i_xml=GEOM).message == message


def test_a_picture_that_would_fill_the_memory_is_refused():
    large = PICTURE[:16] + (100_000).to_bytes(4, "big") * 2 + PICTURE[24:]
    asset = '<texture name="t" type="2d" file="a.png"/>'
    assert refused(robot(asset=asset), in__a_png=large).message == "`a.png` holds too many texels"


def test_a_urdf_has_a_bounded_number_of_links_and_no_entities():
    many = "".join(f'<link name="more_{number}"/>' for number in range(flat.MOST_BODIES))
    for text, message in (
        (ARM.replace("</robot>", many + "</robot>"), "`arm.urdf` holds too many links"),
        (
            ARM.replace("<robot ", '<!DOCTYPE robot [<!ENTITY a SYSTEM "/etc/hostname">]><robot '),
            "`arm.urdf` is not valid XML",
        ),
    ):
        with pytest.raises(RuleError) as caught:
            urdf.read("arm.urdf", {"arm.urdf": text.encode()})
        assert caught.value.message == message
