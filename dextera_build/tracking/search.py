"""Recovery of a lost object: by the motion of its own points, and in the whole picture by colour and depth."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import cache

import numpy as np

from dextera_build.geometry import cameras, least_squares, lie, transforms
from dextera_build.geometry.registration import spread_rotations
from dextera_build.tracking import judge, terms
from dextera_build.tracking.camera_motion import Ways
from dextera_build.tracking.colours import Colours, bins
from dextera_build.tracking.frame import Frame
from dextera_build.tracking.model import Cast, Model, State

STEP = 8
"""Pixels per cell of the downsampled picture that is searched."""
PLACES = 5
"""Maximum number of positions in the picture that are tried."""
TURNS = 48
"""Number of orientations distributed over SO(3) that are tried at the best positions."""
_FOLLOWED = 40
_FEWEST = 6
_ROUNDS = 5


def textured(frame: Frame, cast: Cast) -> np.ndarray:
    """Pixels (N, 2) of a cast model with the largest brightness gradients, to be tracked by flow."""
    rows, columns = np.nonzero(cast.drawn)
    rows, columns = cast.rows[rows], cast.columns[columns]
    right, down = frame.slopes
    steep = np.abs(right[rows, columns]) + np.abs(down[rows, columns])
    chosen = np.argsort(-steep)[: 3 * _FOLLOWED : 3]
    chosen = chosen[steep[chosen] > 3.0]
    return np.stack([columns[chosen], rows[chosen]], axis=1).reshape(-1, 2)


def followed(model: Model, frame: Frame, start: State, cast: Cast, ways: Ways) -> State | None:
    """The state in which the points of an earlier cast are at their tracked pixels; None if there are too few."""
    cell = np.round((ways.before[:, ::-1] - [cast.rows[0], cast.columns[0]]) / cast.stride).astype(np.int64)
    size = np.array(cast.drawn.shape)
    inside = ((cell >= 0) & (cell < size)).all(axis=1)
    cell = cell.clip(0, size - 1)
    inside &= cast.drawn[cell[:, 0], cell[:, 1]]
    if inside.sum() < _FEWEST:
        return None
    cell, target = cell[inside], ways.after[inside]
    spots = terms.Spots.at(cast, np.ravel_multi_index((cell[:, 0], cell[:, 1]), cast.drawn.shape))
    # The tracked pixel is off the centre ray of its cell.
    beside = ways.before[inside] - np.stack([cast.columns[cell[:, 1]], cast.rows[cell[:, 0]]], axis=1)
    return _reprojected(model, frame, start, spots, target - beside)


def _reprojected(model: Model, frame: Frame, start: State, spots: terms.Spots, target: np.ndarray) -> State | None:
    known = least_squares.prior(np.append(np.full(3, 0.1), np.full(3 + len(model.joints), 0.5)))

    def step(now: State, _: int) -> tuple[np.ndarray, State] | None:
        placed = terms.Placed.of(model, now, spots)
        if placed.points[:, 2].min() < 0.05:
            return None
        off = target - cameras.project(placed.points, frame.k)
        length = np.linalg.norm(off, axis=1)
        weight = least_squares.huber(length, np.maximum(np.median(length), 1.5)) / 2.0**2
        rows = terms.image_motion(frame, placed).reshape(2 * len(off), -1)
        change = (least_squares.normal(rows, off.reshape(-1), np.repeat(weight, 2)) + known).solved()
        if np.linalg.norm(change[:3]) > 0.5 or np.linalg.norm(change[3:6]) > 1.5:
            return None
        return change, State(lie.retract(now.pose, change[:6]), model.limited(now.joints + change[6:]))

    found = list(least_squares.gauss_newton(start, step, range(_ROUNDS)))
    return found[-1] if len(found) == 1 + _ROUNDS else None


def places(
    model: Model, frame: Frame, colours: Colours, number: int, mask: np.ndarray | None, most: int = PLACES
) -> list[np.ndarray]:
    """Centres (3,) in the camera frame [m] of clusters of the object's colours, most likely first.

    Args:
        model: The object, for its size.
        frame: The current frame.
        colours: Colour model of the object and its surroundings.
        number: Number of the object, as in `Frame.owner`.
        mask: (H, W) bool, given mask of the object; None if there is none.
        most: Maximum number of centres.
    """
    import cv2

    half = slice(STEP // 2, None, STEP)
    z = frame.depth[half, half]
    others = frame.others(half, half, number)
    belief = 1.0 / (1.0 + np.exp(-colours.odds()[bins(frame.rgb[half, half])]))
    belief = np.where((z > 0) & ~others, np.square(belief), 0.0)
    if not belief.any():
        return []  # no depth at all, e.g. with a covered lens
    if mask is not None and mask[half, half].any():
        belief = belief * np.where(mask[half, half], 1.0, 0.02)
    points = frame.measured(*np.mgrid[STEP // 2 : frame.shape[0] : STEP, STEP // 2 : frame.shape[1] : STEP])
    # Of two equal clusters, the one with the object's size in the picture is preferred.
    wide = (
        int(np.clip(model.radius * frame.k[0, 0] / max(float(np.median(z[z > 0], axis=0)), 0.1) / STEP, 1, 15)) * 2 + 1
    )
    summed = cv2.blur(belief.astype(np.float32), (wide, wide))
    found = []
    for _ in range(most):
        row, column = np.unravel_index(int(summed.argmax()), summed.shape)
        if summed[row, column] < 0.03:
            break
        found.append(_centre(model, points, belief, int(row), int(column), wide))
        near = np.hypot(*(np.indices(summed.shape) - np.array([row, column])[:, None, None])) < 0.6 * wide
        summed[near] = 0.0
    return [place for place in found if place is not None]


def _centre(
    model: Model, points: np.ndarray, belief: np.ndarray, row: int, column: int, wide: int
) -> np.ndarray | None:
    """Weighted mean of the points of a cluster, moved slightly behind the visible surface."""
    rows = slice(max(0, row - wide // 2), row + wide // 2 + 1)
    columns = slice(max(0, column - wide // 2), column + wide // 2 + 1)
    weight, near = belief[rows, columns].reshape(-1), points[rows, columns].reshape(-1, 3)
    if weight.sum() <= 0:
        return None
    order = np.argsort(near[:, 2])
    total = np.cumsum(weight[order])
    middle = near[order[int(np.searchsorted(total, total[-1] / 2))]]
    weight = weight * (np.abs(near[:, 2] - middle[2]) < 1.5 * model.radius)
    at = (near * weight[:, None]).sum(axis=0) / max(weight.sum(), 1e-9)
    return np.asarray(at + 0.3 * model.radius * at / np.linalg.norm(at))


def hypotheses(model: Model, at: Sequence[np.ndarray], turns: Sequence[np.ndarray], joints: np.ndarray) -> list[State]:
    """The object with its centre at each position (3,), in each orientation (3, 3)."""
    return [State(transforms.rigid(turn, place - turn @ model.centre), joints) for place in at for turn in turns]


def around(place: np.ndarray) -> list[np.ndarray]:
    """Positions (3,) on a grid around one: 3 cm apart across, 5 cm along the line of sight."""
    ahead = place / np.linalg.norm(place)
    right = np.cross([0.0, 1.0, 0.0], ahead)
    right /= np.linalg.norm(right)
    down = np.cross(ahead, right)
    steps = (-0.06, -0.03, 0.0, 0.03, 0.06)
    return [place + x * right + y * down + z * ahead for z in (-0.05, 0.0, 0.05) for y in steps for x in steps]


@cache
def spread(count: int = TURNS) -> list[np.ndarray]:
    """Uniformly distributed orientations (3, 3)."""
    return list(spread_rotations(count))


def best(
    model: Model, frame: Frame, states: Iterable[State], colours: Colours, number: int, most: int
) -> Iterator[State]:
    """The states that agree best with the frame, by coarse renders."""
    scored = [(judge.look(model, frame, state, colours, number, rays=150)[0].score, state) for state in states]
    yield from (state for _, state in sorted(scored, key=lambda each: -each[0])[:most])
