"""Palms from encoder readings are where the simulator has them, wherever the base stands."""

from __future__ import annotations

import mujoco
import numpy as np

from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.runtime.palms import Palms
from tests import episodes


def test_palms_of_several_readings_are_those_of_the_simulator() -> None:
    environment = Environment(episodes.bundle())
    palms = Palms(environment.bundle.robot, environment.model)
    error = (0.02, -0.01, 0.03, 0.05, -0.02, 0.1)
    environment.begin(environment.start.model_copy(update={"base_error": error}))
    readings, wanted = [], []
    for turn in (0.0, 0.4, -0.7):
        environment.data.joint("robot/joint_1").qpos[0] = turn
        mujoco.mj_forward(environment.model, environment.data)
        readings.append(environment.measure().joints)
        wanted.append(environment.palm_poses())
    assert np.ptp(wanted, axis=0).max() > 0.1
    assert np.allclose(palms(np.array(readings)), wanted, atol=1e-9)
