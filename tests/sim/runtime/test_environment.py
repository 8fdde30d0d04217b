"""The runtime: determinism, limits, frames, and what an observation may hold."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from dextera_build.artifacts.tasks.episode import Start
from dextera_build.artifacts.tasks.task import Reset
from dextera_build.geometry import lie, quaternions, transforms
from dextera_build.policy.layout import gathered
from dextera_build.policy.observation import DeployableObservation, deployable
from dextera_build.sim.runtime.environment import Environment, Outcome
from dextera_build.sim.runtime.recorder import Recorder
from tests import factories, task_bundles

WIDE = Reset(position_m=0.03, yaw_rad=0.5, clutter_m=0.01, robot_rad=0.01, joint_rad=0.1, dynamics=1.0)


def wander(environment: Environment, periods: int = 25, seed: int = 1) -> list[Outcome]:
    """Targets that stray from home, into things and past speed limits."""
    random = np.random.default_rng(seed)
    return [environment.step(random.uniform(environment.lower, environment.upper)) for _ in range(periods)]


def state(environment: Environment) -> np.ndarray:
    return np.concatenate([environment.data.qpos, environment.data.qvel, environment.data.act])


def test_a_recorded_start_and_what_was_executed_give_the_same_bits():
    environment = Environment(task_bundles.lift(reset=WIDE))
    environment.reset(5)
    start, path, sent = environment.start, [], []
    for outcome in wander(environment):
        sent.append(outcome.executed)
        path.append(environment.steps)
    end = state(environment)
    again = Environment(task_bundles.lift(reset=WIDE))
    again.begin(Start.model_validate(start.model_dump()))
    for target in sent:
        executed = again.step(target).executed
        assert executed.tobytes() == target.tobytes()
    assert state(again).tobytes() == end.tobytes()


def test_a_reset_leaves_nothing_of_the_episode_before():
    fresh, used = (Environment(task_bundles.lift(reset=WIDE)) for _ in range(2))
    used.reset(1)
    wander(used)
    used.data.qfrc_applied[:] = 3.0
    used.data.xfrc_applied[:] = 2.0
    one, other = fresh.reset(7), used.reset(7)
    for name, value in one.values.items():
        assert np.array_equal(value, other[name]), name
    assert used.steps == 0
    wander(fresh, seed=2)
    wander(used, seed=2)
    assert state(fresh).tobytes() == state(used).tobytes()
    assert fresh.model.body_mass.tobytes() == used.model.body_mass.tobytes()


def is_awake(environment: Environment) -> bool:
    """Whether the task's object is simulated now."""
    body = environment.model.body(environment.task.object).id
    return bool(environment.data.tree_awake[environment.model.body_treeid[body]])


def rest(environment: Environment, periods: int) -> None:
    for _ in range(periods):
        environment.step(environment.previous_action)


def test_what_rests_sleeps_until_somebody_moves_it():
    environment = Environment(task_bundles.lift())
    box = environment.data.joint(environment.task.object)
    stood = box.qpos.copy()
    assert is_awake(environment)
    rest(environment, 10)
    assert not is_awake(environment)
    assert np.allclose(box.qpos, stood, atol=5e-4)
    box.qpos[2] += 0.3
    rest(environment, 2)
    assert is_awake(environment), "what was put somewhere else falls"
    rest(environment, 40)
    assert not is_awake(environment)
    assert np.allclose(box.qpos[2], stood[2], atol=5e-3)
    box.qvel[2] = 2.0
    rest(environment, 1)
    assert is_awake(environment)
    assert box.qpos[2] > 0.05


def test_sleep_changes_nothing_that_a_hand_does():
    ways = []
    for sleeps in (True, False):
        environment = Environment(task_bundles.lift())
        if not sleeps:
            environment.model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
        rest(environment, 10)
        assert is_awake(environment) is not sleeps
        for along in (0.0, 0.4):  # fingers together beside the box, then along through it
            for _ in range(20):
                environment.step(np.array([along, 0.1, 0.0, 0.0, 0.0]))
                ways.append(environment.object_poses()[0])
    asleep, awake = np.array(ways).reshape(2, -1, 7)
    assert np.ptp(awake[:, 0]) > 0.05, "the box was pushed"
    assert np.allclose(asleep[:, :3], awake[:, :3], atol=2e-3)


