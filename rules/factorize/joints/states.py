"""Parts of an object seen in two states: the fixed part, and the parts that moved relative to it.

The largest surface that a motion on the support registers to the second sight is the fixed part. The remaining points
are registered to the remaining points there, part by part, and each motion is decomposed into a rotation about a line
or a translation.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dextera_build.geometry import lie, transforms

from . import portions
from .clouds import Sight
from .matching import Target, laid, narrow
from .moved import Open, doubt, moved
from .screw import Screw, fit
from .standing import settled, standing


@dataclass(frozen=True)
class States:
    """An object in two states."""

    labels: np.ndarray  # (N,) part of each seen point: 0 fixed, 1.. moved
    screws: tuple[Screw, ...]  # of parts 1.., in the frame of the first sight; `amount` leads to the second state
    stayed: np.ndarray  # (4, 4) motion of part 0 from the first world to the second
    doubts: tuple[str, ...]  # reason for rejecting the joint of a part; empty if it is accepted


def find(first: Sight, second: Sight) -> States | None:
    """Find the parts of `first`, an object, that moved before `second` was captured.

    Args:
        first: The object in the first state.
        second: The second state in its own world: the object, or everything on the support.

    Returns:
        The parts; None if nothing moved.
    """
    target = Target(second)
    stayed = standing(first, target)
    alone = portions.part(first, _labels(first, target, [stayed]), 0)
    if len(alone.inner) > portions.LEAST_POINTS:
        stayed = settled(alone, target, stayed)
    here = first.moved(stayed)
    motions = [np.eye(4)]
    for _ in range(4):
        labels = _labels(here, target, motions)
        found = moved(here, labels, motions, Open.of(first, second, stayed))
        if found is None:
            break
        motions.append(found)
        stayed, motions = _again(first, here, target, motions, stayed)
        here = first.moved(stayed)
    if len(motions) == 1:
        return None
    labels = portions.filled(here, _sole(here, target, motions))
    large = [k for k in range(1, len(motions)) if (labels == k).sum() > portions.LEAST_POINTS]
    if len(large) < len(motions) - 1:
        # Another motion explains this candidate part.
        motions = [motions[0], *(motions[k] for k in large)]
        labels = portions.filled(here, _sole(here, target, motions))
    screws, doubts = [], []
    for number, motion in enumerate(motions[1:], start=1):
        mine = portions.part(here, labels, number)
        if len(mine.inner) < portions.LEAST_POINTS:
            return None
        screw = fit(mine, target, motion, stayed[:3, 2])
        if screw is None:
            return None
        doubts.append(doubt(mine, portions.part(here, labels, 0), target, screw))
        screws.append(_carried(screw, transforms.invert(stayed)))
    return States(labels, tuple(screws), stayed, tuple(doubts)) if screws else None


def _labels(here: Sight, target: Target, motions: list[np.ndarray]) -> np.ndarray:
    """(N,) number of the first motion that maps a point onto the target; -1 for none."""
    labels = np.full(len(here.inner), -1)
    for number, motion in reversed(list(enumerate(motions))):
        labels[target.explained(here.inner.moved(motion), 2.5 * here.sigma)] = number
    return labels


def _sole(here: Sight, target: Target, motions: list[np.ndarray]) -> np.ndarray:
    """(N,) number of the only motion that maps a point onto the target; -1 for none or several."""
    laid_on = np.stack([target.explained(here.inner.moved(motion), 2.5 * here.sigma) for motion in motions])
    return np.where(laid_on.sum(axis=0) == 1, laid_on.argmax(axis=0), -1)


def _again(
    first: Sight, here: Sight, target: Target, motions: list[np.ndarray], stayed: np.ndarray
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Refine all motions, each from the points of its own part alone."""
    labels = portions.filled(here, _labels(here, target, motions))
    gates = narrow(first.sigma)
    own = [portions.part(here, labels, number) for number in range(len(motions))]
    again = [
        laid(motion, part, target, gates, lie.RIGID) if len(part.inner) > portions.LEAST_POINTS else motion
        for motion, part in zip(motions, own, strict=True)
    ]
    if len(own[0].inner) > portions.LEAST_POINTS:
        # The borders of moved parts may have biased the motion of the whole object.
        again[0] = settled(own[0], target, again[0])
    back = transforms.invert(again[0])
    return again[0] @ stayed, [np.eye(4), *(motion @ back for motion in again[1:])]


def _carried(screw: Screw, motion: np.ndarray) -> Screw:
    return replace(screw, origin=transforms.apply(motion, screw.origin), axis=motion[:3, :3] @ screw.axis)
