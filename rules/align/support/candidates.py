"""The flat surfaces of a depth image that may be the support, and the chosen one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, NoReturn

import numpy as np

from dextera_build.artifacts.cameras.camera import Photograph
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.geometry import cameras, upright
from dextera_build.rule import Context

from . import choice, uprights
from .loads import loaded
from .support_options import SupportOptions
from .surfaces import Surface, find

SIDES = ("top", "right", "bottom", "left")
"""Side of the picture that is up, by the counter-clockwise quarter turns that make it upright."""
NEAR_PX = 20
"""Largest distance of a stated pixel from its surface [px]: holes in the depth, and things on it."""


@dataclass(frozen=True)
class Candidates:
    """Surfaces of the upright picture."""

    turns: int
    """Quarter turns that make the picture upright."""
    points: np.ndarray
    """(H, W, 3) of the upright picture, camera frame [m]."""
    best: Surface
    """The support."""
    likely: np.ndarray | None
    """Direction up (3,) by upright lines, in the camera frame; None if it is measured, or if they do not tell it."""
    rival: Surface | None
    """Another surface that may be the support; None if there is no doubt, or if the user stated it."""


class Up(NamedTuple):
    """The direction up."""

    direction: np.ndarray  # (3,) unit, in the camera frame
    measured: bool  # by an inertial sensor; otherwise a robot's base, which may stand askew


def known_up(photograph: Photograph, robot: Pose | None) -> Up | None:
    """The direction up by an inertial sensor, or the z axis of the robot's base, T_camera_base; None if unknown."""
    if photograph.gravity is not None:
        return Up(-np.array(photograph.gravity), measured=True)
    if robot is None or (robot.parent, robot.child) != ("camera", "base"):
        return None
    return Up(np.asarray(robot.matrix[:3, 2]), measured=False)


def likely_up(photograph: Photograph, options: SupportOptions) -> uprights.Uprights | None:
    """The direction up by upright lines, if the upper side of the picture may be up."""
    if options.up not in ("auto", "top"):
        return None
    return uprights.find(photograph.rgb.pixels, photograph.camera.matrix())


def of_depth(
    ctx: Context,
    photograph: Photograph,
    depth: np.ndarray,
    valid: np.ndarray,
    known: Up | None,
    options: SupportOptions,
) -> Candidates:
    """The support among the flat surfaces of a depth image.

    Args:
        ctx: The rule's context.
        photograph: The picture and its camera.
        depth: (H, W) [m].
        valid: (H, W) bool, pixels to use.
        known: See `known_up`; a robot that stands on none of the surfaces says nothing.
        options: The rule's options.

    Raises:
        RuleError: No surface can be the support, or none is at the stated pixel.
    """
    up = None if known is None else known.direction

    def look(count: int) -> tuple[list[Surface], np.ndarray]:
        points = cameras.backproject(upright.turned(depth, count), photograph.camera.turned(count).matrix())
        rng = np.random.default_rng(options.seed)
        seen = upright.turned(valid, count)
        return loaded(find(points, seen, options.surfaces, options.warp_m, rng), points, seen), points

    def turned_up(count: int) -> np.ndarray | None:
        return None if up is None else np.asarray(upright.turned_from_camera(count)[:3, :3] @ up)

    turns = 0 if options.up == "auto" else SIDES.index(options.up)
    found, points = look(turns)
    stands = known is None or known.measured or choice.choose(found, options.smallest_m2, up=turned_up(turns))
    up = up if stands else None
    lines = likely_up(photograph, options) if up is None and options.at_px is None else None
    likely = None if lines is None else lines.direction
    count = choice.quarter_turns(found, options.smallest_m2, turned_up(turns)) if options.up == "auto" else 0
    if count:
        again, seen = look(count)
        best_again = choice.choose(again, options.smallest_m2, up=turned_up(count))
        # A bare wall seen from slightly above resembles a bare table seen by an upside-down camera.
        if best_again is not None and best_again.carried >= choice.CARRIES:
            turns, found, points, likely = count, again, seen, None
    if options.at_px is not None:
        stated = _stated(ctx, [upright.turned(s.region, -turns) for s in found], found, options.at_px)
        return Candidates(turns, points, stated, None, None)
    best = choice.choose(found, options.smallest_m2, up=turned_up(turns), likely=likely)
    if best is None:
        _refuse(ctx, found, turned_up(turns), options)
    rival = choice.rival(found, best, options.smallest_m2, up=turned_up(turns), likely=likely)
    return Candidates(turns, points, best, likely, rival)


def _stated(ctx: Context, regions: list[np.ndarray], found: list[Surface], at: tuple[int, int]) -> Surface:
    """The surface nearest to a pixel (column, row) of the photograph."""
    distances = []
    for region in regions:
        rows, columns = np.nonzero(region)
        distances.append(float(np.hypot(columns - at[0], rows - at[1]).min()))
    nearest = int(np.argmin(distances)) if distances else -1
    if nearest < 0 or distances[nearest] > NEAR_PX:
        ctx.fail(
            "no flat surface is at the stated pixel of the support",
            at_px=f"[{at[0]}, {at[1]}]",
            planes=_listing(found),
            hint="`at_px` is [column, row] of a pixel of the table, with depth around it",
        )
    return found[nearest]


def _refuse(ctx: Context, found: list[Surface], up: np.ndarray | None, options: SupportOptions) -> NoReturn:
    opposite = None if up is None else choice.choose(found, options.smallest_m2, up=-up)
    hint = "show more of the table, lower `smallest_m2`, or set `up` to the upper side of the picture"
    if opposite is not None:
        hint = "negate `gravity`: a surface faces the other way, and an accelerometer at rest reads the direction up"
    elif up is not None:
        hint = "check `gravity` or the robot's pose: no surface is level by it"
    ctx.fail(
        "no support plane is in view",
        planes=_listing(found),
        smallest=f"{options.smallest_m2:g} m^2, facing up",
        hint=hint,
    )


def _listing(found: list[Surface]) -> str:
    parts = [f"{s.area_m2:.3f} m^2 tilted {np.degrees(s.tilt_rad):.0f} deg" for s in found]
    return ", ".join(parts) if parts else "none"
