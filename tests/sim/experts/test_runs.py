"""Runs of limbs: what is adapted at once, and what several limbs share; with two hands, by arithmetic."""

from __future__ import annotations

from collections.abc import Mapping
from types import SimpleNamespace

import numpy as np
import pytest

from dextera_build.artifacts.tasks.episode import Episode, Episodes, Segment
from dextera_build.geometry import transforms
from dextera_build.geometry.poses import from_matrix, to_matrix
from dextera_build.sim.control.operator import BASE, Command, State
from dextera_build.sim.experts.runs import Run, runs_of
from dextera_build.sim.experts.sources import sources_of
from dextera_build.sim.experts.synthesis import Manner, Synthesis
from tests import episodes, factories

LIMBS = ("left", "right")
STEPS = 40
BOX = factories.pose(0.4, 0.0, 0.1)
MET = factories.pose(0.3, 0.1, 0.3, yaw=0.5)
"""Where the box is handed over."""


def segment(name: str, first: int, last: int, frame: str, *limbs: str, contact: bool = True) -> Segment:
    return Segment(name=name, first=first, last=last, frame=frame, contact=contact, limbs=limbs)


LIFT = (
    segment("approach", 0, 10, "", *LIMBS, contact=False),
    segment("grasp", 10, 20, "box", *LIMBS),
    segment("lift", 20, STEPS, "box", *LIMBS),
)
HANDOVER = (
    segment("approach", 0, 5, "", "right", contact=False),
    segment("grasp", 5, 10, "box", "right"),
    segment("bring", 10, 20, "", "right"),
    segment("stay", 20, STEPS, BASE, "right"),
    segment("approach", 20, 30, "", "left", contact=False),
    segment("grasp", 30, STEPS, "box", "left"),
)


def demonstration(segments: tuple[Segment, ...], meets: bool) -> Episode:
    """Both hands circle about the box, which is taken to the meeting place if `meets`."""
    part = np.linspace(0.0, 1.0, STEPS)
    hands = [
        [factories.pose(0.4 + 0.1 * p, side * (0.3 - 0.1 * p), 0.2, yaw=side * p) for side in (1.0, -1.0)] for p in part
    ]
    box = [MET if meets and row >= 20 else BOX for row in range(STEPS)]
    plain = episodes.episode(STEPS)
    changed = {
        "segments": segments,
        "hand": np.array([[from_matrix(pose) for pose in pair] for pair in hands], np.float32),
        "action": np.tile(np.arange(4, dtype=np.float32) / 10, (STEPS, 1)),
        "terms": {**plain.terms, "objects": np.array([[from_matrix(pose)] for pose in box], np.float32)},
    }
    return plain.model_copy(update=changed)


def operated(shown: Episode, objects: Mapping[int, np.ndarray]) -> list[Command]:
    """Commands with the box at a pose from a step on."""
    joints = [SimpleNamespace(name=name, velocity=1.0, acceleration=8.5) for name in ("a", "b", "c", "d")]
    limbs = {"left": SimpleNamespace(hand=("a", "b")), "right": SimpleNamespace(hand=("c", "d"))}
    environment = SimpleNamespace(
        bundle=SimpleNamespace(robot=SimpleNamespace(limb_names=LIMBS, joints=joints, limbs=limbs)),
        task=SimpleNamespace(control_hz=20.0, object="box"),
        palm_poses=lambda: shown.hand[0],
        previous_action=np.arange(4) / 10,
    )
    found = episodes.small(1).model_copy(update={"items": {"0": shown}, "object_names": ("box",), "limb_names": LIMBS})
    operator = Synthesis(sources_of(found), environment, None, Manner(), seed=0)
    commands: list[Command] = []
    while True:
        pose = objects[max(step for step in objects if step <= len(commands))]
        state = State(np.zeros(4), {"box": pose}, {})
        if not commands:
            operator.begin(state)
        command = operator.command(state)
        if command is None:
            return commands
        commands.append(command)


def shown_pose(shown: Episode, row: int, limb: str) -> np.ndarray:
    return to_matrix(shown.hand[row, LIMBS.index(limb)])


