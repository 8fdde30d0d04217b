"""Diagnosis of an inconsistent calibration: known mistakes are undone in the data, and the one that fits is named."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Literal, NoReturn, TypeAlias

import numpy as np
from scipy.spatial.transform import Rotation

from dextera_build.errors import listing
from dextera_build.geometry import hand_eye, hand_eye_refine, lie, transforms
from dextera_build.geometry.hand_eye import Setup, View
from dextera_build.geometry.hand_eye_checks import Checked
from dextera_build.rule import Context

from .sighting import Sighting

if TYPE_CHECKING:
    from .hand_eye import HandEyeOptions

BETTER = 4.0
"""Factor by which undoing a mistake must reduce the residual for the mistake to be reported."""
EXPLAINED_PX = 10.0
"""Greatest residual that is left then [px]; a correction that leaves more does not explain the pictures."""
CERTAIN_PX = 1.0
"""A correction that leaves no more [px] explains the pictures as well as any can, so no further one is tried."""
LEAST_VIEWS = 4
"""Fewer views are explained by chance."""
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
    for text, changed, other, hint in _mistakes(views, setup):
        tried[text] = _misfit(changed, other), hint
        if tried[text][0] < min(plain / BETTER, CERTAIN_PX):
            break
    best = min(tried, key=lambda text: tried[text][0], default=None)
    named = best is not None and tried[best][0] < min(plain / BETTER, EXPLAINED_PX)
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
    yield (
        "the stated poses are those of the base in the effector",
        inverse,
        setup,
        "write T_base_effector, which maps the effector's coordinates to the base's",
    )
    yield (
        "the camera is " + ("next to the robot" if setup.in_hand else "on the hand"),
        views,
        replace(setup, in_hand=not setup.in_hand),
        "correct the `setup` of the capture",
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
    yield (
        "rotation vectors in radians were read as degrees",
        [replace(view, effector=_turned(view.effector, 180 / np.pi)) for view in views],
        setup,
        "give rotations in the unit that the field states",
    )
    for euler in EULER:
        axes = f"{'fixed' if euler.islower() else 'moving'} axes {euler.lower()}"
        yield (
            f"rotations that are Euler angles about {axes} were read as rotation vectors",
            [replace(view, effector=_of_euler(view.effector, euler)) for view in views],
            setup,
            "write the rotation as a rotation vector or a quaternion",
        )
        yield (
            f"rotation vectors were read as Euler angles about {axes}",
            _as_vectors(views, euler),
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


def _turned(motion: np.ndarray, factor: float) -> np.ndarray:
    vector = lie.rotation_vector(motion[:3, :3])
    return transforms.rigid(lie.rotation(factor * vector), motion[:3, 3])


def _of_euler(motion: np.ndarray, order: Euler) -> np.ndarray:
    angles = lie.rotation_vector(motion[:3, :3])
    return transforms.rigid(Rotation.from_euler(order, angles).as_matrix(), motion[:3, 3])


def _as_vectors(views: list[View], order: Euler) -> list[View]:
    """The views with rotation vectors that were read as Euler angles; those that two vectors explain are left out."""
    found = []
    for view in views:
        first, middle, last = Rotation.from_matrix(view.effector[:3, :3]).as_euler(order)
        other = np.array([first + np.pi, np.pi - middle, last + np.pi])  # the same rotation
        both = np.array([first, middle, last]), (other + np.pi) % (2 * np.pi) - np.pi
        able = [vector for vector in both if np.linalg.norm(vector) <= np.pi]  # no rotation vector is longer
        if len(able) == 1:
            motion = transforms.rigid(lie.rotation(able[0]), view.effector[:3, 3])
            found.append(replace(view, effector=motion))
    return found


def _reordered(motion: np.ndarray) -> np.ndarray:
    from dextera_build.geometry import quaternions

    w, x, y, z = quaternions.from_matrix(motion[:3, :3])
    return transforms.rigid(quaternions.to_matrix(np.array([z, w, x, y])), motion[:3, 3])
