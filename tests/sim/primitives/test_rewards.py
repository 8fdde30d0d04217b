"""Staged rewards cannot be earned without getting on with the task."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dextera_build.sim.observe.progress import Progress
from dextera_build.sim.primitives import stages
from dextera_build.sim.primitives.articulate import primitive as articulate
from dextera_build.sim.primitives.lift import primitive as lift
from dextera_build.sim.primitives.state import GraspState
from dextera_build.sim.runtime.environment import Environment
from tests import task_bundles
from tests.sim.primitives.traces import grasped

HELD = grasped(fingers=2, opposing=True, supported=False)
metres = st.floats(0.0, 2.0)
shares = st.floats(0.0, 1.0)


def lifting(reach_m: float = 0.0, grasp: GraspState = HELD, rise: float = 0.0, success: bool = False) -> float:
    return float(lift.value(lift.Progress(np.array([reach_m]), grasp, np.array([rise]), np.array([success])))[0])


def closing(reach_m: float, left: float, strayed: float = 0.0, success: bool = False) -> float:
    numbers = (np.array([each]) for each in (reach_m, left, strayed, success))
    return float(articulate.value(articulate.Progress(*numbers))[0])


@given(metres, metres)
def test_nearer_is_better_everywhere(one, other):
    low, high = sorted((one, other))
    assert lifting(low) >= lifting(high)
    assert closing(low, 1.0) >= closing(high, 1.0)


@given(st.floats(-1.0, 5.0), st.booleans(), st.integers(0, 1))
def test_an_object_that_flies_or_hangs_on_one_finger_earns_nothing_by_its_height(rise, opposing, fingers):
    loose = grasped(fingers=fingers, opposing=opposing and fingers > 1)
    assert lifting(grasp=loose, rise=rise) == lifting(grasp=loose, rise=0.0)


@given(shares, shares)
def test_later_stages_are_worth_more(rise, left):
    none = grasped()
    assert lifting(0.0, none) < lifting(0.0, HELD, rise) <= lifting(0.0, HELD, 1.0) < lifting(0.0, HELD, 1.0, True)
    assert closing(0.0, 1.0) <= closing(0.0, left) < closing(0.0, 0.0, success=True)


def test_dragging_the_object_along_costs():
    values = [closing(0.1, 0.5, strayed) for strayed in (0.0, 0.5, 1.0)]
    assert values[0] > values[1] > values[2]


def test_height_beyond_the_goal_is_worth_nothing_more():
    assert lifting(rise=1.0) == lifting(rise=3.0)


def test_there_and_back_earns_nothing():
    """The reward is a change of value, so a way that ends where it began sums to zero."""
    environment = Environment(task_bundles.close())
    progress = Progress(environment)
    values = []
    for target in (0.0, 0.3, -0.3, 0.0):
        for _ in range(25):
            environment.step(np.array([target, 0, 0.2, 0.05, 0.05]))
        values.append(progress.value(False))
    assert abs(values[1] - values[0]) > 0.3
    # The lid creeps a little meanwhile.
    assert values[3] == pytest.approx(values[0], abs=0.05)


def test_a_lid_is_reached_from_the_side_that_it_moves_away_from():
    """Before the lid stands the way leads around its edge; behind it the way is straight."""
    environment = Environment(task_bundles.close())
    progress = Progress(environment)
    data = environment.data
    hinge = data.joint("case_lid_hinge")
    away = data.body("case_lid").xmat.reshape(3, 3) @ [0.0, 0.0, 1.0]  # outer face of the lid
    middle = data.body("case_lid").xpos + data.body("case_lid").xmat.reshape(3, 3) @ [0.0, -0.095, 0.003]
    progress.value(False)
    link = progress._link("case_lid_hinge")
    sides = np.array([middle + 0.1 * away, middle - 0.1 * away])
    closing, opening = link.distances(data, -1.0, sides), link.distances(data, 1.0, sides)
    assert float(hinge.qpos[0]) == pytest.approx(1.5)
    assert closing[0] < 0.08 < 0.15 < closing[1]
    assert opening[1] < 0.08 < 0.15 < opening[0]


def test_moving_the_lid_to_its_command_is_what_pays():
    environment = Environment(task_bundles.close())
    progress = Progress(environment)

    def left() -> float:
        start, now = environment.judge.start, environment.state()
        return float(environment.primitive.progress(np.zeros(1), start, now, np.zeros(1, bool)).left[0])

    best = progress.value(False)
    assert left() == pytest.approx(1.0)
    environment.data.joint("case_lid_hinge").qpos[0] = 0.75
    assert left() == pytest.approx(0.5)
    assert progress.value(False) > best
    environment.data.joint("case_lid_hinge").qpos[0] = 1.8
    assert left() == pytest.approx(1.2)
    assert progress.value(False) < best


def test_clamping_keeps_what_is_not_a_number():
    assert stages.clamp(np.array([-2.0, 0.25, 2.0]), 0.0, 1.0).tolist() == [0.0, 0.25, 1.0]
    assert np.isnan(stages.clamp(np.array([np.nan]), 0.0, 1.0))
