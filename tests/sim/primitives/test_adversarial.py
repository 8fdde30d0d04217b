"""What looks like success to a careless judge, done by a real hand in a real simulation."""

from __future__ import annotations

from collections.abc import Iterable

import mujoco
import numpy as np
import pytest

from dextera_build.sim.primitives.grasp import estimate
from dextera_build.sim.primitives.lift.primitive import SLIP_M_S
from dextera_build.sim.primitives.success import holds
from dextera_build.sim.runtime.environment import Environment, Outcome
from tests import task_bundles

OPEN, SHUT = 0.05, 0.012
"""Finger targets [m]; `SHUT` squeezes the box, whose half width is 20 mm."""
ABOVE = np.array([*task_bundles.BOX_M, 0.0])
"""Slides at which the fingers stand beside the box."""


def at(height_m: float) -> np.ndarray:
    """Slides at which the fingers are this far above where they take the box."""
    return ABOVE + np.array([0.0, 0.0, height_m])


def act(environment: Environment, place: Iterable[float], fingers: float, seconds: float) -> list[Outcome]:
    """Send the same target for some time, or until the episode is over."""
    target = np.array([*place, fingers, fingers])
    found = []
    for _ in range(round(seconds / environment.period_s)):
        found.append(environment.step(target))
        if found[-1].over:
            break
    return found


def grip(environment: Environment) -> None:
    """Take the box as it stands on the table."""
    act(environment, (*ABOVE[:2], 0.1), OPEN, 0.9)
    act(environment, ABOVE, OPEN, 0.4)
    act(environment, ABOVE, SHUT, 0.3)


def press(environment: Environment, torque: float) -> None:
    """Turn the lid with a torque [N m] from now on."""
    environment.data.qfrc_applied[environment.model.joint("case_lid_hinge").dofadr[0]] = torque


def box_height(environment: Environment) -> float:
    return float(environment.data.body("box").xpos[2]) - task_bundles.HALF_M


def test_an_honest_lift_counts():
    environment = Environment(task_bundles.lift())
    grip(environment)
    assert environment.state().grasp().fingers == 2
    assert environment.state().grasp().opposing
    assert environment.state().grasp().supported
    outcomes = act(environment, at(0.15), SHUT, 2.0)
    assert outcomes[-1].success
    assert outcomes[-1].reason == ""
    assert not environment.state().grasp().supported


def test_a_throw_does_not_count():
    environment = Environment(task_bundles.lift(height_m=0.05))
    environment.data.joint("box").qvel[:3] = 0, 0, 3.0
    outcomes = act(environment, (0, 0, 0.3), OPEN, 4.0)
    assert not any(outcome.success for outcome in outcomes)
    assert outcomes[-1].reason == "not done within 4 s: the object is too low"


def test_a_box_thrown_up_between_the_fingers_does_not_count_though_they_touch_it():
    environment = Environment(task_bundles.lift(height_m=0.05))
    grip(environment)
    act(environment, at(0.08), SHUT, 0.4)
    assert holds(environment.task, environment.judge.start, environment.state())
    environment.data.joint("box").qvel[2] = 1.0
    mujoco.mj_forward(environment.model, environment.data)
    assert environment.state().grasp().fingers == 2
    assert not holds(environment.task, environment.judge.start, environment.state())


def test_a_box_that_is_let_go_starts_the_clock_anew():
    environment = Environment(task_bundles.lift())
    grip(environment)
    raised = at(0.15)
    while box_height(environment) < 0.1:
        environment.step(np.array([*raised, SHUT, SHUT]))
    outcomes = act(environment, raised, SHUT, 0.3)
    outcomes += act(environment, raised, OPEN, 1.0)
    assert not any(outcome.success for outcome in outcomes)
    assert box_height(environment) < 0.01


def test_pinning_the_box_to_the_table_does_not_count():
    environment = Environment(task_bundles.lift(height_m=0.005))
    act(environment, (ABOVE[0], ABOVE[1] - 0.025, 0.1), 0.02, 0.9)
    outcomes = act(environment, (ABOVE[0], ABOVE[1] - 0.025, -0.1), 0.02, 1.5)
    assert environment.state().grasp().supported
    assert not any(outcome.success for outcome in outcomes)


