"""twin/two_states as a whole: a laptop that was opened further, and a box that was moved, become a twin that moves."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build import Project
from dextera_build.artifacts.objects.object import Body, Support
from dextera_build.geometry import transforms

from . import two_states

mujoco = pytest.importorskip("mujoco")

ALLOWED_M = 0.0005
"""Deepest overlap of two links anywhere in the range."""


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    folder = tmp_path_factory.mktemp("two_states")
    two_states.write(folder)
    (folder / "dxb.toml").write_text("")
    inputs = {"capture": str(folder / "before"), "moved": str(folder / "after")}
    result = Project.find(folder).build("twin/two_states", inputs=inputs, profile="cpu")
    assert result.ok, result.errors
    return result


@pytest.mark.slow
def test_the_hinge_is_within_2_degrees_and_3_mm_and_the_box_has_none(built):
    body: Body = built.artifact("body[black_laptop].joints")
    assert built.artifact("body[red_box].joints").joints == ()
    (joint,) = body.joints
    support: Support = built.artifact("support")
    # The twin's world begins in the middle of the seen table: both are compared in the camera's frame.
    camera_from_world = transforms.invert(support.camera_pose.matrix)
    mine = camera_from_world @ body.pose.matrix
    true = transforms.invert(two_states.EYE) @ two_states.LAPTOP
    truth = two_states.thing().joints[0]
    axis, place = true[:3, :3] @ truth.axis, transforms.apply(true, np.array(truth.origin))
    found, origin = mine[:3, :3] @ joint.axis, transforms.apply(mine, np.array(joint.origin))
    assert np.degrees(np.arccos(min(1.0, abs(float(axis @ found))))) < 2.0
    assert 1000.0 * np.linalg.norm(np.cross(origin - place, axis)) < 3.0
    first, second = two_states.OPENED
    assert joint.upper_range[0] == pytest.approx(second - first, abs=np.radians(1.0))
    # It closes as far as its base lets it, and what was seen is within the limits.
    assert joint.lower == pytest.approx(-first, abs=np.radians(8.0))


@pytest.mark.slow
def test_links_swept_between_their_limits_do_not_collide(built):
    model = mujoco.MjModel.from_xml_path(str(built.paths["scene"]))
    data = mujoco.MjData(model)
    (hinge,) = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    rest = data.qpos.copy()
    lid = int(model.jnt_bodyid[hinge])
    solid = np.flatnonzero(model.geom_contype | model.geom_conaffinity)
    mine, others = (solid[model.geom_bodyid[solid] == body] for body in (lid, int(model.body_parentid[lid])))
    assert len(mine)
    assert len(others)
    # Distances, not contacts: pairs that a model leaves out of its contacts count, too.
    least = []
    for position in np.linspace(*model.jnt_range[hinge], 40):
        data.qpos[:] = rest
        data.qpos[model.jnt_qposadr[hinge]] = position
        mujoco.mj_forward(model, data)
        least.append(min(mujoco.mj_geomDistance(model, data, a, b, 0.02, None) for a in mine for b in others))
    assert -min(least) < ALLOWED_M
    # Closed, the lid is at its base.
    assert least[0] < 0.01
