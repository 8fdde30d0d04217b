"""Diagnosis of an inconsistent calibration: known mistakes are undone in the data, and the one that fits is named."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Literal, NoReturn, TypeAlias

import numpy as np
from scipy.spatial.transform import Rotation

from dextera_build.errors import listing
from dextera_build.geometry import hand_eye, hand_eye_checks, hand_eye_refine, lie, transforms
from dextera_build.geometry.hand_eye import Setup, View
from dextera_build.geometry.hand_eye_checks import Checked
from dextera_build.rule import Context

from . import congruent, residuals
from .sighting import Sighting

if TYPE_CHECKING:
    from .hand_eye import HandEyeOptions

BETTER = 4.0
"""Factor by which undoing a mistake must reduce the residual for the mistake to be reported."""
LESS = 2.0
"""The same factor, if the calibration without the mistake is one that would be accepted."""
EXPLAINED_PX = 10.0
"""Greatest residual that is left then [px]; a correction that leaves more does not explain the pictures."""
CERTAIN_PX = 1.0
"""A correction that leaves no more [px] explains the pictures as well as any can, so no further one is tried."""
LEAST_VIEWS = 4
"""Fewer views are explained by chance."""
IN_DEGREES, UNIT = (
    "rotation vectors in radians were read as degrees",
    "give rotations in the unit that the field states",
)
"""A mistake after which nothing seems to turn, and its remedy."""
Euler: TypeAlias = Literal["xyz", "XYZ", "zyx", "ZYX"]
EULER: tuple[Euler, ...] = ("xyz", "XYZ", "zyx", "ZYX")
"""Common orders of Euler angles about fixed axes (small letters) and about those of the body."""


def explain(ctx: Context, views: list[View], setup: Setup, found: Checked, common: HandEyeOptions) -> NoReturn:
    """Raise for an inconsistent calibration, with the mistake that explains it, if one does.

    The corners of `views` still have every order that the pattern permits: which one fits depends on the poses.

    Raises:
        RuleError: Always.
    """
    each = {view.name: hand_eye_refine.closing(view, setup, found.refined.solution) for view in found.views}
    distance, angle = np.sqrt((np.array(list(each.values())) ** 2).mean(axis=0))
    plain = _misfit(views, setup)
    tried: dict[str, tuple[float, str]] = {}
    best, named = None, False
    for text, changed, other, hint in _mistakes(views, setup):
        tried[text] = _misfit(changed, other), hint
        if best is None or tried[text][0] < tried[best][0]:
            best, named = text, _explains(tried[text][0], plain, changed, other, common)
        if tried[text][0] < min(plain / BETTER, CERTAIN_PX):
            break
    worst = sorted(each, key=lambda name: -each[name][0])[:4]
    ctx.fail(
        "the robot's poses and the pictures contradict each other" + (f": {best}" if named else ""),
        residual=f"{1000 * distance:.1f} mm, {np.degrees(angle):.1f} deg root mean square, "
        f"{1000 * common.most_residual_m:.0f} mm and {common.most_residual_deg:g} deg are allowed",
        worst=", ".join(f"`{name}` {1000 * each[name][0]:.0f} mm" for name in worst),
        **({"then": f"{tried[best][0]:.1f} px instead of {plain:.1f} px"} if best is not None and named else {}),
        hint=tried[best][1]
        if best is not None and named
        else "look at the names and order of the joints, at the units, and whether picture and pose are of one moment",
    )


def too_small(views: list[View], setup: Setup) -> bool:
    """Whether the rotations are those of rotation vectors in radians that were read as degrees."""
    return _misfit(_enlarged(views), setup) < EXPLAINED_PX


def other_size(ctx: Context, views: list[View], size: float, sigma: float) -> NoReturn:
    """Raise for a board whose size contradicts the robot's motion.

    Raises:
        RuleError: Always.
    """
    ctx.fail(
        f"the board is {size:.3f} times as large as stated, by the robot's motion",
        sigma=f"{sigma:.3f}",
        pictures=len(views),
        hint="measure a square or marker with a ruler and correct the board; if it is right, look at the focal length, "
        "or raise `board_size_fraction`",
    )


def other_board(ctx: Context, other: Mapping[str, Sighting], common: HandEyeOptions) -> NoReturn:
    """Raise for corners that are on no board of the stated layout.

    Raises:
        RuleError: Always.
    """
    mirrored = sum(one.mirrored_px <= common.most_corner_px for one in other.values())
    ctx.fail(
        "the markers are numbered from right to left"
        if mirrored > len(other) / 2
        else "the detected board is not the stated one",
        pictures=listing(other),
        corners=f"{np.median([one.rms_px for one in other.values()]):.1f} px from those of the stated board, "
        f"{common.most_corner_px:g} px are allowed",
        hint="number the markers row by row from the upper left, or print the board again"
        if mirrored > len(other) / 2
        else "look at columns, rows, sizes and dictionary of the board",
    )


def _explains(left: float, plain: float, changed: list[View], setup: Setup, common: HandEyeOptions) -> bool:
    """Whether a correction that leaves `left` of `plain` [px] explains the pictures."""
    if left < min(plain / BETTER, EXPLAINED_PX):
        return True
    if left >= min(plain / LESS, EXPLAINED_PX):
        return False
    # Some mistakes change little: Euler angles near half a turn are nearly a rotation vector.
    start, settled = hand_eye.start(changed, setup)
    solution = hand_eye_refine.refine(settled, setup, start).solution
    found = hand_eye_checks.checked(settled, setup, solution, common.least_views, common.most_bad)
    return residuals.fits(found, setup, common)


def _misfit(views: list[View], setup: Setup) -> float:
    """Median over the views of the corners' root mean square distance [px], after a start and a refinement."""
    if len(views) < LEAST_VIEWS:
        return float("inf")
    try:
        start, settled = hand_eye.start(views, setup)
        solution = hand_eye_refine.refine(settled, setup, start).solution
    except (ValueError, np.linalg.LinAlgError):
        return float("inf")
    offs = [np.sqrt((hand_eye.offsets(solution, view, setup) ** 2).sum(axis=1).mean()) for view in settled]
    return float(np.median(offs))


