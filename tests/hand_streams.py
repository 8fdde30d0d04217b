"""Hand streams for tests: a pair of articulated hands that open, close and move, made by a program."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from dextera_build.artifacts.robots.hand_stream import LOST, TRACKED, HandStream, Take, Workplace
from dextera_build.geometry import human_hand, lie, quaternions

RATE_HZ = 72.0
AHEAD = np.array([[0.0, 0, -1], [-1, 0, 0], [0, 1, 0]])
"""Rotation of the axes of WebXR's frame (y up, -z ahead) into one with z up and x ahead."""


def stream(count: int = 144, *, lost: Sequence[tuple[int, int, int]] = (), **changes: Any) -> HandStream:
    """Both hands in front of the head, palms down, closing and opening once a second while they move sideways.

    Args:
        count: Messages.
        lost: Hand, first and last message of the stretches in which it is lost.
        changes: Other fields.
    """
    times = np.round(np.arange(count) / RATE_HZ, 9)
    share = 0.5 - 0.5 * np.cos(2 * np.pi * times)
    angles = human_hand.open_angles() + share[:, None, None] * np.deg2rad([[0, 20, 30, 20], *[[0, 40, 50, 33]] * 4])
    positions, rotations = np.zeros((count, 2, 25, 3), np.float32), np.zeros((count, 2, 25, 4), np.float32)
    wrist = AHEAD @ lie.rotation(np.array([0.2, 0.0, 0.1]))
    for hand, side in enumerate(("left", "right")):
        places, turns = human_hand.Hand().joints(angles, side)
        away = np.array([0.4, 0.2 - 0.4 * hand, 1.1]) + 0.05 * np.sin(3 * times)[:, None] * [0.5, 1.0, 0.3]
        positions[:, hand] = places @ wrist.T + away[:, None]
        turned = quaternions.from_matrices((wrist @ turns).reshape(-1, 3, 3))
        rotations[:, hand] = turned.reshape(count, 25, 4)
    tracking = np.full((count, 2), TRACKED, np.uint8)
    for hand, first, last in lost:
        tracking[first:last, hand] = LOST
        positions[first:last, hand] = rotations[first:last, hand] = np.nan
    head = np.tile(np.append([0.0, 0.0, 1.6], quaternions.from_matrix(AHEAD)), (count, 1)).astype(np.float32)
    fields = {
        "frame": "local-floor",
        "device": "a test, no headset",
        "synthetic": True,
        "stamps": times,
        "positions": positions,
        "rotations": rotations,
        "tracking": tracking,
        "head": head,
        "pinch": np.repeat(share[:, None], 2, axis=1).astype(np.float32),
        "clutch": np.repeat((times > 0.2)[:, None], 2, axis=1),
    }
    return HandStream(**fields | changes)


def with_buttons(count: int = 20) -> HandStream:
    """A stream in which everything is set."""
    buttons = np.linspace(0, 1, 2 * count).reshape(count, 2).astype(np.float32)
    return stream(
        count,
        lost=[(0, 3, 6)],
        button_names=("success", "discard"),
        buttons=buttons,
        takes=(Take(first=0, last=8, seed=7), Take(first=9, last=count)),
        workplace=Workplace(task="LiftCan", robot="kuka_leap", joints=("a", "b"), model="0f"),
    )
