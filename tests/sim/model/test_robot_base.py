"""The base of a model's robot is moved as a rigid whole, and back to the bit."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from dextera_build.errors import RuleError
from dextera_build.geometry import lie, transforms
from dextera_build.sim.model.robot_base import RobotBase
from tests import factories

KNOWN = factories.pose(0.3, -0.2, 0.1, yaw=0.7)
XML = """
<mujoco>
  <worldbody>
    <body name="thing"><geom size="0.1"/></body>
    <frame pos="0.3 -0.2 0.1" euler="0 0 0.7">
      <body name="robot/base" pos="0.05 0.02 0.4" euler="0.3 0 0">
        <geom size="0.1"/>
        <body name="robot/link" pos="0.2 0 0"><joint/><geom size="0.1"/></body>
      </body>
    </frame>
  </worldbody>
</mujoco>
""".replace("<mujoco>", '<mujoco><compiler angle="radian"/>')


def poses(model: mujoco.MjModel) -> list[np.ndarray]:
    """T_world_body (4, 4) of thing, base and link."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    bodies = [data.body(name) for name in ("thing", "robot/base", "robot/link")]
    return [transforms.rigid(body.xmat.reshape(3, 3).copy(), body.xpos.copy()) for body in bodies]


def test_the_robot_moves_with_its_base_and_nothing_else():
    model = mujoco.MjModel.from_xml_string(XML)
    own = model.body_pos.copy(), model.body_quat.copy()
    base, before = RobotBase(KNOWN, model), poses(model)
    for error in ((0.01, -0.02, 0.03, 0.1, 0.2, -0.3), (0.0, 0.0, 0.0, 0.0, 0.0, 0.01)):
        base.put(model, error)
        assert np.allclose(base.pose(error), lie.retract(KNOWN, error))
        shift = base.pose(error) @ transforms.invert(KNOWN)
        thing, *robot = poses(model)
        assert np.array_equal(thing, before[0])
        assert np.allclose(robot, [shift @ each for each in before[1:]])
    base.put(model, (0.0,) * 6)
    assert np.array_equal(model.body_pos, own[0])
    assert np.array_equal(model.body_quat, own[1])
    assert base.pose((0.0,) * 6) is KNOWN


def test_a_model_without_a_robot_names_the_stub_that_made_it():
    model = mujoco.MjModel.from_xml_string("<mujoco><worldbody><body name='cup'/></worldbody></mujoco>")
    with pytest.raises(RuleError, match="has no robot") as caught:
        RobotBase(KNOWN, model)
    assert "--backend simulate.task=mujoco" in (caught.value.hint or "")
