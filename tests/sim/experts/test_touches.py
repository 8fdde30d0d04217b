"""Filters of contacts find planted faults: between two control periods, of arms, of what adds up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from dextera_build.artifacts.tasks.episode import Episode
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.sim.control.operator import Command, Part, State
from dextera_build.sim.experts.drive import Driver
from dextera_build.sim.experts.filters import Filters
from dextera_build.sim.runtime.environment import Environment
from tests import gantry, task_bundles
from tests.gantry import LIFT, OPEN, SHUT, Move

BOX = task_bundles.BOX_M
PRESS = Filters(lag_m=1.0, press_n=2.0)
"""Contact forces alone."""
FAST = (Move((0.0, 0.0, 0.0), OPEN, 0.6, "approach"), *LIFT[2:])
"""Straight and fast to the box."""


def thing(
    monkeypatch: pytest.MonkeyPatch,
    name: str,
    place: tuple[float, float],
    half: tuple[float, float, float],
    mass: float = 0.02,
) -> str:
    """MJCF of a free box on the table at a place in the robot's base [m], and its pose in the keyframe."""
    at = task_bundles.WORLD_FROM_BASE @ [*place, half[2], 1.0]
    where = " ".join(f"{number:.9g}" for number in at[:3])
    scene = task_bundles.SCENE.replace("1.5  {home}", f"1.5  {where} 1 0 0 0  {{home}}")
    monkeypatch.setattr(task_bundles, "SCENE", scene)
    size = " ".join(map(str, half))
    return f'<body name="{name}" pos="{where}"><freejoint/><geom type="box" size="{size}" mass="{mass}"/></body>'


def vase(monkeypatch: pytest.MonkeyPatch, part: float) -> TaskBundle:
    """Lift the box, with a light vase on the way of a finger, after this part of it."""
    place = (BOX[0] * part, BOX[1] * part + 0.055)
    return task_bundles.lift(extra=thing(monkeypatch, "vase", place, (0.012, 0.012, 0.05)))


def run(bundle: TaskBundle, moves: Sequence[Move] = LIFT, limits: Filters = PRESS) -> Episode:
    driver = Driver(Environment(bundle))
    operator = gantry.Moves(driver.environment, moves)
    return driver.run(operator, driver.environment.start, origin="operator", filters=limits)


@pytest.mark.medium
@pytest.mark.parametrize("part", [0.51, 0.63])
def test_an_impact_between_two_control_periods_is_found(monkeypatch: pytest.MonkeyPatch, part: float) -> None:
    """A finger knocks the vase over in a few substeps, and touches it at the end of no control period."""
    bundle = vase(monkeypatch, part)
    assert run(bundle, FAST).reason == "touched `vase` in `approach`"
    step = Environment.step
    monkeypatch.setattr(Environment, "step", lambda environment, action, look=None: step(environment, action))
    assert run(bundle, FAST).success


def test_looking_changes_no_bit_of_the_motion() -> None:
    plain, watched = (Environment(task_bundles.lift()) for _ in range(2))
    seen: list[float] = []
    for action in np.random.default_rng(0).uniform(plain.lower, plain.upper, (8, len(plain.lower))):
        plain.step(action)
        watched.step(action, lambda: seen.append(float(watched.data.time)))
    assert len(seen) == 8 * watched.substeps
    assert np.array_equal(plain.data.qpos, watched.data.qpos)
    assert np.array_equal(plain.data.qvel, watched.data.qvel)


def built(monkeypatch: pytest.MonkeyPatch, palm: str, base: str = "", **links: str) -> TaskBundle:
    """Lift the box with a robot that has more parts at its palm and its base, in these groups."""
    more = task_bundles.ROBOT.replace('<body name="{p}finger_left">', f'{palm}<body name="{{p}}finger_left">')
    more = more.replace('<body name="{p}rail_x">', f'{base}<body name="{{p}}rail_x">')
    monkeypatch.setattr(task_bundles, "ROBOT", more)
    bundle = task_bundles.lift()
    robot = bundle.robot.model_copy(update={"links": {**bundle.robot.links, **links}})
    return bundle.model_copy(update={"robot": robot})


FOOT = '<body name="{p}foot"><geom type="box" size="0.03 0.02 0.01" pos="0.2 0 -0.104" mass="0.02"/></body>'
"""A flat part that ends below the fingertips, away from the box."""


def test_forces_of_two_bodies_add_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """The foot presses with four corners, each with less force than the limit."""
    bundle = built(monkeypatch, FOOT, foot="arm")
    driver = Driver(Environment(bundle))
    down = [*LIFT[:2], Move((0.0, 0.0, -0.006), OPEN, 1.0, "press")]
    start, operator = driver.environment.start, gantry.Moves(driver.environment, down)
    found = driver.run(operator, start, origin="operator", filters=PRESS)
    assert found.reason == "touched `support` in `press`"
    data, force, each = driver.environment.data, np.zeros(6), []
    for number in range(data.ncon):
        mujoco.mj_contactForce(driver.environment.model, data, number, force)
        each.append(float(np.linalg.norm(force[:3])))
    assert max(each) < PRESS.press_n


SPIKE = '<body name="{p}spike"><geom type="box" size="0.005 0.005 0.04" pos="0 0 -0.045" mass="0.02"/></body>'
"""A part that presses on the top of the box, where the fingers are at its sides."""
TOUCHING = [replace(move, contact=True) for move in LIFT]
"""The lift, with contact intended from its begin."""


@pytest.mark.parametrize(("group", "reason"), [("hand", ""), ("arm", "touched `box` with an arm in `reach`")])
def test_hands_may_touch_the_object_and_arms_may_not(monkeypatch: pytest.MonkeyPatch, group: str, reason: str) -> None:
    assert run(built(monkeypatch, SPIKE, spike=group), TOUCHING).reason == reason


POST = '<body name="{p}post"><geom type="box" size="0.01 0.01 0.2" pos="0.3 0.27 0.4"/></body>'
"""A part of the base beside the way up of the elbow."""
ELBOW = '<body name="{p}elbow"><geom type="box" size="0.01 0.07 0.01" pos="0 0.075 0.1" mass="0.02"/></body>'
"""A part beside the palm."""


def test_arms_may_not_press_each_other_while_a_hand_holds_something(monkeypatch: pytest.MonkeyPatch) -> None:
    bundle = built(monkeypatch, ELBOW, POST, elbow="arm", post="arm")
    aside = (*LIFT[:3], Move((0.0, 0.04, 0.06), SHUT, 0.8, "carry", "box", True))
    assert run(bundle, aside).reason == "touched `robot/elbow` in `carry`"


class Idle(gantry.Moves):
    """Moves of which a part belongs to another limb: this one's hand should touch nothing."""

    def command(self, state: State) -> Command | None:
        """The next step."""
        made = super().command(state)
        return made and replace(made, parts={"arm": Part(made.segment, made.frame, False)})


def test_the_intention_of_one_limb_excuses_no_other() -> None:
    driver = Driver(Environment(task_bundles.lift()))
    operator, start = Idle(driver.environment, TOUCHING), driver.environment.start
    assert driver.run(operator, start, origin="operator", filters=PRESS).reason == "touched `box` in `grasp`"
