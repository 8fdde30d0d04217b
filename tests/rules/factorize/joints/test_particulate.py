"""Articulation by Particulate: the real program, with a stand-in for infer.py that has its command line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.objects.object import Body
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.errors import RuleError
from dextera_build.geometry import kinematics, solids
from dextera_build.testing import RuleRunner
from rules.factorize.joints import urdf_links
from tests import object_views
from tests.rules.factorize.joints import particulate
from tests.rules.factorize.shapes import generators

BOXES = [
    ((0.5, 0.3, 0.09), (0.05, 0.0, 0.045)),  # base
    ((0.2, 0.3, 0.09), (0.05, 0.0, 0.15)),  # door
    ((0.4, 0.2, 0.09), (0.05, 0.0, 0.25)),  # drawer
    ((0.1, 0.1, 0.08), (0.05, 0.0, 0.36)),  # knob
]


def cabinet() -> Mesh:
    """Four boxes one above the other, with a texture."""
    made = [solids.box(size, centre) for size, centre in BOXES]
    starts = np.cumsum([0, *(len(each.vertices) for each in made)])
    vertices = np.concatenate([each.vertices for each in made]).astype(np.float32)
    faces = np.concatenate([each.faces + start for each, start in zip(made, starts, strict=False)]).astype(np.int32)
    uv = np.ascontiguousarray(vertices[faces][..., :2] + 0.5, np.float32)
    pixels = np.zeros((16, 16, 3), np.uint8)
    pixels[:, 8:] = (200, 40, 40)
    return Mesh(vertices=vertices, faces=faces, uv=uv, texture=Image(pixels=pixels))


def articulated(tmp_path: Path, **options: Any) -> tuple[Body, RuleRunner]:
    generators.environment(tmp_path, "particulate", particulate.MODULES)
    weights = {}
    for name, file in (("particulate", "model.pt"), ("partfield", "model_objaverse.ckpt")):
        weights[name] = tmp_path / "weights" / name
        weights[name].mkdir(parents=True)
        (weights[name] / file).write_text(file)
    (tmp_path / "scratch").mkdir()
    runner = RuleRunner(tmp_path / "scratch", project=tmp_path, weights=weights, gpu_gb=80.0)
    seen = object_views.whole(object_views.view(cabinet(), np.eye(4), body_type="articulated"))
    shape = object_views.shape(cabinet())
    body = runner.run("factorize.articulate", backend="particulate", options=options, shape=shape, **seen)
    return body, runner


@pytest.mark.slow
def test_links_and_joints_are_in_metres_in_the_frame_of_the_shape(tmp_path: Path) -> None:
    body, runner = articulated(tmp_path)
    assert runner.outcome.line == "1 hinge, 1 slide"
    assert list(body.links) == ["base", "link_1", "link_2"]
    assert all(link.mesh.is_closed and link.mesh.texture is not None for link in body.links.values())
    door, drawer = body.joints
    assert (door.type, door.parent, door.child) == ("revolute", "base", "link_1")
    assert (drawer.type, drawer.parent, drawer.child) == ("prismatic", "base", "link_2")
    assert door.origin == pytest.approx((-0.05, -0.15, 0.105), abs=1e-5)
    assert door.axis == (0.0, 0.0, 1.0)
    assert (door.lower, door.upper, door.position) == (0.0, 1.4, 0.0)
    assert drawer.axis == (0.0, -1.0, 0.0)
    assert (drawer.lower, drawer.upper) == pytest.approx((0.0, 0.25 * 0.5))


@pytest.mark.slow
def test_the_body_stands_as_the_shape_and_its_parts_move(tmp_path: Path) -> None:
    body, _ = articulated(tmp_path)
    whole, _ = kinematics.posed_surface(body)
    assert np.allclose([whole.min(axis=0), whole.max(axis=0)], [(-0.2, -0.15, 0.0), (0.3, 0.15, 0.4)], atol=1e-5)
    places = body.links["link_2"].mesh.vertices
    assert np.allclose([places.min(axis=0), places.max(axis=0)], [(-0.15, -0.1, 0.205), (0.25, 0.1, 0.4)], atol=1e-5)
    pulled = kinematics.link_poses(body, {"joint_0_2": 0.1})["link_2"]
    assert pulled[:3, 3] == pytest.approx((0.0, -0.1, 0.0))


@pytest.mark.slow
def test_nothing_measured_is_used(tmp_path: Path) -> None:
    assert articulated(tmp_path)[0].asset_source == "rgb"


@pytest.mark.slow
def test_one_part_alone_has_no_joint(tmp_path: Path) -> None:
    with pytest.raises(RuleError, match="no joint was found"):
        articulated(tmp_path, particulate={"least_confidence": 0.5})


@pytest.mark.slow
def test_an_error_that_infer_goes_on_after_is_told(tmp_path: Path) -> None:
    with pytest.raises(RuleError) as caught:
        articulated(tmp_path, particulate={"least_confidence": 1.0})
    assert caught.value.code == "DXB-B370"


def test_a_declared_hinge_is_refused(tmp_path: Path) -> None:
    hinge = {"origin_m": (0.0, 0.0, 0.0), "axis": (0.0, 0.0, 1.0), "angle_rad": 1.0}
    with pytest.raises(RuleError, match="takes no declared `hinge`"):
        articulated(tmp_path, hinge=hinge)


LINKS = '<link name="a"/><link name="b"/>'
ENDS = '<parent link="a"/><child link="b"/>'


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("<robot", "it is no XML"),
        ("<robot/>", "it has no links"),
        (f'<robot>{LINKS}<joint name="j" type="ball">{ENDS}</joint></robot>', "joint `j` is of type ball"),
        (f'<robot>{LINKS}<joint name="j" type="revolute">{ENDS}</joint></robot>', "has no mesh"),
        ('<robot><link name="a"/><joint name="j" type="fixed"><child link="b"/></joint></robot>', "cannot be reached"),
        (f'<robot>{LINKS}<joint name="j">{ENDS}</joint></robot>', "<joint> has no `type`"),
    ],
)
def test_a_malformed_urdf_is_told(tmp_path: Path, text: str, told: str) -> None:
    path = tmp_path / "model.urdf"
    path.write_text(text)
    with pytest.raises(ValueError, match=told):
        urdf_links.read(path)


def test_a_link_is_turned_by_its_joint_and_its_visual(tmp_path: Path) -> None:
    object_views.mesh(solids.box((0.2, 0.1, 0.1), (0.1, 0.0, 0.0))).save(tmp_path / "box.obj")
    visual = '<visual><origin xyz="{}" rpy="{}"/><geometry><mesh filename="box.obj"/></geometry></visual>'
    (tmp_path / "model.urdf").write_text(
        f'<robot><link name="a">{visual.format("0 0 0", "0 0 0")}</link>'
        f'<link name="b">{visual.format("0 0 0.5", "0 0 1.5707963")}</link>'
        f'<joint name="j" type="revolute">{ENDS}<origin xyz="1 0 0" rpy="1.5707963 0 0"/>'
        '<axis xyz="0 1 0"/><limit lower="-1" upper="-0.5"/></joint></robot>'
    )
    links, (joint,) = urdf_links.read(tmp_path / "model.urdf")
    # The visual turns x to y, the joint turns y to z, and z to -y.
    places = links["b"].mesh.vertices
    assert np.allclose([places.min(axis=0), places.max(axis=0)], [(0.95, -0.55, 0.0), (1.05, -0.45, 0.2)], atol=1e-5)
    assert joint.axis == pytest.approx((0.0, 0.0, 1.0), abs=1e-6)
    assert (joint.lower, joint.upper) == (-1.0, 0.0)
