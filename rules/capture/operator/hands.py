"""capture.hands: an operator's hands from a recording, checked before a robot follows them."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field, PositiveFloat

from dextera_build.artifacts.robots.hand_stream import LOST, HandStream
from dextera_build.artifacts.robots.stream import Stream
from dextera_build.formats import hand_stream
from dextera_build.geometry import hands as human
from dextera_build.previews.hands import strip
from dextera_build.rule import Context, Options, rule

from . import hand_doubts, hand_faults
from .axes import upright, with_sides_swapped, without_mirror


class HandsOptions(Options):
    """Options of capture.hands: how the recording is read, and what is doubted."""

    left: str = "/hands/left"
    """Topic of the left hand's joints."""
    right: str = "/hands/right"
    """Topic of the right hand's joints."""
    head: str = "/head"
    """Topic of the head's poses; empty: no head was recorded, so that hands move relative to where they began."""
    inputs: str = "/hands/input"
    """Topic of pinch, clutch and further inputs; without it, tracked hands move the robot."""
    unit_m: PositiveFloat = 1.0
    """Length of the recording's unit [m]."""
    up: Literal["z", "y"] = "z"
    """Axis of the recording's frame that points up: `y` for WebXR, which becomes z, with -z ahead becoming x."""
    mirror: Literal["none", "x", "y", "z"] = "none"
    """Axis of the recording's frame that is reversed, for recordings in left-handed axes."""
    swap: bool = False
    """Whether the topics of left and right are exchanged."""
    sides: Literal["any", "left", "right", "both"] = "any"
    """Hands that must be tracked at some time."""
    slowest_hz: PositiveFloat = 20.0
    """Lowest rate of messages that is not doubted [Hz]."""
    gap_s: PositiveFloat = 0.1
    """Longest time between messages that is not doubted [s]."""
    jump_m: PositiveFloat = 0.06
    """Longest way of a wrist from one message to the next that is not doubted [m]."""
    jump_deg: PositiveFloat = Field(25.0, le=180.0)
    """Largest turn of a wrist from one message to the next that is not doubted [deg]."""


@rule(version=1, packages=("numpy", "pillow", "mcap", "mcap-ros2-support"))
def hands(ctx: Context, stream: Stream, *, options: HandsOptions | None = None) -> HandStream:
    """Return the hands in a recording, in metres, in a frame with z up, with WebXR's 25 joints of each.

    Refused are lengths that are no hand's, sides that are swapped or mirrored, a frame in which the head does not stand
    upright, a missing head, hands that are never tracked, and what `formats.hand_stream` refuses: numbers that are not
    finite, another number of joints, several frames, a clock that goes back. Doubted are rate, gaps, jumps, bones that
    change their length, and axes of joints that are not WebXR's.
    """
    options = options or HandsOptions()
    topics = hand_stream.Topics(options.left, options.right, options.head, options.inputs)
    found, unused = hand_stream.read(stream, topics, unit_m=options.unit_m)
    hand_doubts.of_use(ctx, found, unused)
    if options.mirror != "none":
        found = without_mirror(found, options.mirror)
    if options.swap:
        found = with_sides_swapped(found)
    if options.up == "y":
        found = upright(found)
    hand_faults.check(ctx, found, options.sides, head=bool(options.head), mirrored=options.mirror != "none")
    hand_doubts.of_clock(ctx, found, options.slowest_hz, options.gap_s)
    hand_doubts.of_motion(ctx, found, options.jump_m, np.deg2rad(options.jump_deg))
    hand_doubts.of_shape(ctx, found)
    ctx.metric("rate", found.rate_hz, "Hz")
    for hand, side in enumerate(human.SIDES):
        ctx.metric(f"tracked_{side}", 100 * float((found.tracking[:, hand] > LOST).mean()), "%")
    ctx.preview(strip(found), "hands from behind and from the right")
    ctx.say(", ".join(found.facts()))
    return found
