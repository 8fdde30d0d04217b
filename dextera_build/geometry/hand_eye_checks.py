"""What speaks for and against a hand-eye calibration: each view against all others, and the board's size.

A view is tested with the solution and the variances that the *other* views give, because a bad one widens its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dextera_build.geometry import transforms, variances
from dextera_build.geometry.hand_eye import Setup, Solution, View, offsets
from dextera_build.geometry.hand_eye_refine import PRIORS, Refined, block, moved, refine

SURE = 1e-3
"""A view is bad if one as far off would come up by chance in less than this fraction of calibrations."""
NOTABLE_PX = 2.0
"""Corners that are nearer to where the others have them, root mean square, are no mistake, however sure [px]."""


@dataclass(frozen=True)
class Left:
    """One view against the calibration from all others."""

    name: str
    chance: float  # of a view as far off as this one among all views, if nothing is wrong with it
    off_px: float  # root mean square distance of its corners from where the others have them
    shift_m: float  # distance by which X moves without it
    turn_rad: float  # rotation of X without it
    without: Refined


@dataclass(frozen=True)
class Checked:
    """A calibration, its views and those left out because they contradict the others."""

    refined: Refined
    views: list[View]
    left: list[Left]  # of `views`, in order
    bad: list[Left]  # in the order in which they were found


def checked(views: Sequence[View], setup: Setup, start: Solution, least: int = 3, most_bad: int = 3) -> Checked:
    """Refine, and leave out the view that contradicts the others most until none does.

    Args:
        views: At least three, with settled orders of corners.
        setup: What they share.
        start: See `hand_eye.start`.
        least: Views that must remain.
        most_bad: Views that may be left out.
    """
    kept, bad = list(views), list[Left]()
    refined = refine(kept, setup, start)
    while True:
        if len(kept) <= 3:
            return Checked(refined, kept, [], bad)
        left = [_without(kept, number, setup, refined) for number in range(len(kept))]
        worst = min(range(len(kept)), key=lambda number: left[number].chance)
        fine = left[worst].chance >= SURE or left[worst].off_px < NOTABLE_PX
        if fine or len(kept) <= max(4, least) or len(bad) >= most_bad:
            return Checked(refined, kept, left, bad)
        bad.append(left[worst])
        refined = left[worst].without
        del kept[worst]


def _without(views: list[View], number: int, setup: Setup, whole: Refined) -> Left:
    from scipy.stats import f

    others = [view for index, view in enumerate(views) if index != number]
    found = refine(others, setup, whole.solution, whole.sigmas)
    one = block(views[number], setup, found.solution)
    spread = variances.block_covariance(one, PRIORS, found.sigmas) + one.design @ found.covariance @ one.design.T
    far = float(one.error @ np.linalg.solve(spread, one.error)) / len(one.error)
    chance = float(f.sf(far, len(one.error), max(6 * len(others) - 12, 1)))
    gap = transforms.invert(whole.solution.x) @ found.solution.x
    shift, turn = float(np.linalg.norm(gap[:3, 3])), transforms.angle(gap[:3, :3])
    off = float(np.sqrt((offsets(found.solution, views[number], setup) ** 2).sum(axis=1).mean()))
    return Left(views[number].name, min(1.0, chance * len(views)), off, shift, turn, found)


def board_scale(views: Sequence[View], setup: Setup, refined: Refined) -> tuple[float, float]:
    """How much larger the board is than stated, by the robot's motion, and the standard deviation of that factor.

    The picture alone does not tell a large board far away from a small one near by; the robot's way between two
    pictures does.
    """
    scale, now, sigmas, sigma = 1.0, refined.solution, refined.sigmas, np.inf
    for _ in range(10):
        sized = [View(v.name, v.effector, scale * v.board, v.pixels, v.candidates) for v in views]
        blocks = [block(view, setup, now, sized=True) for view in sized]
        # A wrong size looks like a bad robot until it is a parameter, so the variances are estimated again.
        fit = variances.fit(blocks, PRIORS, sigmas)
        now, sigmas, sigma = moved(now, fit.step[:12]), fit.sigmas, float(np.sqrt(fit.covariance[12, 12]))
        scale *= float(np.exp(np.clip(fit.step[12], -0.5, 0.5)))
        if abs(fit.step[12]) < 1e-4:
            break
    return scale, scale * sigma
