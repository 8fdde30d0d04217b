"""Cross-domain replay: a world seen by a tracker is rebuilt in the twin, and what succeeds there is sent back."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.tasks.episode import Episode, Start
from dextera_build.geometry import quaternions
from dextera_build.sim.runtime import starts
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.runtime.reconstruction import Tracker, reconstruct
from dextera_build.sim.runtime.replay import Replay
from dextera_build.sim.runtime.rollout import open_loop
from dextera_build.sim.runtime.tracked_cell import NOT_FOUND, TrackedCell
from tests import gate
from tests.sim.runtime import cells


def drawn(environment: Environment, seed: int = 0) -> Start:
    return environment.draw(seed)


def seen_in(world: Environment, twin: Environment, seed: int = 0, tracker: Tracker | None = None) -> Start:
    world.begin(drawn(world, seed))
    return reconstruct(world.measure(), world.previous_action, twin, tracker or Tracker(), seed)


@pytest.fixture(scope="module")
def twin() -> Environment:
    return Environment(gate.bundle(ball=True))


def test_a_perfect_tracker_rebuilds_the_configuration_but_not_the_dynamics(twin):
    world = Environment(gate.bundle("reference", ball=True))
    there = drawn(world, 3)
    here = seen_in(world, twin, 3)
    assert here.qpos == pytest.approx(there.qpos, abs=1e-9)
    assert here.ctrl == pytest.approx(there.ctrl)
    assert here.mass_scale == {"case": 1.0, "ball": 1.0} != there.mass_scale
    assert (here.gain_scale, here.seed) == (1.0, 3)


def test_poses_pass_through_the_base(twin):
    world = Environment(gate.bundle("reference", ball=True))
    here = seen_in(world, twin, 1)
    twin.begin(here)
    world.begin(drawn(world, 1))
    assert twin.object_poses() == pytest.approx(world.object_poses(), abs=1e-9)


def test_the_tracker_s_errors_have_their_size_and_their_seed(twin):
    world = Environment(gate.bundle("reference", ball=True))
    tracker = Tracker(position_m=0.004, rotation_rad=0.05)
    shifts, turns = [], []
    for seed in range(30):
        there, here = drawn(world, seed).qpos, seen_in(world, twin, seed, tracker).qpos
        shifts += [here[:2] - there[:2]]
        cosine = abs(float(here[3:7] @ there[3:7]))
        turns.append(2 * np.arccos(min(1.0, cosine)))
    assert np.std(shifts) == pytest.approx(0.004, rel=0.3)
    assert np.sqrt(np.mean(np.square(turns)) / 3) == pytest.approx(0.05, rel=0.3)
    again = seen_in(world, twin, 7, tracker).qpos
    assert np.array_equal(again, seen_in(world, twin, 7, tracker).qpos)


def test_what_would_stand_in_the_table_is_raised(twin):
    world = Environment(gate.bundle("reference", ball=True))
    world.begin(drawn(world))
    seen = world.measure()
    seen.objects[:, 2] -= 0.006
    start = reconstruct(seen, world.previous_action, twin, Tracker(), 0)
    twin.begin(start)
    assert twin.data.contact.dist[: twin.data.ncon].min() > -starts.TOUCH_M
    assert start.qpos[2] == pytest.approx(0.05, abs=0.0016)


def pushing(environment: Environment, log: list[int], fail: int = 0):
    """A synthesis without skill, whose first `fail` tries stop short."""

    def synthesise(start: Start, seed: int) -> Episode:
        log.append(seed)
        goal = gate.STOPS_SHORT if len(log) <= fail else gate.PUSHES
        return open_loop(environment, start, np.full((30, 1), gate.target(goal)))

    return synthesise


def test_what_succeeds_in_the_twin_is_sent_to_the_world(twin):
    world, log = Environment(gate.bundle("reference", ball=True)), []
    found = Replay(twin, world, pushing(twin, log), tries=3).attempt(5)
    assert found.episode.success
    assert found.rehearsal.success
    assert found.reason == ""
    assert len(log) == 1
    sent = found.rehearsal.executed
    assert found.episode.executed[: len(sent)] == pytest.approx(sent, abs=1e-6)
    assert np.array_equal(found.episode.start.qpos, drawn(world, 5).qpos)
    assert found.placed == pytest.approx(found.episode.objects[0], abs=1e-6)


def test_a_world_that_behaves_otherwise_fails_the_replay(twin):
    missing = Environment(gate.bundle("reference", peg_m=0.05, ball=True))
    found = Replay(twin, missing, pushing(twin, []), tries=3).attempt(5)
    assert found.rehearsal.success
    assert not found.episode.success
    assert found.episode.reason == "not done when the trajectory was over"


def test_it_is_tried_again_in_the_twin_with_another_seed(twin):
    world, log = Environment(gate.bundle("reference", ball=True)), []
    found = Replay(twin, world, pushing(twin, log, fail=2), tries=3).attempt(5)
    assert found.episode.success
    assert len(set(log)) == 3


def test_a_reset_for_which_nothing_succeeds_in_the_twin_brings_no_replay(twin):
    world, log = Environment(gate.bundle("reference", ball=True)), []
    found = Replay(twin, world, pushing(twin, log, fail=9), tries=3).attempt(5)
    assert (found.episode, len(log)) == (None, 3)
    assert found.reason == "no success in the twin: not done when the trajectory was over"


def test_a_world_too_crowded_for_a_start_says_so(twin):
    crowded = gate.bundle("reference", ball=True)
    case = crowded.objects["case"]
    inside = crowded.objects["ball"].model_copy(update={"pose": case.pose})
    world = Environment(crowded.model_copy(update={"objects": {"case": case, "ball": inside}}))
    found = Replay(twin, world, pushing(twin, []), tries=3).attempt(5)
    assert found.reason == "no start of `OpenGate` without collisions was found"


def test_objects_are_matched_by_name(twin):
    bundle = gate.bundle("reference", ball=True)
    turned = bundle.model_copy(update={"objects": dict(reversed(bundle.objects.items()))})
    world = Environment(turned)
    found = Replay(twin, world, pushing(twin, []), tries=1).attempt(2)
    assert found.episode.success
    twin_case = found.rehearsal.objects[0, 0]
    world_case = found.episode.objects[0, 1]
    assert twin_case[:3] == pytest.approx(world_case[:3], abs=1e-6)
    assert quaternions.to_matrix(twin_case[3:]) == pytest.approx(quaternions.to_matrix(world_case[3:]), abs=1e-5)


@pytest.mark.medium
@pytest.mark.parametrize("found", [True, False])
def test_with_a_cell_the_twin_is_set_up_as_its_tracker_sees_the_world(found):
    twin, world = Environment(gate.bundle()), Environment(gate.bundle("reference"))
    seen: list[Start] = []

    def synthesise(start: Start, seed: int) -> Episode:
        seen.append(start)
        return open_loop(twin, start, np.full((50, 1), gate.target(gate.PUSHES)))

    cell = cells.cell(**({} if found else {"loss": 1.0}))
    with TrackedCell(world, cell, ("case",)) as watching:
        done = Replay(twin, world, synthesise, tries=1, cell=watching).attempt(5)
    assert done.episode is not None
    assert done.episode.success is found
    if not found:
        assert (done.episode.reason, done.rehearsal, seen) == (NOT_FOUND, None, [])
        return
    twin.begin(seen[0])
    placed = twin.object_poses()
    assert placed[:, :3] == pytest.approx(done.placed[:, :3], abs=0.003)
    assert not np.array_equal(placed, done.placed)