def test_the_judge_of_an_episode_knows_only_its_own_start():
    environment = Environment(task_bundles.close(goal=1.5))
    assert environment.judge.held_at_reset
    start = environment.start
    away = start.qpos.copy()
    away[14] = 0.2
    environment.begin(start.model_copy(update={"qpos": away}))
    assert not environment.judge.held_at_reset
    environment.begin(start)
    assert environment.judge.held_at_reset


def test_limits_and_speed_limits_hold():
    environment = Environment(task_bundles.lift())
    reach = np.array([joint.velocity for joint in environment.bundle.robot.joints]) * environment.period_s
    before = environment.previous_action
    for sign in (1.0, -1.0):
        for _ in range(60):
            executed = environment.step(np.full(5, sign * 100.0)).executed
            assert (np.abs(executed - before) <= reach + 1e-12).all()
            assert (executed >= environment.lower).all()
            assert (executed <= environment.upper).all()
            before = executed
        assert np.array_equal(executed, environment.upper if sign > 0 else environment.lower)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_an_action_that_is_not_finite_ends_the_episode_and_reaches_no_robot(bad):
    environment = Environment(task_bundles.lift())
    before = state(environment)
    action = np.zeros(5)
    action[3] = bad
    outcome = environment.step(action)
    assert (outcome.success, outcome.over) == (False, True)
    assert outcome.reason == "the action for `left` is not a finite number"
    assert np.isfinite(outcome.executed).all()
    assert state(environment).tobytes() == before.tobytes()


def test_an_action_of_another_length_ends_the_episode():
    outcome = Environment(task_bundles.lift()).step(np.zeros(23))
    assert outcome.over
    assert outcome.reason == "the action has shape (23,), but the robot has 5 joints"


def test_a_simulation_that_diverges_ends_with_that_reason():
    environment = Environment(task_bundles.lift())
    environment.data.joint("box").qvel[:] = 1e9
    outcome = environment.step(environment.previous_action)
    assert (outcome.success, outcome.over, outcome.reason) == (False, True, "the simulation diverged")


def test_time_is_counted_in_control_periods():
    environment = Environment(task_bundles.lift())
    outcomes = []
    while not outcomes or not outcomes[-1].over:
        outcomes.append(environment.step(environment.previous_action))
    assert len(outcomes) == round(environment.task.timeout_s * environment.task.control_hz)
    assert outcomes[-1].reason == "not done within 4 s: the object is too low"
    assert environment.data.time == pytest.approx(environment.task.timeout_s, abs=1e-6)


def test_observations_do_not_depend_on_where_the_world_frame_is():
    places = [factories.pose(-0.1, 0.2, 0.0, yaw=0.7), factories.pose(0.1, 0.3, 0.0, yaw=-2.0)]
    seen = []
    for place in places:
        environment = Environment(task_bundles.lift(world_from_base=place))
        assert np.abs(environment.data.body("box").xpos[:2]).max() > 0.05
        wander(environment, 8)
        seen.append((environment.observe(), environment.palm_poses(), environment.contact_forces()))
    for name in ("joints", "objects", "displacement", "previous_action", "goal"):
        one, other = (pair[0][name] for pair in seen)
        assert np.allclose(one, other, atol=2e-3), name
    assert np.allclose(seen[0][1], seen[1][1], atol=2e-3)


def test_objects_stand_in_the_base_frame_with_one_sign_of_their_quaternion():
    environment = Environment(task_bundles.lift())
    for yaw in np.linspace(-np.pi, np.pi, 13):
        pose = factories.pose(0.2, 0.4, 0.02, yaw=yaw)
        quaternion = quaternions.from_matrix(pose[:3, :3])
        for sign in (1.0, -1.0):
            joint = environment.data.joint("box")
            joint.qpos[:3], joint.qpos[3:] = pose[:3, 3], sign * quaternion
            mujoco.mj_forward(environment.model, environment.data)
            found = environment.object_poses()[0]
            wanted = transforms.invert(environment.bundle.base_pose.matrix) @ pose
            assert found[3] >= 0
            assert np.allclose(found[:3], wanted[:3, 3])
            assert np.allclose(quaternions.to_matrix(found[3:]), wanted[:3, :3], atol=1e-9)


def test_a_deployable_observation_has_no_room_for_what_only_a_simulator_knows():
    environment = Environment(task_bundles.lift())
    shown = environment.observe().values
    assert shown.keys() == {"previous_action", "joints", "objects", "displacement", "goal"}
    with pytest.raises(TypeError, match="policies may not see"):
        DeployableObservation({**shown, "contact": environment.contact_forces()})
    with pytest.raises(AttributeError):
        deployable(environment.data, environment.previous_action, environment.goal)  # type: ignore[arg-type]


