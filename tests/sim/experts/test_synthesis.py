"""Eq. 4 of the paper: what is kept, what is interpolated, what noise may touch."""

from __future__ import annotations

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dextera_build.artifacts.tasks.episode import Segment
from dextera_build.geometry import transforms
from dextera_build.geometry.lie import rotation
from dextera_build.geometry.poses import to_matrix
from dextera_build.sim.control.operator import State
from dextera_build.sim.experts.adapt import Timing, bent, slowed, steps_between, transfer
from dextera_build.sim.experts.motion import between
from dextera_build.sim.experts.sources import _hold, alike, nearest, sources_of
from dextera_build.sim.experts.synthesis import Manner, Synthesis
from tests import episodes, factories

numbers = st.floats(-2.0, 2.0)
vectors = st.tuples(numbers, numbers, numbers).map(np.array)
poses = st.builds(lambda turn, place: transforms.rigid(rotation(turn), place), vectors, vectors)


@given(poses, poses, poses)
def test_the_pose_relative_to_the_frame_is_kept(palm, source, new):
    moved = transfer(palm[None], source, new)[0]
    assert np.allclose(transforms.invert(new) @ moved, transforms.invert(source) @ palm, atol=1e-9)


@given(poses, poses)
def test_a_frame_that_did_not_move_changes_nothing(palm, frame):
    assert np.allclose(transfer(palm[None], frame, frame)[0], palm, atol=1e-9)


@given(poses, poses, st.floats(0.0, 1.0))
def test_rotation_takes_the_shortest_way_at_even_speed_and_inputs_are_left_alone(first, last, part):
    kept = first.copy(), last.copy()
    whole = transforms.angle(first[:3, :3].T @ last[:3, :3])
    made = between(first, last, part)
    assert transforms.angle(first[:3, :3].T @ made[:3, :3]) == pytest.approx(part * whole, abs=1e-6)
    assert np.allclose(made[:3, 3], (1 - part) * first[:3, 3] + part * last[:3, 3])
    assert np.array_equal(first, kept[0])
    assert np.array_equal(last, kept[1])


def test_opposite_quaternions_are_the_same_rotation():
    pose = np.array([0.1, 0.2, 0.3, 0.6, 0.0, 0.8, 0.0])
    turned = np.concatenate([pose[:3], -pose[3:]])
    assert np.allclose(between(to_matrix(pose), to_matrix(turned), 0.5), to_matrix(pose))


def test_interpolation_is_timed_by_speed():
    near, far = factories.pose(0.0), factories.pose(0.7)
    timing = Timing(speed_m_s=0.35, turn_rad_s=1.0)
    assert steps_between(near, far, 20.0, timing) == 40
    assert steps_between(near, factories.pose(yaw=0.5), 20.0, timing) == 10
    assert steps_between(near, near, 20.0, timing) == 1


def moved_task(shift: np.ndarray, segments: tuple[Segment, ...] = ()) -> tuple[Synthesis, State]:
    """The demonstration of `tests.episodes`, with the box moved by `shift` in the base frame."""
    source = episodes.episode(20, seed=3)
    source = source.model_copy(update={"segments": segments or source.segments})
    environment = SimpleNamespace(
        bundle=SimpleNamespace(robot=episodes.robot()),
        palm_poses=lambda: source.hand[0],
        previous_action=np.array(episodes.HOME),
        task=SimpleNamespace(control_hz=20.0, object="box"),
    )
    objects = {name: shift @ to_matrix(row) for name, row in zip(("box", "case"), source.objects[0], strict=True)}
    state = State(joints=np.array(episodes.HOME), objects=objects, displacement={})
    shown = episodes.small(1).model_copy(update={"items": {"0": source}})
    operator = Synthesis(sources_of(shown), environment, None, Manner(), seed=0)
    operator.begin(state)
    return operator, state


@pytest.mark.medium
@settings(max_examples=20, deadline=None)
@given(numbers, numbers, st.floats(-3.0, 3.0))
def test_every_framed_step_keeps_the_demonstrated_pose_in_the_objects_frame(x, y, yaw):
    shift = factories.pose(0.1 * x, 0.1 * y, yaw=yaw)
    operator, state = moved_task(shift)
    commands = []
    while (command := operator.command(state)) is not None:
        commands.append(command)
    source = episodes.episode(20, seed=3)
    framed = [command for command in commands if command.frame]
    assert len(framed) == 20
    for row, command in enumerate(framed):
        assert np.allclose(command.aims["arm"].palm, shift @ to_matrix(source.hand[row, 0]), atol=1e-5)


