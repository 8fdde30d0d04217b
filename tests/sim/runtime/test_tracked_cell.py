"""A world that is measured through a camera, a tracker and a calibration, never through the simulator."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.robots.cell import Cell, Limits
from dextera_build.artifacts.robots.noise import DepthNoise
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.errors import RuleError
from dextera_build.geometry import poses, transforms
from dextera_build.sim.primitives.pick_and_place.primitive import PlaceGoal
from dextera_build.sim.primitives.poses import Tolerance
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.runtime.rollout import closed_loop
from dextera_build.sim.runtime.tracked_cell import NOT_FOUND, TrackedCell, check
from tests import factories, gate
from tests.sim.runtime import cells


@pytest.fixture(scope="module")
def environment() -> Environment:
    return Environment(gate.bundle("reference"))


NEAR = Tolerance(position_m=0.03, rotation_rad=0.3)


class Pushing:
    """Pushes the flap, and remembers what it was told."""

    def __init__(self) -> None:
        self.objects: list[np.ndarray] = []
        self.joints: list[float] = []

    def reset(self) -> None:
        pass

    def act(self, observation):
        self.objects.append(observation["objects"][0])
        self.joints.append(float(observation["displacement"][0]))
        return np.array([gate.target(gate.PUSHES)])


class Idle(Pushing):
    """Stays where it is."""

    def act(self, observation):
        return observation["previous_action"]


def pushed(environment: Environment, cell: Cell, seed: int = 0):
    """What a policy was told of the flap, what was true, and the tracker's record."""
    policy = Pushing()
    with TrackedCell(environment, cell, ()) as watching:
        episode = closed_loop(environment, policy, environment.draw(seed), cell=watching)
        return policy, episode, watching.sighting


@pytest.mark.medium
def test_object_and_joint_are_where_they_are(environment):
    policy, episode, sighting = pushed(environment, cells.cell())
    assert episode.success
    assert (sighting.found_s, sighting.tracked) == (0.0, sighting.frames)
    assert np.ptp(policy.joints) > 0.5
    assert np.array(policy.joints) == pytest.approx(episode.displacement[:, 0], abs=0.02)
    assert np.array(policy.objects)[:, :3] == pytest.approx(episode.objects[:, 0, :3], abs=0.002)
    assert max(sighting.distances_m) < 0.002
    assert max(sighting.angles_rad) < 0.02
    assert len(sighting.joints_rad) == sighting.tracked


@pytest.mark.parametrize(("into", "names"), [("", ("case",)), ("ball", ("case", "ball"))])
def test_the_container_of_a_placement_is_tracked_too(into, names):
    bundle = gate.bundle("reference", ball=True)
    goal = PlaceGoal(into=into, place_m=None if into else (0.0, 0.0, 0.1), tolerance=NEAR)
    placing = bundle.model_copy(update={"task": bundle.task.model_copy(update={"goal": goal})})
    cell = cells.cell(assets={"case": cells.asset(), "ball": cells.asset()})
    assert TrackedCell(Environment(placing), cell, ()).names == names


@pytest.mark.medium
def test_an_error_of_the_calibration_moves_all_poses(environment):
    error = transforms.rigid(factories.pose(yaw=0.03)[:3, :3], np.array([0.004, -0.006, 0.003]))
    policy, episode, sighting = pushed(environment, cells.cell(error))
    base = transforms.invert(gate.WORLD_FROM_BASE) @ cells.EYE
    moved = base @ transforms.invert(error) @ transforms.invert(base) @ poses.to_matrix(episode.objects[0, 0])
    told = poses.to_matrix(policy.objects[0])
    assert told[:3, 3] == pytest.approx(moved[:3, 3], abs=0.002)
    assert transforms.angle(told[:3, :3].T @ moved[:3, :3]) < 0.02
    true = episode.objects[0, 0, :3]
    assert sighting.distances_m[0] == pytest.approx(np.linalg.norm(moved[:3, 3] - true), abs=0.002)
    assert np.linalg.norm(told[:3, 3] - true) > 0.006


@pytest.mark.slow
def test_what_was_seen_arrives_late(environment):
    policy, episode, _ = pushed(environment, cells.cell(delay_s=0.2))
    late, true = np.array(policy.joints), episode.displacement[:, 0]
    assert late[4:] == pytest.approx(true[:-4], abs=0.02)
    assert np.abs(late - true).max() > 0.1


