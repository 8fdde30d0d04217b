"""Which flat surface carries the objects: by what stands on it, gravity or upright lines, height and extent."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from dextera_build.geometry import upright

from .loads import PARALLEL
from .surfaces import Surface

CLEARLY = 0.25
"""A picture is rotated if its upright support has less than this fraction of the weight of a rotated one. In 21 real
photographs, rotated by quarter turns, the true side had at least 20 times the weight of any other."""
CARRIES = 0.003
"""Least pixels of things on a surface that carries some, relative to its own."""
EMPTY = 0.25
"""Weight of a surface on which nothing stands, relative to one that carries something."""
LEVEL = np.cos(np.radians(12.0))
"""Cosine of the largest angle between the normal of a support and the known direction up."""
UNLIKELY = 0.5
"""Weight of a surface that is not level by upright lines, which are wrong in a picture that is turned."""
SQUARE = np.sin(np.radians(10.0))
"""Largest cosine of the angle between a wall and a support."""
UPRIGHT = 0.8
"""Least part of a support's normal that points up in the picture, if a wall is to be told from it."""
WALL = 0.1
"""Weight of a surface seen frontally that is square to one that points up and carries something."""
DOUBTED = 0.5
"""Weight and pixels of things, relative to those of the chosen surface, from which another one may be the support."""
APART_M = 0.03
"""Parallel surfaces whose planes are nearer than this are no alternatives [m]."""
HIGHER_M = 0.3
"""A table is at least this far above the floor beside it [m]."""


def choose(
    found: Sequence[Surface],
    smallest_m2: float,
    turns: int = 0,
    up: np.ndarray | None = None,
    likely: np.ndarray | None = None,
) -> Surface | None:
    """Choose the surface that carries the objects: large in the image, facing up, not the floor below a table.

    Args:
        found: Surfaces in the frame of the camera.
        smallest_m2: Minimum area [m^2].
        turns: Counter-clockwise quarter turns that make the picture upright.
        up: (3,) unit, the known direction up in the frame of the camera; None if unknown.
        likely: (3,) unit, the same by upright lines, which may be wrong; None if they do not tell it.
    """
    fit = _fit(found, smallest_m2, turns, up)
    if not fit:
        return None
    score = partial(weight, found=found, turns=turns, up=up, likely=likely)
    best = max(fit, key=score)
    # The camera is lower above a table than above the floor visible next to it.
    tables = [s for s in fit if best.plane[1] - s.plane[1] > HIGHER_M and score(s) > 0.2 * score(best)]
    parallel = [s for s in tables if abs(float(best.plane[0] @ s.plane[0])) > PARALLEL]
    return max(parallel, key=score, default=best)


def rival(
    found: Sequence[Surface],
    best: Surface,
    smallest_m2: float,
    turns: int = 0,
    up: np.ndarray | None = None,
    likely: np.ndarray | None = None,
) -> Surface | None:
    """Another surface that may be the support, because it carries things, too, and is about as large; None if none is.

    The arguments are those of `choose`, and `best` is its result.
    """
    score = partial(weight, found=found, turns=turns, up=up, likely=likely)
    others = [s for s in _fit(found, smallest_m2, turns, up) if _differs(s, best) and s.carried >= CARRIES]
    others = [s for s in others if score(s) > DOUBTED * score(best) and _load(s) > DOUBTED * _load(best)]
    return max(others, key=score, default=None)


def quarter_turns(found: Sequence[Surface], smallest_m2: float, up: np.ndarray | None = None) -> int:
    """Counter-clockwise quarter turns after which the picture shows a support as an upright camera would.

    A wall next to a table cannot be distinguished from a table seen by a rotated camera, so the picture counts as
    upright unless a rotated one shows a support with four times the weight. The weight increases with the size in the
    picture and with proximity, since walls and floors are farther from the camera than the table it is pointed at.
    """
    weights = []
    for turns in range(4):
        surface = choose(found, smallest_m2, turns, up)
        weights.append(0.0 if surface is None else weight(surface, found, turns, up) / surface.plane[1] ** 2)
    return int(np.argmax(weights)) if weights[0] < CLEARLY * max(weights) else 0


def weight(
    surface: Surface,
    found: Sequence[Surface],
    turns: int = 0,
    up: np.ndarray | None = None,
    likely: np.ndarray | None = None,
) -> float:
    """Evidence that a surface is the support; see `choose`."""
    seen = float(surface.region.sum()) * max(0.0, 1.0 - 5.0 * surface.below)
    seen *= 1.0 if surface.carried >= CARRIES else EMPTY
    seen *= UNLIKELY if likely is not None and float(surface.plane[0] @ likely) < LEVEL else 1.0
    walls = up is None and any(_is_wall(surface, other, turns) for other in found)
    return seen * _upness(surface, turns, up) * (WALL if walls else 1.0)


def _fit(found: Sequence[Surface], smallest_m2: float, turns: int, up: np.ndarray | None) -> list[Surface]:
    return [s for s in found if s.area_m2 >= smallest_m2 and _upness(s, turns, up) > 0]


def _upness(surface: Surface, turns: int, up: np.ndarray | None) -> float:
    """Weight of the normal: 1 if it points up in the image or at a camera above, 0 for walls and side faces."""
    normal = _upright(surface, turns)
    if up is not None and float(surface.plane[0] @ up) < LEVEL:
        return 0.0
    return float(np.clip((0.15 - normal[1]) / 0.3, 0.0, 1.0) * (abs(normal[0]) < 0.5 or abs(normal[0]) < -normal[1]))


def _is_wall(surface: Surface, other: Surface, turns: int) -> bool:
    """Whether a surface is seen frontally, and square to another one that points up and carries something.

    A camera straight above a table sees it frontally as well, but nothing stands on the side of a box.
    """
    square = abs(float(surface.plane[0] @ other.plane[0])) < SQUARE
    frontal = -_upright(surface, turns)[1] < SQUARE < UPRIGHT < -_upright(other, turns)[1]
    return square and frontal and other.carried >= CARRIES


def _upright(surface: Surface, turns: int) -> np.ndarray:
    return np.asarray(upright.turned_from_camera(turns)[:3, :3] @ surface.plane[0])


def _load(surface: Surface) -> float:
    return surface.carried * float(surface.region.sum())


def _differs(one: Surface, other: Surface) -> bool:
    parallel = float(one.plane[0] @ other.plane[0]) > PARALLEL
    return not parallel or abs(one.plane[1] - other.plane[1]) > APART_M