def test_runs_end_where_the_frame_changes_and_know_what_the_hand_holds() -> None:
    shown = demonstration(HANDOVER, meets=True)
    assert runs_of(shown, LIMBS) == [
        Run("right", 0, 5, 10, "box", ("right",), holds=False),
        Run("right", 10, 20, STEPS, BASE, ("right",), holds=True),
        Run("left", 20, 30, STEPS, "box", ("left",), holds=False),
    ]
    both = runs_of(demonstration(LIFT, meets=False), LIMBS)
    assert both == [Run(limb, 0, 10, STEPS, "box", LIMBS) for limb in LIMBS]


def test_coordinated_hands_share_one_transform() -> None:
    shown, shift = demonstration(LIFT, meets=False), factories.pose(0.05, -0.03, 0.02, yaw=0.3)
    commands = operated(shown, {0: shift @ BOX})
    framed = [command for command in commands if command.frame]
    assert len(framed) >= 30
    # The first steps lead into the frame.
    for command in framed[3:]:
        assert command.parts == {}
        left, right = (transforms.invert(shift) @ command.aims[limb].palm for limb in LIMBS)
        # As shown, at the same time: at part p of the demonstration both are at x = 0.4 + 0.1 p, y = +-(0.3 - 0.1 p).
        assert left[:3, 3] == pytest.approx([right[0, 3], 0.7 - left[0, 3], 0.2], abs=1e-5)
        assert right[:3, 3] == pytest.approx(left[:3, 3] * [1, -1, 1], abs=1e-5)
    for limb in LIMBS:
        assert np.allclose(framed[-1].aims[limb].palm, shift @ shown_pose(shown, STEPS - 1, limb), atol=1e-5)


def test_the_receiver_goes_to_where_the_object_is_when_its_turn_comes() -> None:
    shown = demonstration(HANDOVER, meets=True)
    start, slipped = factories.pose(0.04, 0.02, yaw=0.2), factories.pose(0.01, -0.02, 0.015, yaw=-0.1)
    # The box has moved in the giver's hand on the way.
    commands = operated(shown, {0: start @ BOX, 11: slipped @ MET})
    giver = [command for command in commands if "left" not in command.aims]
    taken = [command for command in giver if command.frame == "box"]
    assert np.allclose(taken[-1].aims["right"].palm, start @ shown_pose(shown, 9, "right"), atol=1e-5)
    together = commands[len(giver) :]
    assert len(together) >= 18
    last = together[-1]
    assert (last.part("right").segment, last.part("right").frame) == ("stay", BASE)
    assert (last.part("left").segment, last.part("left").frame) == ("grasp", "box")
    assert last.contact
    assert np.allclose(last.aims["left"].palm, slipped @ shown_pose(shown, STEPS - 1, "left"), atol=1e-5)
    # Sequential: nothing of the receiver happens before the object was brought.
    assert {command.segment for command in giver} == {"approach", "grasp", "bring"}


def test_an_object_that_is_held_otherwise_still_comes_to_its_place() -> None:
    shown = demonstration(HANDOVER, meets=True)
    start, slip = factories.pose(0.04, 0.02, yaw=0.2), factories.pose(0.01, 0.0, 0.01, yaw=0.3)
    commands = operated(shown, {0: start @ BOX, 10: slip @ start @ BOX})
    number = next(n for n, command in enumerate(commands) if command.segment == "bring")
    before = commands[number - 1].aims["right"].palm
    held = transforms.invert(slip @ start @ BOX) @ before
    brought = commands[-1].aims["right"].palm @ transforms.invert(held)
    meant = shown_pose(shown, STEPS - 1, "right") @ transforms.invert(
        transforms.invert(BOX) @ shown_pose(shown, 10, "right")
    )
    assert np.allclose(brought, meant, atol=1e-5)


def test_only_demonstrations_with_the_same_structure_take_turns() -> None:
    lift, handover = demonstration(LIFT, meets=False), demonstration(HANDOVER, meets=True)
    shown: Episodes = episodes.small(1).model_copy(
        update={
            "items": {"0": lift, "1": handover, "2": handover},
            "object_names": ("box",),
            "limb_names": LIMBS,
        }
    )
    assert [source.name for source in sources_of(shown)] == ["1", "2"]
