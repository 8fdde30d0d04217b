"""Scene descriptions: what must fit together, where things stand, and the picture."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pytest
from PIL import Image as Pillow

from dextera_build.artifacts.scenes.scene_description import (
    BodyNode,
    Box,
    Geom,
    Inertia,
    JointNode,
    ObjectNode,
    SceneDescription,
)
from dextera_build.artifacts.shapes.mesh import Hull
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.errors import ArtifactError
from tests import factories

MESH = factories.box_mesh((-0.1, -0.1, 0), (0.1, 0.1, 0.2))
INERTIA = Inertia(mass_kg=0.5, centre=(0.0, 0.0, 0.1), moments=(0.1, 0.1, 0.1, 0.0, 0.0, 0.0))


def placed(matrix: np.ndarray | None = None, parent: str = "body", child: str = "geom") -> Pose:
    return Pose(parent=parent, child=child, matrix=np.eye(4) if matrix is None else matrix)


def geom(label: str = "box", **more: Any) -> Geom:
    return Geom(**{"label": label, "role": "visual", "shape": MESH, "pose": placed(), **more})


def body(label: str = "box", *geoms: Geom) -> BodyNode:
    return BodyNode(label=label, inertia=INERTIA, geoms=geoms)


def joint(**more: Any) -> JointNode:
    fields = {
        "name": "hinge",
        "type": "revolute",
        "parent": "base",
        "child": "lid",
        "origin": (0.0, 0.1, 0.2),
        "axis": (1.0, 0.0, 0.0),
        "lower": 0.0,
        "upper": 2.0,
        "position": np.pi / 2,
        "friction": 0.1,
        "damping": 0.01,
    }
    return JointNode(**fields | more)


def thing(label: str = "box", *joints: JointNode, parts: tuple[str, ...] = ("base",), **more: Any) -> ObjectNode:
    links = {part: body(label if part == "base" else f"{label}_{part}") for part in parts}
    fields = {"pose": placed(factories.pose(1.0, 0.0, 0.0), "world", "object"), "links": links, "joints": joints}
    return ObjectNode(**fields | more)


def scene(*things: ObjectNode, **more: Any) -> SceneDescription:
    return SceneDescription(**{"objects": things, "static": (), "cameras": (), **more})


def test_parts_stand_where_their_joints_put_them():
    """The lid's frame is at the hinge; at a right angle about x its y axis points up."""
    made = thing("laptop", joint(), parts=("base", "lid"))
    assert (made.root, made.label) == ("base", "laptop")
    lid = made.world_poses()["lid"]
    assert lid[:3, 3] == pytest.approx([1.0, 0.1, 0.2])
    assert lid[:3, 1] == pytest.approx([0, 0, 1])
    assert made.world_poses()["base"] == pytest.approx(made.pose.matrix)


def test_geoms_are_placed_in_their_body():
    turned = factories.pose(0.5, 0.0, 0.0, yaw=np.pi / 2)
    block = geom(role="collision", shape=Box(half_size=(0.1, 0.2, 0.3)), pose=placed(turned))
    corners = block.vertices()
    assert corners.min(axis=0) == pytest.approx([0.3, -0.1, -0.3])
    assert corners.max(axis=0) == pytest.approx([0.7, 0.1, 0.3])
    hull = geom(role="collision", shape=Hull(vertices=MESH.vertices.copy()), pose=placed(turned))
    assert hull.vertices() == pytest.approx(MESH.vertices @ turned[:3, :3].T + [0.5, 0, 0], abs=1e-7)


@pytest.mark.parametrize(
    ("make", "code", "message"),
    [
        (lambda: geom(role="collision"), "DXB-A421", "geom `box` is for collision, but it is a Mesh"),
        (lambda: geom(shape=Box(half_size=(1.0, 1.0, 1.0))), "DXB-A421", "is for visual, but it is a Box"),
        (lambda: geom("2 boxes"), "DXB-A101", "Geom.label: String should match pattern"),
        (lambda: Box(half_size=(1.0, 0.0, 1.0)), "", "greater than 0"),
        (lambda: thing("a", joint()), "DXB-A422", "a joint names the part `lid`, which the object does not have"),
        (lambda: thing("a", parts=("base", "lid")), "DXB-A422", "are not one tree: 2 parts, 0 joints"),
        (lambda: thing("a", parts=()), "DXB-A422", "are not one tree: 0 parts"),
        (
            lambda: thing("a", joint(), joint(parent="lid", child="base"), parts=("base", "lid", "arm")),
            "DXB-A422",
            "the joints are not a tree over the links",
        ),
        (
            lambda: thing("a", joint(position=3.0), parts=("base", "lid")),
            "DXB-A423",
            "joint `hinge` is at 3, outside 0 to 2",
        ),
        (lambda: scene(thing("a"), thing("a")), "DXB-A424", "two bodies of a scene are called `a`"),
        (lambda: scene(static=(geom("a"), geom("a"))), "DXB-A424", "two geoms of a scene are called `a`"),
        (lambda: scene(thing("a"), exclude=(("a", "b"),)), "DXB-A424", "excludes contacts of `b`, which is no body"),
    ],
)
def test_what_does_not_fit_is_refused(make, code, message):
    with pytest.raises((ArtifactError, ValueError)) as caught:
        make()
    assert message in str(caught.value)
    assert getattr(caught.value, "code", "") == code


def test_joints_in_a_circle_are_refused():
    circle = (joint(parent="lid", child="arm"), joint(name="back", parent="arm", child="lid"))
    with pytest.raises(ArtifactError, match="not a tree"):
        thing("a", *circle, parts=("base", "lid", "arm"))


def test_its_line_and_its_picture():
    laptop = thing("laptop", joint(), parts=("base", "lid"))
    seen = laptop.links["base"].model_copy(update={"geoms": (geom("laptop"),)})
    made = scene(laptop.model_copy(update={"links": {**laptop.links, "base": seen}}), thing("box"))
    assert repr(made) == ("SceneDescription(2 objects (laptop, box), 1 joints, 1.5 kg, 0 collision geoms, 0 cameras)")
    assert made.bodies == ("laptop", "box")
    pixels = np.asarray(Pillow.open(io.BytesIO(made.picture())))
    assert (pixels != 255).any()
    assert (np.asarray(Pillow.open(io.BytesIO(scene().picture()))) == 255).all()
