"""Forward kinematics against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.objects.object import Body, Joint, Link
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.errors import ArtifactError
from dextera_build.geometry import kinematics, transforms
from tests import factories


def link(*points: tuple[float, float, float]) -> Link:
    vertices = np.array(points, np.float32)
    return Link(mesh=Mesh(vertices=vertices, faces=np.array([[0, 1, 2]], np.int32)))


def joint(name: str, parent: str, child: str, **fields: object) -> Joint:
    values = {"type": "revolute", "origin": (0.0, 0.0, 0.0), "axis": (0.0, 0.0, 1.0), "position": 0.0} | fields
    return Joint(name=name, parent=parent, child=child, lower=-9.0, upper=9.0, **values)


@pytest.fixture
def arm() -> Body:
    """Two links of one metre in the plane: at joints 0 stretched along x."""
    return Body(
        links={
            "base": link((0, 0, 0), (0, 0.1, 0), (0.1, 0, 0)),
            "upper": link((0, 0, 0), (1, 0, 0), (0, 0.1, 0)),
            "lower": link((1, 0, 0), (2, 0, 0), (1, 0.1, 0)),
        },
        joints=(
            joint("elbow", "upper", "lower", origin=(1.0, 0.0, 0.0), position=-0.4),
            joint("shoulder", "base", "upper"),
        ),
        pose=factories.placed(np.eye(4)),
    )


def test_two_links_reach_where_trigonometry_says(arm: Body) -> None:
    a, b = 0.3, 0.5
    poses = kinematics.link_poses(arm, {"shoulder": a, "elbow": b})
    tip = transforms.apply(poses["lower"], np.array([2.0, 0.0, 0.0]))
    np.testing.assert_allclose(tip, [np.cos(a) + np.cos(a + b), np.sin(a) + np.sin(a + b), 0.0], atol=1e-12)
    np.testing.assert_array_equal(poses["base"], np.eye(4))


def test_joints_left_out_stand_as_photographed(arm: Body) -> None:
    stated = kinematics.link_poses(arm, {"elbow": -0.4, "shoulder": 0.0})
    np.testing.assert_array_equal(kinematics.link_poses(arm)["lower"], stated["lower"])
    vertices, faces = kinematics.posed_surface(arm)
    assert faces.max() == len(vertices) - 1
    np.testing.assert_allclose(vertices[4], [1 + np.cos(0.4), -np.sin(0.4), 0.0], atol=1e-6)


def test_a_prismatic_joint_slides_along_its_unit_axis() -> None:
    slide = joint("slide", "base", "drawer", type="prismatic", axis=(0.0, 3.0, 0.0))
    np.testing.assert_allclose(kinematics.joint_motion(slide, 0.2), transforms.rigid(np.eye(3), np.array([0, 0.2, 0])))


def test_unknown_joints_and_cycles_are_named(arm: Body) -> None:
    with pytest.raises(ArtifactError, match="`knee` is not a joint of this body"):
        kinematics.link_poses(arm, {"knee": 0.0})
    ring = arm.model_copy(update={"joints": (joint("a", "upper", "lower"), joint("b", "lower", "upper"))})
    with pytest.raises(ArtifactError, match="not a tree over the links") as error:
        kinematics.link_poses(ring)
    assert error.value.facts["not reached"] == "a, b"
