"""Doubts about streams of hands that can still be used: rate, gaps, jumps, lengths of bones, axes."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.robots.hand_stream import LOST, HandStream
from dextera_build.geometry import hands, quaternions, transforms
from dextera_build.rule import Context

LOST_SHARE = 0.1
"""Share of the messages between its first and last pose in which a hand may be lost."""
UNUSED_SHARE = 0.02
"""Share of a hand's messages that may be left out, because clocks are not even."""
STRETCH = 0.05
"""Standard deviation of a bone's length, as a fraction of it."""
TURNED = np.deg2rad(60)
"""Largest usual angle between the wrist's axes and those of the palm [rad]."""


def of_clock(ctx: Context, stream: HandStream, slowest_hz: float, gap_s: float) -> None:
    """Warn of a low rate of messages, and of gaps between them."""
    # Nobody looks at what lies between two takes.
    steps = np.where(_begins(stream)[1:], 0.0, np.diff(stream.stamps))
    if 0 < stream.rate_hz < slowest_hz:
        ctx.warn(
            f"hands come at {stream.rate_hz:.1f} Hz, so motion is cut off between messages: record at "
            f"{slowest_hz:g} Hz and more"
        )
    gaps = np.flatnonzero(steps > gap_s)
    if len(gaps):
        first = stream.stamps[gaps[0]] - stream.stamps[0]
        ctx.warn(
            f"nothing was recorded for more than {1000 * gap_s:.0f} ms {_times(len(gaps))}, the longest "
            f"{steps.max():.2f} s, the first after {first:.2f} s: a robot holds meanwhile; use a wired connection"
        )


def of_use(ctx: Context, stream: HandStream, unused: tuple[int, int]) -> None:
    """Warn of messages of a hand that fit no time of the other hand's, `unused` of left and right."""
    for hand, side in enumerate(hands.SIDES):
        count = int((stream.tracking[:, hand] > LOST).sum()) + unused[hand]
        if unused[hand] > UNUSED_SHARE * count:
            ctx.warn(
                f"{unused[hand]:,} of {count:,} messages of the {side} hand lie between those of the other "
                "hand and are left out: record both hands at one rate, or one hand alone"
            )


def of_motion(ctx: Context, stream: HandStream, jump_m: float, jump_rad: float) -> None:
    """Warn of hands that are often lost, and of wrists that jump from one message to the next."""
    for hand, side in enumerate(hands.SIDES):
        rows = np.flatnonzero(stream.tracking[:, hand] > LOST)
        if not len(rows):
            continue
        lost = 1 - len(rows) / (rows[-1] - rows[0] + 1)
        if lost > LOST_SHARE:
            ctx.warn(f"the {side} hand is lost {100 * lost:.0f} % of the time between its first and last pose")
        together = rows[1:][(np.diff(rows) == 1) & ~_begins(stream)[rows[1:]]]
        way = np.linalg.norm(np.diff(stream.positions[:, hand, hands.WRIST], axis=0)[together - 1], axis=1)
        first, second = (stream.rotations[together - step, hand, hands.WRIST] for step in (1, 0))
        turn = 2 * np.arccos(np.clip(np.abs((first * second).sum(axis=1)), 0, 1))
        jumps = np.flatnonzero((way > jump_m) | (turn > jump_rad))
        if len(jumps):
            at = stream.stamps[together[jumps[0]]] - stream.stamps[0]
            ctx.warn(
                f"the {side} wrist jumps {_times(len(jumps))}, first after {at:.2f} s by {1000 * way[jumps[0]]:.0f} mm "
                f"and {np.rad2deg(turn[jumps[0]]):.0f} deg: a robot holds there; cut the take, or record it again"
            )


def of_shape(ctx: Context, stream: HandStream) -> None:
    """Warn of bones that change their length, and of wrists whose axes are not those of the palm."""
    for hand, side in enumerate(hands.SIDES):
        seen = stream.tracking[:, hand] > LOST
        if not seen.any():
            continue
        points = stream.positions[seen, hand].astype(np.float64)
        lengths = hands.bone_lengths(points)
        spread = lengths.std(axis=0) / np.maximum(lengths.mean(axis=0), 1e-6)
        if np.median(spread) > STRETCH:
            ctx.warn(
                f"bones of the {side} hand change their length by {100 * np.median(spread):.0f} %: these are noisy "
                "landmarks, not a tracked skeleton"
            )
        wrists = quaternions.to_matrices(stream.rotations[seen, hand, hands.WRIST])
        angle = float(np.median(transforms.angles(wrists.swapaxes(1, 2) @ hands.palm_frame(points, side))))
        if angle > TURNED:
            ctx.warn(
                f"the axes of the {side} wrist are {np.rad2deg(angle):.0f} deg from those of the palm: WebXR's have -Z "
                "along the fingers and +Y out of the back of the hand"
            )


def _begins(stream: HandStream) -> np.ndarray:
    """Whether a take begins with each message (N,)."""
    return np.isin(np.arange(len(stream.stamps)), [take.first for take in stream.takes])


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count:,} times"