@pytest.mark.slow
def test_frames_come_at_the_rate_of_the_camera(environment):
    policy, episode, sighting = pushed(environment, cells.cell(rate_hz=5.0))
    steps = len(episode.action)
    assert sighting.frames == -(-steps // 4)
    changed = np.flatnonzero(np.diff(policy.joints)) + 1
    assert set(changed % 4) <= {0}
    # On the average, 15 frames a second among 20 control periods.
    _, episode, sighting = pushed(environment, cells.cell(rate_hz=15.0))
    assert sighting.frames == pytest.approx(0.75 * len(episode.action), abs=1)


@pytest.mark.slow
def test_while_nothing_is_seen_the_last_pose_holds(environment):
    start = environment.draw(1)
    with TrackedCell(environment, cells.cell(), ()) as watching:
        assert watching.begin(start) == ""
        first = watching.measure()
        watching._camera.eye.look_from(factories.look_at((0.25, -0.55, 0.6), (3.0, 0.0, 2.0)))
        for _ in range(15):
            environment.step(np.array([gate.target(gate.PUSHES)]))
            seen = watching.measure()
        assert seen.displacement == pytest.approx(first.displacement)
        assert seen.objects == pytest.approx(first.objects)
        assert environment.measure().displacement[0] > first.displacement[0] + 0.2
        assert seen.joints == pytest.approx(environment.measure().joints)
        assert (watching.sighting.frames, watching.sighting.tracked) == (16, 1)


@pytest.mark.parametrize(
    "blind",
    [
        {"loss": 1.0},
        # Searching pictures without the object takes seconds.
        pytest.param(
            {"eye": Pose(parent="base", child="camera", matrix=factories.look_at((0.3, -0.6, 0.6), (3.0, 0.0, 2.0)))},
            marks=pytest.mark.slow,
        ),
        pytest.param({"depth_noise": DepthNoise(nearest_m=5.0)}, marks=pytest.mark.slow),
    ],
)
@pytest.mark.medium
def test_a_trial_whose_object_is_not_found_fails_before_it_begins(environment, blind):
    policy, episode, sighting = pushed(environment, cells.cell(**blind))
    assert (episode.success, episode.reason, len(episode.action)) == (False, NOT_FOUND, 0)
    assert (sighting.found_s, sighting.frames, policy.joints) == (None, 0, [])


@pytest.mark.slow
def test_a_trial_does_not_depend_on_the_ones_before(environment):
    noisy = cells.cell(depth_noise=DepthNoise(smear=0.3), loss=0.2, rate_hz=15.0)
    first, _, record = pushed(environment, noisy, 3)
    pushed(environment, noisy, 4)
    again, _, other = pushed(environment, noisy, 3)
    assert np.array_equal(first.objects, again.objects)
    assert record == other
    assert 0 < record.tracked <= record.frames


def test_a_cell_that_does_not_know_an_object_is_refused(environment):
    with pytest.raises(RuleError, match="does not know `case`") as caught:
        TrackedCell(environment, cells.cell(assets={"cup": cells.asset()}), ())
    assert caught.value.facts["known"] == "cup"


@pytest.mark.slow
def test_a_trial_is_judged_by_what_was_measured_too(environment):
    policy = Pushing()
    with TrackedCell(environment, cells.cell(), (), gate.bundle("twin")) as watching:
        episode = closed_loop(environment, policy, environment.draw(0), cell=watching)
        watching.settle()
        assert (episode.success, watching.sighting.success) == (True, True)
        idle = closed_loop(environment, Idle(), environment.draw(0), cell=watching)
        watching.settle()
        assert (idle.success, watching.sighting.success) == (False, False)


@pytest.mark.slow
def test_the_guard_keeps_a_policy_to_the_limits_of_the_cell(environment):
    slow = cells.cell(limits=Limits(speed=0.1))
    with TrackedCell(environment, slow, ()) as watching:
        crept = closed_loop(environment, Pushing(), environment.draw(0), cell=watching)
    free, steps = pushed(environment, cells.cell())[1], len(crept.executed)
    assert np.abs(np.diff(crept.executed, axis=0)).max() <= 0.11 * np.abs(np.diff(free.executed, axis=0)).max()
    assert steps > len(free.executed)


def test_a_workspace_needs_the_twin(environment):
    limits = Limits(workspace_m=((-1.0, -1.0, 0.0), (1.0, 1.0, 1.0)))
    with pytest.raises(RuleError, match="must know its robot"):
        TrackedCell(environment, cells.cell(limits=limits), ())


def test_a_force_needs_fingertips(environment):
    bundle = environment.bundle
    limbs = {name: limb.model_copy(update={"tips": ()}) for name, limb in bundle.robot.limbs.items()}
    bare = bundle.model_copy(update={"robot": bundle.robot.model_copy(update={"limbs": limbs})})
    with pytest.raises(RuleError, match="limits the force on fingertips has a robot without any") as caught:
        check(cells.cell(limits=Limits(force_n=5.0)), bare, None)
    assert caught.value.code == "DXB-B247"
    assert caught.value.hint == "leave `force_n` of `limits` out, or add frames `tip_...` to the robot"


@pytest.mark.medium
def test_a_base_has_no_error_beside_that_of_the_cell_s_calibration():
    twin = Environment(gate.bundle())
    start = twin.draw(1).model_copy(update={"base_error": (0.02, 0.0, 0.0, 0.0, 0.0, 0.0)})
    with TrackedCell(twin, cells.cell(), ()) as watching:
        assert watching.begin(start) == ""
    assert twin.start.base_error == (0.0,) * 6
