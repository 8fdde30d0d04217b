"""The stream that a headset would have given of moving hands."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from pydantic import Field, NonNegativeFloat, NonNegativeInt, PositiveFloat

from dextera_build.artifacts.robots.hand_stream import LOST, PREDICTED, TRACKED, HandStream, Take
from dextera_build.geometry import hands, lie, quaternions
from dextera_build.geometry.human_hand import Hand
from dextera_build.rule import Options

from . import unsteady
from .smooth import Motion
from .unsteady import UnsteadyOptions

SWAY_M, SWAY_DEG = 0.004, 1.0
"""Slow motion of the head, standard deviations; assumptions."""
_JOINTS = len(hands.JOINTS)


class TrackedOptions(Options):
    """Options of the device that would have tracked the hands."""

    seed: NonNegativeInt = 0
    """Seed of all noise."""
    rate_hz: PositiveFloat = Field(72.0, ge=10.0, le=240.0)
    """Rate of the messages [Hz]."""
    back_m: NonNegativeFloat = 0.45
    """Distance of the head behind the middle of the hands' motion [m]; an assumption."""
    above_m: NonNegativeFloat = 0.45
    """Distance of the head above it [m]; an assumption."""
    unsteady: UnsteadyOptions = UnsteadyOptions()
    """Tremor of the hand, and errors of its tracking."""


def stream(
    hand: Hand, motions: Mapping[int, Motion], takes: tuple[Take, ...], options: TrackedOptions, device: str
) -> HandStream:
    """The hands as tracked: with tremor and noise, and lost at times.

    Args:
        hand: The operator's hand.
        motions: Side, 0 left or 1 right -> its motion at the rate of the options.
        takes: Messages in which the hands drive.
        options: Of the rule.
        device: Text about the origin.
    """
    random = np.random.default_rng(options.seed)
    count = min(len(each.wrist) for each in motions.values())
    positions = np.full((count, 2, _JOINTS, 3), np.nan, np.float32)
    rotations = np.full((count, 2, _JOINTS, 4), np.nan, np.float32)
    tracking = np.full((count, 2), LOST, np.uint8)
    for side, motion in sorted(motions.items()):
        places, turns = _joints(hand, side, motion, options, random)
        lost = unsteady.losses(options.unsteady, options.rate_hz, count, random)
        known = np.maximum.accumulate(np.where(lost == 0, np.arange(count), 0))
        short = round(options.unsteady.predicted_s * options.rate_hz)
        tracking[:, side] = np.where(lost == 0, TRACKED, np.where(lost <= short, PREDICTED, LOST))
        there = tracking[:, side] > LOST
        positions[there, side], rotations[there, side] = places[known][there], turns[known][there]
    clutch = np.zeros((count, 2), bool)
    for take in takes:
        clutch[take.first : take.last, sorted(motions)] = True
    return HandStream(
        frame="base",
        device=device,
        synthetic=True,
        stamps=unsteady.clock(options.unsteady, options.rate_hz, count, random),
        positions=positions,
        rotations=rotations,
        tracking=tracking,
        head=_head(motions, options, count, random),
        pinch=np.nan_to_num(hands.pinch(positions), nan=0.0).astype(np.float32),
        clutch=clutch,
        takes=takes,
    )


def _joints(
    hand: Hand, side: int, motion: Motion, options: TrackedOptions, random: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Positions (N, 25, 3) and quaternions (N, 25, 4) of a hand in the frame of the motion, with errors.

    Errors are of the wrist and of angles, so bones keep their lengths, as they do in a headset's skeleton.
    """
    count = len(motion.wrist)
    shift, turn = unsteady.errors(options.unsteady, options.rate_hz, count, (3, 3 + 20), random)
    places, turns = hand.joints(motion.angles + turn[:, 3:].reshape(count, 5, 4), hands.SIDES[side])
    pairs = zip(motion.wrist[:, 3:], turn[:, :3], strict=True)
    wrist = np.array([quaternions.to_matrix(row) @ lie.rotation(error) for row, error in pairs])
    placed = places @ wrist.swapaxes(1, 2) + (motion.wrist[:, :3] + shift)[:, None]
    found = quaternions.from_matrices((wrist[:, None] @ turns).reshape(-1, 3, 3)).reshape(count, _JOINTS, 4)
    return placed.astype(np.float32), found.astype(np.float32)


def _head(
    motions: Mapping[int, Motion], options: TrackedOptions, count: int, random: np.random.Generator
) -> np.ndarray:
    """Poses (N, 7) of a head behind and above the hands that looks at the middle of their motion, and sways."""
    middle = np.mean([each.wrist[:, :3].mean(axis=0) for each in motions.values()], axis=0)
    place = middle + np.array([-options.back_m, 0.0, options.above_m])
    back = (place - middle) / np.linalg.norm(place - middle)
    across = np.cross([0.0, 0, 1], back)
    across = across / np.linalg.norm(across) if np.linalg.norm(across) > 1e-6 else np.array([0.0, -1, 0])
    frame = np.stack([across, np.cross(back, across), back], axis=1)
    sway = unsteady.banded(random, options.rate_hz, count, 6, (0.1, 0.5))
    turned = [frame @ lie.rotation(np.deg2rad(SWAY_DEG) * row) for row in sway[:, 3:]]
    rows = [quaternions.from_matrix(each) for each in turned]
    return np.hstack([place + SWAY_M * sway[:, :3], rows]).astype(np.float32)
