"""Streams of hands that no robot should follow: each fault is one error with facts and a next step."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.robots.hand_stream import LOST, HandStream
from dextera_build.geometry import hands, quaternions
from dextera_build.rule import Context

SIZES_M = (0.12, 0.26)
"""Limits of the length of a hand from the wrist to the tip of the middle finger, children's and largest hands [m]."""
UNITS = {"millimetres": 0.001, "centimetres": 0.01, "decimetres": 0.1, "inches": 0.0254}
"""Unit -> its length [m]."""
BENT = 0.03
"""Mean bend of the fingers, as a fraction of the hand's length, from which on it tells a left hand from a right."""


def check(ctx: Context, stream: HandStream, sides: str, *, head: bool, mirrored: bool) -> None:
    """Raise for a stream that is not one of an operator's hands.

    Args:
        ctx: Context for errors.
        stream: The hands.
        sides: Hands that must be tracked: "any", "left", "right" or "both".
        head: Whether a head is needed.
        mirrored: Whether an axis was reversed by an option.
    """
    _check_tracked(ctx, stream, sides)
    _check_size(ctx, stream)
    if head:
        _check_head(ctx, stream)
    _check_sides(ctx, stream, mirrored=mirrored)


def tracked(stream: HandStream) -> dict[int, np.ndarray]:
    """Hand -> joints (K, 25, 3) [m] of the messages in which it is tracked; hands that never are, are left out."""
    seen = stream.tracking > LOST
    return {hand: stream.positions[seen[:, hand], hand].astype(np.float64) for hand in (0, 1) if seen[:, hand].any()}


def _check_tracked(ctx: Context, stream: HandStream, sides: str) -> None:
    seen = {hands.SIDES[hand] for hand in tracked(stream)}
    wanted = {"any": seen or set(hands.SIDES), "both": set(hands.SIDES)}.get(sides, {sides})
    missing = sorted(wanted - seen)
    if missing:
        ctx.fail(
            f"the {' and the '.join(missing)} hand {'are' if len(missing) > 1 else 'is'} never tracked",
            messages=f"{len(stream.stamps):,}",
            tracked=", ".join(sorted(seen)) or "none",
            hint="keep the hands in view of the headset, or name the topics that hold them",
        )


def _check_size(ctx: Context, stream: HandStream) -> None:
    for hand, points in tracked(stream).items():
        size = float(np.median(hands.hand_size(points)))
        if SIZES_M[0] <= size <= SIZES_M[1]:
            continue
        unit = next((name for name, length in UNITS.items() if SIZES_M[0] <= size * length <= SIZES_M[1]), None)
        ctx.fail(
            f"the {hands.SIDES[hand]} hand is {size:.4g} m long"
            + (f", which looks like {unit} instead of metres" if unit else ", which is no hand's length"),
            expected=f"{SIZES_M[0]:g} to {SIZES_M[1]:g} m from the wrist to the tip of the middle finger",
            hint=f"set `unit_m: {UNITS[unit]:g}`" if unit else "check the order of the joints, and the unit",
        )


def _check_head(ctx: Context, stream: HandStream) -> None:
    heads = stream.known_heads
    if not len(heads):
        ctx.fail(
            "the recording has no head, which tells where the operator looks from",
            messages=f"{len(stream.stamps):,}",
            hint="record the head as `geometry_msgs/PoseStamped` and name its topic in `head`; "
            'for a webcam or a phone, which have none, write `head: ""`',
        )
    up = quaternions.to_matrices(heads[:, 3:].astype(np.float64))[:, :, 1].mean(axis=0)
    if up[2] < 0.5:
        ctx.fail(
            "the head does not stand upright, so the recording's frame has not z up",
            head_up=f"({up[0]:.2f}, {up[1]:.2f}, {up[2]:.2f}) on average",
            hint="set `up: y`" if up[1] > 0.5 else "check the axes of frame and head: -Z looks ahead, +Y is up",
        )


def _check_sides(ctx: Context, stream: HandStream, *, mirrored: bool) -> None:
    """Left hands are left ones: fingers bend to the palm, which lies on opposite sides of the two hands."""
    bends = {
        hand: float(np.mean(hands.curl(points) / hands.hand_size(points))) * (1 if hand else -1)
        for hand, points in tracked(stream).items()
    }
    wrong = sorted(hand for hand, bend in bends.items() if bend < -BENT)
    if not wrong:
        return
    facts = {
        f"{hands.SIDES[hand]}": f"fingers bend {100 * bend:+.0f} % of the hand's length to its palm"
        for hand, bend in bends.items()
    }
    crossed = _crossed(stream)
    if len(wrong) < len(bends):
        other = hands.SIDES[1 - wrong[0]]
        ctx.fail(
            f"the {hands.SIDES[wrong[0]]} hand is a {other} one, as the other hand is",
            hint=f"record the {hands.SIDES[wrong[0]]} hand on its topic; both topics hold a {other} hand",
            **facts,
        )
    if crossed or (crossed is None and mirrored):
        ctx.fail(
            "left and right hand are swapped" if len(wrong) > 1 else _other(wrong[0]),
            hint="set `swap: true`, or `mirror` to the axis across the picture if a webcam's picture was mirrored",
            **facts,
        )
    ctx.fail(
        "the hands are mirrored" if len(wrong) > 1 else _other(wrong[0]),
        hint="set `mirror: z` for a recording in left-handed axes such as Unity's, or the axis that is reversed"
        + ("" if crossed is False else "; `swap: true` if the sides are exchanged"),
        **facts,
    )


def _other(hand: int) -> str:
    return f"the {hands.SIDES[hand]} hand is a {hands.SIDES[1 - hand]} one"


def _crossed(stream: HandStream) -> bool | None:
    """Whether the left hand is on average to the right of the right one, as the head sees it; None: not known."""
    if stream.head is None:
        return None
    right = quaternions.to_matrices(stream.head[:, 3:].astype(np.float64))[:, :, 0]
    apart = stream.positions[:, 1, hands.WRIST] - stream.positions[:, 0, hands.WRIST]
    across = (right * apart).sum(axis=1)
    return bool(np.nanmean(across) < 0) if np.isfinite(across).any() else None
