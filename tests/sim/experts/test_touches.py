"""Filters of contacts find planted faults: between two control periods, of arms, of what is held, of bystanders."""

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
from dextera_build.sim.observe.touch import Touch
from dextera_build.sim.primitives.pick_and_place.primitive import PlaceGoal
from dextera_build.sim.runtime.environment import Environment
from tests import gantry, task_bundles
from tests.gantry import LIFT, OPEN, SHUT, Move
from tests.sim.experts.test_filters import placing

BOX, HALF = task_bundles.BOX_M, task_bundles.HALF_M
PRESS = Filters(lag_m=1.0, press_n=2.0, displaced_m=np.inf)
"""Contact forces alone."""
MOVED = replace(PRESS, press_n=np.inf, displaced_m=0.005)
"""Displacements alone."""
FAST = (Move((0.0, 0.0, 0.0), OPEN, 0.6, "approach"), *LIFT[2:])
"""Straight and fast to the box."""
CARRIED = (
    *LIFT[:3],
    Move((0.0, 0.0, 0.06), SHUT, 0.6, "lift", "box", True),
    Move((0.12, 0.0, 0.06), SHUT, 0.8, "carry", "box", True),
    Move((0.12, 0.0, 0.13), SHUT, 0.6, "lift", "box", True),
)
"""Lifts the box, carries it 120 mm to the side, and lifts it higher."""


def thing(
    monkeypatch: pytest.MonkeyPatch,
    name: str,
    place: tuple[float, float],
    half: tuple[float, float, float],
    mass: float = 0.02,
    above: float = 0.0,
) -> str:
    """MJCF of a free box on or above the table at a place in the robot's base [m], and its pose in the keyframe."""
    at = task_bundles.WORLD_FROM_BASE @ [*place, half[2] + above, 1.0]
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
    # Its displacement shows without any force.
    assert run(bundle, FAST, MOVED).reason.startswith("`vase` was knocked or moved in `")
    step = Environment.step
    monkeypatch.setattr(Environment, "step", lambda environment, action, look=None: step(environment, action))
    assert run(bundle, FAST).success


@pytest.mark.medium
def test_what_settles_beside_the_task_was_not_knocked(monkeypatch: pytest.MonkeyPatch) -> None:
    """Measured poses may be some millimetres above the table, or in it."""
    vase = thing(monkeypatch, "vase", (BOX[0] + 0.3, BOX[1]), (0.012, 0.012, 0.05), above=0.008)
    assert run(task_bundles.lift(extra=vase), LIFT, MOVED).success


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


@pytest.mark.medium
@pytest.mark.parametrize("mass", [0.1, 1.0])
def test_what_the_held_object_hits_is_found(monkeypatch: pytest.MonkeyPatch, mass: float) -> None:
    extra = thing(monkeypatch, "vase", (BOX[0] + 0.1, BOX[1]), (0.012, 0.012, 0.06), mass)
    bundle = task_bundles.lift(extra=extra)
    bundle = bundle.model_copy(update={"task": bundle.task.model_copy(update={"timeout_s": 8.0})})
    assert run(bundle, CARRIED).reason == "`box` hit `vase` in `carry`"
    assert run(bundle, CARRIED, MOVED).reason == "`vase` was knocked or moved in `carry`"


@pytest.mark.medium
def test_a_wall_that_the_held_object_hits_is_found_and_its_table_is_not() -> None:
    bundle = task_bundles.lift()
    bundle = bundle.model_copy(update={"task": bundle.task.model_copy(update={"timeout_s": 8.0})})
    lowered = (*CARRIED[:-1], Move((0.12, 0.0, 0.0), SHUT, 0.8, "lower", "box", True), *CARRIED[-1:])
    passed = run(bundle, lowered)
    assert passed.success, passed.reason
    at = task_bundles.WORLD_FROM_BASE @ [BOX[0] + 0.1, BOX[1], 0.06, 1.0]
    wall = f'<geom name="static_wall" type="box" size="0.012 0.012 0.06" pos="{at[0]} {at[1]} {at[2]}"/>'
    walled = task_bundles.lift(extra=wall)
    assert run(walled, CARRIED).reason == "`box` hit `wall` in `carry`"


@pytest.mark.parametrize(
    ("aside_m", "goal_m", "found"),
    [(0.0, None, ""), (0.06, 0.0, ""), (0.06, 0.3, "plate"), (0.06, None, "plate")],
    ids=["carries it", "shall carry it", "is far below the goal", "has no part in the lift"],
)
def test_what_carries_the_object_is_no_bystander(
    monkeypatch: pytest.MonkeyPatch, aside_m: float, goal_m: float | None, found: str
) -> None:
    extra = thing(monkeypatch, "plate", (BOX[0], BOX[1] + aside_m), (0.018, 0.018, 0.0005))
    bundle = task_bundles.lift(extra=extra)
    if goal_m is not None:
        goal = placing().task.goal
        assert isinstance(goal, PlaceGoal)
        place = (*goal.place_m[:2], goal.place_m[2] + goal_m)
        task = bundle.task.model_copy(update={"goal": goal.model_copy(update={"place_m": place})})
        bundle = bundle.model_copy(update={"task": task})
    environment = Environment(bundle)
    touch = Touch(environment)
    assert not touch.displaced(0.005)
    plate = environment.data.joint(environment.model.body("plate").jntadr[0])
    # Into the box, so that something movable has met it.
    way = environment.data.body("box").xpos[:2] - plate.qpos[:2]
    plate.qpos[:2] += way / 2 + (0.006, 0.0)
    mujoco.mj_forward(environment.model, environment.data)
    assert not touch.unintended(np.inf)
    assert touch.displaced(0.005) == found
