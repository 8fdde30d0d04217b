"""Bodies standing on the support whose size and place follow from the outline of a mask alone, without depth.

A camera whose pose over the support is known sees where a standing body touches it; this gives the distance, and with
it the width and the height (Criminisi, Reid, Zisserman: Single view metrology, IJCV 2000).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dextera_build.geometry import cameras, transforms
from dextera_build.geometry.solids import Solid

from .evidence import Evidence
from .families import box, lofted
from .families.profile import ROUND_M, Layout
from .hypotheses import Candidate, lofted_candidate, standing_box, upright_cylinder
from .refine import Model

TURNS = np.deg2rad(np.arange(0.0, 90.0, 10.0))
"""Rotations about the vertical of the initial guesses of a box [rad]."""
ASPECTS = (0.35, 0.6, 1.0, 1.7)
"""Depth over width of the initial guesses of a box."""
TAPERS = (1.0, 0.7, 0.4)
"""Lower over upper radius of the initial guesses of a round body."""
KNOTS = 7
"""Number of radii of a revolved profile; `Layout.finer` doubles it."""
MITRE = 0.01
"""Complexity of a box beside round bodies, as much as that of a profile."""
_HIDDEN = 0.1
"""Weight of a side of the mask at which something nearer may hide the body."""


@dataclass(frozen=True)
class Frame:
    """The upright rectangle around a mask, and where its lowest point is if it touches the support."""

    sides: np.ndarray  # (4,) left, top, right, bottom [px]
    weights: np.ndarray  # (4,) low for a side where the body may be hidden
    foot: np.ndarray  # (2,) [m]
    width: float  # of the rectangle at the foot's distance [m]
    facing: float  # yaw of a body whose x axis is across the view [rad]


def frame(evidence: Evidence) -> Frame | None:
    """The frame of the mask; None if its lowest point is not in front of the support."""
    rows, columns = np.nonzero(evidence.mask)
    sides = np.array([columns.min() - 0.5, rows.min() - 0.5, columns.max() + 0.5, rows.max() + 0.5])
    pixel = np.array([float(np.median(columns[rows == rows.max()])), sides[3], 1.0])
    ray = evidence.world_from_camera[:3, :3] @ np.linalg.solve(evidence.k, pixel)
    if ray[2] > -1e-3:
        return None
    distance = float(-evidence.eye[2] / ray[2])
    foot = (evidence.eye + distance * ray)[:2]
    towards = foot - evidence.eye[:2]
    width = float(sides[2] - sides[0]) * distance / evidence.k[0, 0]
    facing = float(np.arctan2(-towards[0], towards[1]))
    return Frame(sides, _weights(evidence, sides), foot, width, facing)


def symmetric(evidence: Evidence, seen: Frame) -> np.ndarray:
    """The part (H, W) bool of the mask that is symmetric about the image of a vertical line: without a handle.

    Of all lines the one with the largest such part is taken.
    """
    import cv2

    camera_from_world = transforms.invert(evidence.world_from_camera)
    line = np.array([[*seen.foot, 0.0], [*seen.foot, seen.width]])
    (x, y), top = cameras.project(transforms.apply(camera_from_world, line), evidence.k)
    turn = 2.0 * float(np.arctan2(top[1] - y, top[0] - x))
    mirror = np.array([[np.cos(turn), np.sin(turn)], [np.sin(turn), -np.cos(turn)]])
    mask = evidence.mask.astype(np.uint8)
    best, reach = evidence.mask & False, 0.35 * (seen.sides[2] - seen.sides[0])
    for shift in np.linspace(-reach, reach, 71):
        through = np.array([(seen.sides[0] + seen.sides[2]) / 2.0 + shift, y])
        move = np.column_stack([mirror, through - mirror @ through])
        part = evidence.mask & (cv2.warpAffine(mask, move, mask.shape[::-1]) > 0)
        if part.sum() > best.sum():
            best = part
    return best


def candidates(evidence: Evidence, seen: Frame, wall_m: float, *, hollow: bool) -> list[Candidate]:
    """A box, a cylinder and a revolved body; for a vessel, only a revolved body with a cavity.

    Args:
        evidence: The view, without depth.
        seen: The frame of its mask.
        wall_m: Wall thickness of a vessel [m].
        hollow: Whether it is a vessel.
    """
    cones = [_cone(evidence, seen, taper) for taper in TAPERS]
    layout = Layout(knots=KNOTS, hollow=hollow)
    profiles = [np.array([*cone[:3], *np.linspace(cone[3], cone[4], KNOTS)]) for cone in cones]
    profiles.append(np.array([*cones[0][:3], *_radii(evidence, cones[0][:4])]))
    walls = [*[wall_m] * (KNOTS + 1), ROUND_M] if hollow else []
    starts = [np.array([*profile, *walls]) for profile in profiles]
    name = "revolved_hollow" if hollow else "revolved"
    revolved = lofted_candidate(layout, lofted.model(layout, name, starts, wall_m), wall_m)
    if hollow:
        return [revolved]
    cylinder = upright_cylinder(lofted.upright_cylinder([cones[0][:4]]))
    return [standing_box(_box(evidence, seen)), cylinder, revolved]


def _weights(evidence: Evidence, sides: np.ndarray) -> np.ndarray:
    """Weight (4,) of the sides of the mask's rectangle."""
    height, width = evidence.mask.shape
    left, top, right, bottom = np.round(sides + np.array([-2, -2, 2, 2])).astype(int)
    hidden = (
        left < 0 or not evidence.known[:, left].all(),
        top < 0 or not evidence.known[top].all(),
        right >= width or not evidence.known[:, right].all(),
        bottom >= height or not evidence.known[bottom].all(),
    )
    return np.where(hidden, _HIDDEN, 1.0)