def test_an_observation_does_not_change_with_velocities_forces_or_dynamics():
    environment = Environment(task_bundles.lift())
    before = environment.observe()
    environment.data.qvel[:] = np.nan
    environment.data.cfrc_ext[:] = np.nan
    environment.model.body_mass[:] = np.nan
    after = environment.observe()
    for name, value in before.values.items():
        assert np.array_equal(value, after[name]), name


def test_contact_forces_carry_what_is_held():
    environment = Environment(task_bundles.lift())
    for place, fingers, periods in (((0.3, 0.1, 0.1), 0.05, 18), ((0.3, 0.1, 0), 0.05, 8), ((0.3, 0.1, 0), 0.012, 6)):
        for _ in range(periods):
            environment.step(np.array([*place, fingers, fingers]))
    for _ in range(25):
        environment.step(np.array([0.3, 0.1, 0.05, 0.012, 0.012]))
    left, right = environment.contact_forces()
    assert left[1] > 1.0  # the box pushes the left finger to the left
    assert right[1] < -1.0
    assert left[1] + right[1] == pytest.approx(0.0, abs=0.05)
    assert left[2] + right[2] == pytest.approx(-0.1 * 9.81, rel=0.05)


def test_an_episode_holds_what_was_seen_before_and_sent_after():
    environment = Environment(task_bundles.lift(reset=WIDE))
    environment.reset(3)
    recorder = Recorder(environment)
    seen, sent = [], []
    for step in range(6):
        action = environment.previous_action + 0.01 * step
        seen.append(environment.measure())
        recorder.before(action)
        outcome = environment.step(action + 1.0)
        recorder.after(outcome.executed)
        sent.append(outcome.executed)
    recorder.before(environment.previous_action)  # a row that nothing was sent for
    episode = recorder.episode("policy", success=False, reason="stopped")
    assert len(recorder) == len(episode.action) == 6
    assert np.allclose(episode.executed, sent, atol=1e-7)
    assert np.allclose(episode.objects, [row.objects for row in seen], atol=1e-6)
    assert np.allclose(episode.joints[0], environment.start.qpos[-5:], atol=1e-6)
    assert not np.allclose(episode.action, episode.executed)
    packed = gathered(environment.bundle, {"0": episode}, {}, 1)
    assert (len(packed.joint_names), len(packed.object_names), len(packed.displacement_names)) == (5, 2, 1)
    assert episode.contact.shape == (6, len(packed.tip_names), 3) == (6, 2, 3)


def test_an_action_that_is_not_finite_is_kept_as_zero_with_its_reason():
    environment = Environment(task_bundles.lift())
    recorder = Recorder(environment)
    recorder.before(np.array([0, np.nan, 0, 0, 0]))
    outcome = environment.step(np.array([0, np.nan, 0, 0, 0]))
    recorder.after(outcome.executed)
    episode = recorder.episode("policy", success=False, reason=outcome.reason)
    assert episode.action[0, 1] == 0.0
    assert episode.reason == "the action for `y` is not a finite number"


def test_with_the_base_off_the_robot_knows_itself_and_is_told_of_objects_as_before():
    environment = Environment(task_bundles.lift())
    told, palm, goal = environment.object_poses(), environment.palm_poses(), environment.goal
    error = (0.02, -0.01, 0.03, 0.05, -0.02, 0.1)
    start = environment.start.model_copy(update={"base_error": error})
    seen = environment.begin(start)
    assert np.array_equal(environment.object_poses(), told)
    assert np.allclose(environment.palm_poses(), palm, atol=1e-9)
    assert np.array_equal(seen["goal"], goal)
    assert np.allclose(seen["joints"], environment.bundle.robot.joints[0].home + start.ctrl, atol=0.06)
    # In the world its palm is off by the error, about the origin of its base.
    base = environment.bundle.base_pose.matrix
    site = environment.data.site("robot/palm").xpos
    assert np.allclose(site, transforms.apply(lie.retract(base, error), palm[0, :3]))
    assert np.linalg.norm(site - transforms.apply(base, palm[0, :3])) > 0.03
    # Plans are made in a model that does not show it.
    known = environment.known_model().body("robot/base")
    assert np.allclose(known.pos, base[:3, 3], atol=1e-8)
    assert not np.allclose(environment.model.body("robot/base").pos, known.pos)
