"""Consistency checks of a hand-eye calibration: each view against all others, and the board's size.

A view is tested with the solution and the variances of the *other* views, because an outlier inflates its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dextera_build.geometry import transforms, variances
from dextera_build.geometry.hand_eye import Setup, Solution, View, offsets
from dextera_build.geometry.hand_eye_refine import PRIORS, Refined, block, moved, refine

SURE = 1e-3
"""Significance level of an outlier: probability that a correct view is as far off, over all views of a calibration."""
NOTABLE_PX = 2.0
"""Root mean square distance of corners below which a view is no outlier, at any significance [px]."""


@dataclass(frozen=True)
class Left:
    """One view against the calibration from all others."""

    name: str
    chance: float  # of a view as far off as this one among all views, if all are correct
    off_px: float  # root mean square distance of its corners from the prediction of the others
    shift_m: float  # change of X's position without it
    turn_rad: float  # change of X's rotation without it
    without: Refined


@dataclass(frozen=True)
class Checked:
    """A calibration, its views, and the inconsistent views that were removed."""

    refined: Refined
    views: list[View]
    left: list[Left]  # of `views`, in order
    bad: list[Left]  # in the order of removal


def checked(views: Sequence[View], setup: Setup, start: Solution, least: int = 3, most_bad: int = 3) -> Checked:
    """Refine, and remove the most inconsistent view until all are consistent.

    Args:
        views: At least three, with resolved orders of corners.
        setup: Their shared properties.
        start: See `hand_eye.start`.
        least: Minimum number of remaining views.
        most_bad: Maximum number of removed views.
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
    """Ratio of the board's size, by the robot's motion, to the stated one, with its standard deviation.

    A picture alone cannot distinguish a large distant board from a small near one; the robot's motion between pictures
    can.
    """
    scale, now, sigmas, sigma = 1.0, refined.solution, refined.sigmas, np.inf
    for _ in range(10):
        sized = [View(v.name, v.effector, scale * v.board, v.pixels, v.candidates) for v in views]
        blocks = [block(view, setup, now, sized=True) for view in sized]
        # A wrong size increases the residuals until it is a parameter, so the variances are estimated again.
        fit = variances.fit(blocks, PRIORS, sigmas)
        now, sigmas, sigma = moved(now, fit.step[:12]), fit.sigmas, float(np.sqrt(fit.covariance[12, 12]))
        scale *= float(np.exp(np.clip(fit.step[12], -0.5, 0.5)))
        if abs(fit.step[12]) < 1e-4:
            break
    return scale, scale * sigma