def with_free_approach() -> tuple[Synthesis, State, np.ndarray]:
    """The demonstration with a free first half, its box moved; and the poses that were demonstrated."""
    source = episodes.episode(20, seed=3)
    segments = (
        Segment(name="approach", first=0, last=10, frame="", contact=False),
        Segment(name="grasp", first=10, last=20, frame="box", contact=True),
    )
    operator, state = moved_task(factories.pose(0.1, 0.0, yaw=0.4), segments)
    return operator, state, np.array([to_matrix(row[0]) for row in source.hand])


def test_free_motion_leads_from_the_hand_to_the_moved_object_no_faster_than_shown():
    operator, state, shown = with_free_approach()
    commands = []
    while (command := operator.command(state)) is not None:
        commands.append(command)
    free = [command.aims["arm"].palm for command in commands if not command.frame]
    target = next(command.aims["arm"].palm for command in commands if command.frame)
    assert len(free) >= 9
    steps = np.linalg.norm(np.diff([*[pose[:3, 3] for pose in free], target[:3, 3]], axis=0), axis=1)
    fastest = np.linalg.norm(np.diff(shown[:11, :3, 3], axis=0), axis=1).max()
    turn = max(transforms.angle(a[:3, :3].T @ b[:3, :3]) for a, b in pairwise(shown[:11]))
    assert steps.max() <= fastest + turn + 1e-9
    assert transforms.angle(free[-1][:3, :3].T @ target[:3, :3]) < 0.2


@given(poses, poses)
def test_a_bent_path_begins_and_ends_where_it_shall(start, end):
    path = np.array([factories.pose(0.1 * row, 0.05 * row**2, 0.0, yaw=0.1 * row) for row in range(6)])
    made = bent(path, start, end)
    assert np.allclose(made[0], start, atol=1e-9)
    assert np.allclose(made[-1], end, atol=1e-9)


def test_a_path_that_is_moved_as_a_whole_keeps_its_shape():
    path = np.array([factories.pose(0.1 * row, 0.05 * row**2, 0.0, yaw=0.1 * row) for row in range(6)])
    shift = factories.pose(0.3, -0.2, 0.1, yaw=0.7)
    assert np.allclose(bent(path, shift @ path[0], shift @ path[-1]), shift @ path)
    assert slowed(path, shift @ path) == pytest.approx(1.0)


def test_free_motion_at_the_end_goes_on_from_where_the_hand_is():
    source = episodes.episode(20, seed=3)
    segments = (
        Segment(name="grasp", first=0, last=10, frame="box", contact=True),
        Segment(name="retreat", first=10, last=20, frame="", contact=False),
    )
    operator, state = moved_task(factories.pose(0.05, 0.02), segments)
    palms = []
    while (command := operator.command(state)) is not None:
        palms.append(command.aims["arm"].palm)
    made = transforms.invert(palms[-10]) @ palms[-1]
    shown = transforms.invert(to_matrix(source.hand[10, 0])) @ to_matrix(source.hand[19, 0])
    assert np.allclose(made, shown, atol=1e-5)


def test_the_nearest_demonstration_is_taken():
    shown = [to_matrix(episodes.episode(5, seed=number).objects[0, 0]) for number in range(8)]
    order = nearest(shown, shown[5], 1, np.random.default_rng(0))
    assert (order[0], sorted(order)) == (5, list(range(8)))
    assert nearest(shown, shown[5], 3, np.random.default_rng(0))[1:2] in ([5], order[1:2])
    drawn = {nearest(shown, shown[5], 3, np.random.default_rng(seed))[0] for seed in range(40)}
    assert 5 in drawn
    assert len(drawn) == 3


def test_demonstrations_that_take_hold_otherwise_are_left_out():
    shown = [episodes.episode(20, seed=number) for number in range(5)]
    odd = shown[2].hand.copy()
    odd[..., 3:] = odd[..., 3:][..., [1, 0, 3, 2]]
    mixed = [*shown[:2], shown[2].model_copy(update={"hand": odd}), *shown[3:]]
    alone = [_hold(source, ["box", "case"]) for source in mixed]
    assert transforms.angle(alone[2][:3, :3].T @ _hold(shown[2], ["box", "case"])[:3, :3]) > 0.5
    same = [source.model_copy(update={"hand": shown[0].hand, "terms": shown[0].terms}) for source in shown[:4]]
    assert alike([*same, mixed[2]], ("box", "case")) == same
    assert alike([], ()) == []