def test_pushing_the_box_up_a_wall_does_not_count():
    pose = task_bundles.WORLD_FROM_BASE
    centre = pose[:3, :3] @ [task_bundles.BOX_M[0], task_bundles.BOX_M[1] + 0.031, 0.2] + pose[:3, 3]
    wall = (
        f'<geom type="box" size="0.1 0.01 0.2" pos="{centre[0]} {centre[1]} 0.2" euler="0 0 0.7"'
        ' friction="0.1" priority="1"/>'
    )
    environment = Environment(task_bundles.lift(extra=wall, height_m=0.03))
    beside = np.array([task_bundles.BOX_M[0], task_bundles.BOX_M[1] - 0.09, 0.0])

    def push(y: float, z: float, seconds: float) -> list[Outcome]:
        target = np.array([beside[0], beside[1] + y, z, 0.06, 0.06])
        return [environment.step(target) for _ in range(round(seconds / 0.05))]

    push(-0.05, 0.0, 0.7)
    # The left finger presses the box against the wall, and carries it up by friction.
    push(0.02, 0.0, 0.4)
    outcomes = push(0.02, 0.15, 1.2)
    assert box_height(environment) > 0.03
    state = environment.state().grasp()
    assert state.fingers == 1
    assert state.supported
    assert not any(outcome.success for outcome in outcomes)


def test_a_box_that_lies_on_two_fingers_is_not_grasped():
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><option cone="elliptic"/><worldbody>
        <body><freejoint/><geom type="box" size=".05 .05 .02" mass=".2"/></body>
        <geom type="box" size=".01 .05 .01" pos="-.03 0 -.029"/>
        <geom type="box" size=".01 .05 .01" pos=".03 0 -.029"/>
        </worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 200)
    found = estimate(model, data, 1, np.array([0, 1, -1]), -1)
    assert found.fingers == 2
    assert not found.opposing
    assert not found.supported


def test_a_lid_that_is_pushed_down_gently_counts():
    environment = Environment(task_bundles.close())
    press(environment, -0.09)
    outcomes = act(environment, (0, 0, 0), OPEN, 3.0)
    assert outcomes[-1].success
    assert outcomes[-1].reason == ""


def test_a_lid_that_is_slammed_through_its_command_does_not_count():
    environment = Environment(task_bundles.close(goal=0.8, hold_s=0.1))
    press(environment, -0.09)
    near = []
    while not environment.step(environment.previous_action).over:
        near.append(abs(environment.state().joints["case_lid_hinge"] - 0.8) < environment.task.goal.tolerance)
    assert any(near)
    assert not environment.judge.update(environment.state())
    assert environment.steps == round(environment.task.timeout_s / environment.period_s)


def test_a_lid_that_is_forced_beyond_its_limit_does_not_count():
    environment = Environment(task_bundles.close())
    done = False
    for _ in range(30):
        environment.data.joint("case_lid_hinge").qpos[0] = -0.08
        environment.data.joint("case_lid_hinge").qvel[0] = 0.0
        press(environment, -50.0)
        done |= environment.step(environment.previous_action).success
    assert not done


def test_a_case_that_is_carried_away_does_not_count():
    environment = Environment(task_bundles.close())
    body = environment.model.joint("case").qposadr[0]
    done = False
    for _ in range(30):
        environment.data.qpos[body + 2] = 0.3
        environment.data.joint("case").qvel[:] = 0.0
        environment.data.joint("case_lid_hinge").qpos[0] = 0.0
        done |= environment.step(environment.previous_action).success
    assert not done


def test_success_at_the_reset_does_not_count():
    bundle = task_bundles.close(goal=1.5)
    environment = Environment(bundle)
    environment.reset(0)
    assert environment.judge.held_at_reset
    outcomes = act(environment, (0, 0, 0), OPEN, 4.0)
    assert not any(outcome.success for outcome in outcomes)
    assert outcomes[-1].over
    assert outcomes[-1].reason == "the condition held at the start already"


@pytest.mark.parametrize("seed", range(3))
def test_flailing_never_counts(seed):
    """Random targets at full speed: hitting things about is not a task done."""
    environment = Environment(task_bundles.lift())
    environment.reset(seed)
    random = np.random.default_rng(seed)
    for _ in range(60):
        outcome = environment.step(random.uniform(environment.lower, environment.upper))
        assert not outcome.success


def test_slip_is_that_of_one_rigid_body_with_the_palm():
    environment = Environment(task_bundles.lift())
    grip(environment)
    act(environment, at(0.15), SHUT, 0.3)
    # Carried along and moving fast, yet at rest in the hand.
    assert np.abs(environment.data.joint("box").qvel[:3]).max() > 0.1
    assert environment.state().grasp().slip_m_s < SLIP_M_S