def _box(evidence: Evidence, seen: Frame) -> Model:
    def framed(turn: float, aspect: float) -> np.ndarray:
        def parameters(four: np.ndarray) -> np.ndarray:
            x, y, width, height = four
            return np.array([x, y, seen.facing + turn, width, aspect * width, height])

        return _framed(evidence, seen, box.box_solid, parameters)

    return Model(
        name="box",
        build=box.box_solid,
        starts=[framed(turn, aspect) for turn in TURNS for aspect in ASPECTS],
        steps=np.array([0.003, 0.003, 0.02, 0.003, 0.003, 0.003]),
        lower=np.array([-np.inf] * 3 + [box.SMALLEST_M] * 3),
        upper=np.array([np.inf] * 3 + [box.LARGEST_M] * 3),
        cost=MITRE,
    )


def _cone(evidence: Evidence, seen: Frame, taper: float) -> np.ndarray:
    """x, y, height, lower and upper radius of the truncated cone with the frame of the mask."""

    def parameters(four: np.ndarray) -> np.ndarray:
        x, y, width, height = four
        return np.array([x, y, height, taper * width / 2, width / 2])

    return _framed(evidence, seen, lofted.CYLINDER.build, parameters)


def _framed(
    evidence: Evidence,
    seen: Frame,
    build: Callable[[np.ndarray], Solid],
    parameters: Callable[[np.ndarray], np.ndarray],
) -> np.ndarray:
    """The parameters of the body whose projection has the frame of the mask.

    Args:
        evidence: The view.
        seen: The frame.
        build: Body in the world, of its parameters.
        parameters: Its parameters, of x, y, width and height [m].
    """
    from scipy import optimize

    camera_from_world = transforms.invert(evidence.world_from_camera)
    unit = float((seen.sides[2:] - seen.sides[:2]).max())

    def four(free: np.ndarray) -> np.ndarray:
        return np.array([*free[:2], *np.exp(free[2:])])

    def off(free: np.ndarray) -> np.ndarray:
        found = cameras.extent(build(parameters(four(free))).vertices, camera_from_world, evidence.k)
        return np.asarray(seen.weights * (found - seen.sides) / unit)

    away = np.array([-np.sin(seen.facing), np.cos(seen.facing)])
    begin = np.array([*(seen.foot + away * seen.width / 3), np.log(seen.width), np.log(seen.width)])
    scale = np.array([seen.width, seen.width, 1.0, 1.0])
    found = optimize.least_squares(off, begin, x_scale=scale, loss="soft_l1", f_scale=0.1, max_nfev=60)
    return parameters(np.clip(four(found.x), None, [np.inf, np.inf, box.LARGEST_M, box.LARGEST_M]))


def _radii(evidence: Evidence, cylinder: np.ndarray) -> np.ndarray:
    """Half the width of the mask in the rows of the cylinder's axis, from the base up (KNOTS,) [m]."""
    x, y, height, radius = cylinder
    camera_from_world = transforms.invert(evidence.world_from_camera)
    found = []
    for level in np.linspace(0.0, height, KNOTS):
        point = transforms.apply(camera_from_world, np.array([[x, y, level]]))[0]
        row = round(float(evidence.k[1, 1] * point[1] / point[2] + evidence.k[1, 2]))
        columns = np.flatnonzero(evidence.mask[np.clip(row, 0, len(evidence.mask) - 1)])
        seen = float(np.ptp(columns)) + 1.0 if len(columns) else 0.0
        found.append(np.clip(seen * point[2] / evidence.k[0, 0] / 2, 0.15 * radius, radius))
    return np.asarray(found)
