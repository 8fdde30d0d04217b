"""The judge sees by measurements alone what it sees by the simulator's contacts."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.policy.observation import Measurement
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.runtime.measured_state import MeasuredState
from tests import task_bundles

OVER, AROUND, CLOSED, UP = (
    np.array([0.3, 0.1, 0.1, 0.05, 0.05]),
    np.array([0.3, 0.1, 0.0, 0.05, 0.05]),
    np.array([0.3, 0.1, 0.0, 0.01, 0.01]),
    np.array([0.3, 0.1, 0.16, 0.01, 0.01]),
)
"""Slides of the gantry: x, y, z, left, right [m]."""
RAISED_OPEN = np.array([0.3, 0.1, 0.16, 0.05, 0.05])
SHOVED = np.array([0.45, 0.1, 0.0, 0.01, 0.01])


@pytest.fixture(scope="module")
def environment() -> Environment:
    return Environment(task_bundles.lift())


@pytest.fixture(scope="module")
def mirror() -> MeasuredState:
    return MeasuredState(task_bundles.lift())


def verdicts(
    environment: Environment,
    mirror: MeasuredState,
    *places: np.ndarray,
    noise_m: float = 0.0,
) -> tuple[bool, bool]:
    """Whether the box was lifted, by the simulator, and by the mirror, which gets it as far off as noise moves it."""
    random = np.random.default_rng(0)

    def measured() -> Measurement:
        seen = environment.measure()
        seen.objects[:, :3] += random.normal(0, noise_m, seen.objects[:, :3].shape)
        return seen

    environment.begin(environment.start)
    mirror.begin(measured())
    true = seen = False
    for place in places:
        for target in np.linspace(environment.previous_action, place, 20):
            true |= environment.step(target).success
            seen |= mirror.judge(measured(), environment.steps * environment.period_s)
    return true, seen


@pytest.mark.parametrize("noise_m", [0.0, 0.001, 0.002])
def test_a_box_that_is_lifted_is_seen_to_be(environment, mirror, noise_m):
    assert verdicts(environment, mirror, OVER, AROUND, CLOSED, UP, UP, UP, noise_m=noise_m) == (True, True)


@pytest.mark.parametrize("places", [(CLOSED, CLOSED), (RAISED_OPEN, RAISED_OPEN), (CLOSED, SHOVED, SHOVED)])
def test_a_box_that_is_only_grasped_left_or_shoved_is_not_lifted(environment, mirror, places):
    assert verdicts(environment, mirror, OVER, AROUND, *places, noise_m=0.001) == (False, False)


def test_a_box_in_the_air_without_a_hand_is_not_lifted(environment, mirror):
    environment.begin(environment.start)
    mirror.begin(environment.measure())
    for number in range(1, 40):
        seen = environment.measure()
        seen.objects[0, 2] += 0.15
        assert not mirror.judge(seen, 0.05 * number)