def _mistakes(views: list[View], setup: Setup) -> Iterator[tuple[str, list[View], Setup, str]]:
    """Each possible mistake, the views and the setup without it, and the remedy."""
    inverse = [replace(view, effector=transforms.invert(view.effector)) for view in views]
    # The equations are the same, so no picture tells one from the other.
    side = "next to the robot" if setup.in_hand else "on the hand"
    yield (
        f"the stated poses are those of the base in the effector, or the camera is {side}",
        inverse,
        setup,
        "write T_base_effector, which maps the effector's coordinates to the base's, or correct the `setup` of the "
        "capture",
    )
    for way, text in ((1, "one picture later"), (-1, "one picture earlier")):
        order = np.arange(len(views))[max(0, way) : len(views) + min(0, way)]
        moved = [replace(views[i], effector=views[i - way].effector) for i in order]
        yield f"each picture has the pose of {text}", moved, setup, "pair pictures and poses by their times"
    yield (
        "the positions are in millimetres",
        [replace(view, effector=_scaled(view.effector, 1e-3)) for view in views],
        setup,
        "divide the positions by 1000",
    )
    yield IN_DEGREES, _enlarged(views), setup, UNIT
    for euler in EULER:
        axes = f"{'fixed' if euler.islower() else 'moving'} axes {euler.lower()}"
        yield (
            f"rotations that are Euler angles about {axes} were read as rotation vectors",
            congruent.chosen(views, setup, [_of_euler(view.effector, euler) for view in views]),
            setup,
            "write the rotation as a rotation vector or a quaternion",
        )
        yield (
            f"rotation vectors were read as Euler angles about {axes}",
            congruent.chosen(views, setup, [_as_vectors(view.effector, euler) for view in views]),
            setup,
            "give rotations in the form that the field states",
        )
    yield (
        "quaternions are in the order x y z w",
        [replace(view, effector=_reordered(view.effector)) for view in views],
        setup,
        "write quaternions in the order w x y z",
    )


def _scaled(motion: np.ndarray, factor: float) -> np.ndarray:
    return transforms.rigid(motion[:3, :3], factor * motion[:3, 3])


def _enlarged(views: list[View]) -> list[View]:
    """The views with rotation vectors that were read as degrees, in radians."""
    turns = [lie.rotation(np.degrees(lie.rotation_vector(view.effector[:3, :3]))) for view in views]
    return [
        replace(view, effector=transforms.rigid(turn, view.effector[:3, 3]))
        for view, turn in zip(views, turns, strict=True)
    ]


def _of_euler(motion: np.ndarray, order: Euler) -> list[np.ndarray]:
    """Rotations whose Euler angles may have been read as the rotation vector of `motion`; the shorter vector first."""
    vector = lie.rotation_vector(motion[:3, :3])
    length = float(np.linalg.norm(vector))
    # Angles may be longer together than half a turn: read as a vector, they are the same rotation the other way about.
    both = [vector, vector * (1 - 2 * np.pi / length)] if length > 1e-9 else [vector]
    able = [angles for angles in both if abs(angles[1]) <= np.pi / 2 and np.abs(angles).max() <= np.pi]
    return [np.asarray(Rotation.from_euler(order, angles).as_matrix()) for angles in able or both[:1]]


def _as_vectors(motion: np.ndarray, order: Euler) -> list[np.ndarray]:
    """Rotations whose rotation vector may have been read as the Euler angles of `motion`."""
    first, middle, last = Rotation.from_matrix(motion[:3, :3]).as_euler(order)
    other = np.array([first + np.pi, np.pi - middle, last + np.pi])  # the same rotation
    both = np.array([first, middle, last]), (other + np.pi) % (2 * np.pi) - np.pi
    able = [vector for vector in both if np.linalg.norm(vector) <= np.pi]  # no rotation vector is longer
    return [lie.rotation(vector) for vector in able or both[:1]]


def _reordered(motion: np.ndarray) -> np.ndarray:
    from dextera_build.geometry import quaternions

    w, x, y, z = quaternions.from_matrix(motion[:3, :3])
    return transforms.rigid(quaternions.to_matrix(np.array([z, w, x, y])), motion[:3, 3])
