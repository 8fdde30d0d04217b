"""A scripted operator as a policy: it plans from what was measured, and sees what is measured later."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.geometry import poses
from dextera_build.policy.observation import DeployableObservation, Measurement, deployable
from dextera_build.policy.running import PolicyFault
from dextera_build.sim.control.operator import Aim, Command, NotHeld, OutOfReach, State
from dextera_build.sim.experts.deployed import Deployed
from dextera_build.sim.experts.drive import Driver
from dextera_build.sim.primitives.lift.primitive import LiftGoal
from dextera_build.sim.runtime import starts
from dextera_build.sim.runtime.environment import Environment
from tests import factories, openarm_tasks
from tests.robots import robot_recipes


class Watching:
    """Moves the left palm up by a centimetre in every step, twice, and notes what it sees."""

    def __init__(self, driver: Driver) -> None:
        self.begun: list[State] = []
        self.seen: list[State] = []
        self._driver = driver

    def begin(self, state: State) -> None:
        self.begun.append(state)
        if state.objects["box"][0, 3] > 10:
            raise OutOfReach("goal out of reach: far")
        self.seen = []

    def command(self, state: State) -> Command | None:
        self.seen.append(state)
        if len(self.seen) > 2:
            return None
        palm = poses.to_matrix(self._driver.environment.palm_poses()[0])
        palm[2, 3] += 0.01 * len(self.seen)
        limb = self._driver.environment.bundle.robot.limbs["left"]
        return Command({"left": Aim(palm, np.zeros(len(limb.hand)))}, "up")


@pytest.fixture(scope="module")
def lasting(tmp_path_factory: pytest.TempPathFactory) -> Driver:
    robot = robot_recipes.built("openarm_revo1", tmp_path_factory.mktemp("robot"))
    box = factories.box_asset(factories.pose(0.0, 0.16), size=(0.05, 0.05, 0.12), mass=0.15)
    return Driver(Environment(openarm_tasks.bundle(robot, LiftGoal(height_m=0.1), {"box": box}, "box")))


@pytest.fixture
def driver(lasting: Driver) -> Driver:
    environment = lasting.environment
    environment.begin(starts.photographed(environment.bundle, environment.model))
    return lasting


def observed(driver: Driver, shift_m: float = 0.0) -> DeployableObservation:
    """What is measured of the present state, with the box elsewhere along x."""
    environment = driver.environment
    seen = environment.measure()
    places = seen.objects.copy()
    places[0, 0] += shift_m
    return deployable(
        Measurement(seen.joints, places, seen.displacement), environment.previous_action, environment.goal
    )


@pytest.mark.medium
def test_it_plans_from_the_measured_place_and_later_sees_the_measured_one(driver: Driver) -> None:
    operator = Watching(driver)
    policy = Deployed(driver, operator)
    first = observed(driver, 0.03)
    there = observed(driver)["objects"][0, 0]
    policy.act(first)
    assert operator.begun[0].objects["box"][0, 3] == pytest.approx(there + 0.03, abs=1e-5)
    assert operator.begun[0].joints == pytest.approx(first["joints"], abs=1e-5)
    policy.act(observed(driver, -0.12))
    assert operator.seen[-1].objects["box"][0, 3] == pytest.approx(there + 0.03 - 0.12, abs=1e-5)
    assert len(operator.begun) == 1


def test_commands_become_joint_targets_and_the_last_ones_hold(driver: Driver) -> None:
    policy = Deployed(driver, Watching(driver))
    sent = driver.environment.previous_action
    one, two, three, four = (policy.act(observed(driver)) for _ in range(4))
    assert one.shape == sent.shape
    assert 0 < np.abs(one - sent).max() < 0.3
    assert not np.array_equal(one, two)
    assert np.abs(four - three).max() < 0.02


def test_an_episode_begins_anew_after_a_reset(driver: Driver) -> None:
    operator = Watching(driver)
    policy = Deployed(driver, operator)
    first = policy.act(observed(driver))
    policy.reset()
    assert np.allclose(policy.act(observed(driver)), first, atol=1e-6)
    assert len(operator.begun) == 2


def test_what_is_out_of_reach_is_a_fault_of_this_trial(driver: Driver) -> None:
    policy = Deployed(driver, Watching(driver))
    with pytest.raises(PolicyFault, match="goal out of reach: far") as caught:
        policy.act(observed(driver, 20.0))
    assert caught.value.code == "DXB-B255"


def test_an_operator_that_says_nothing_is_a_fault(driver: Driver) -> None:
    operator = Watching(driver)
    operator.command = lambda state: None
    with pytest.raises(PolicyFault, match="the operator did nothing") as caught:
        Deployed(driver, operator).act(observed(driver))
    assert caught.value.code == "DXB-B254"


def test_a_grasp_that_failed_is_a_fault_of_this_trial(driver: Driver) -> None:
    def lost(state: State) -> Command:
        raise NotHeld("the grasp failed: the object is 80 mm away")

    operator = Watching(driver)
    operator.command = lost
    with pytest.raises(PolicyFault, match="the object is 80 mm away") as caught:
        Deployed(driver, operator).act(observed(driver))
    assert caught.value.code == "DXB-B256"
