"""Choice by colour among placements that explain mask and depth equally well."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dextera_build.artifacts.objects.object import Body
from dextera_build.artifacts.objects.view import Seen
from dextera_build.geometry import transforms
from dextera_build.geometry.registration import ScaledPose
from dextera_build.geometry.symmetry import Symmetry

from .model_view import ModelView

CLEARLY = 0.08
"""Difference of correlations at which colours decide."""
PLAIN = 0.03
"""Standard deviation of the rendered colours, 0..1, below which the asset has no pattern."""
APART = np.radians(12.0)
"""Rotation angle above which two placements differ."""


class Chosen(NamedTuple):
    """The placement, and alternatives that remain undecided."""

    best: ScaledPose
    rivals: int  # placements with another rotation that depth, mask and colours do not distinguish from it
    by_colour: bool


def choose(
    model: ModelView, body: Body, seen: Seen, best: ScaledPose, others: list[ScaledPose], symmetry: Symmetry
) -> Chosen:
    """Compare the colours of the best placement, its images under finite symmetries, and other equally good placements.

    Rotations that a symmetry of the shape maps to each other are not alternatives: only colour distinguishes them.
    """
    same = [_turned(best, turn, symmetry.centre) for turn in symmetry.turns()[1:24]]
    rivals = [one for one in others if _angle(symmetry, one, best) > APART]
    scores = [_likeness(model, body, seen, one) for one in (best, *same, *rivals)]
    if None in scores:
        return Chosen(best, len(rivals), by_colour=False)
    values = np.array(scores, np.float64)
    first = int(np.argmax(values))
    if not _beats(values[first], values[0]):
        first = 0
    others_left = [k for k in range(1 + len(same), len(values)) if k != first and not _beats(values[first], values[k])]
    return Chosen((best, *same, *rivals)[first], len(others_left), by_colour=first > 0)


def _beats(one: float, other: float) -> bool:
    """Whether a correlation is clearly better: by a fixed step, or by half of the unexplained part of the other."""
    return one > other + CLEARLY or 1.0 - one < 0.5 * (1.0 - other)


def _angle(symmetry: Symmetry, one: ScaledPose, other: ScaledPose) -> float:
    return symmetry.angle(one.pose[:3, :3], other.pose[:3, :3])


def _turned(placed: ScaledPose, turn: np.ndarray, centre: np.ndarray) -> ScaledPose:
    """The placement of the model turned about its centre."""
    about = transforms.rigid(turn, placed.scale * (centre - turn @ centre))
    return ScaledPose(placed.scale, placed.pose @ about)


def _likeness(model: ModelView, body: Body, seen: Seen, placed: ScaledPose) -> float | None:
    """Correlation of rendered and seen colours over common pixels, -1 to 1; None if the asset has no pattern there."""
    drawn, where = model.painted(placed, body)
    if where.sum() < 100:
        return None
    photo = model.thinned(seen.rgb).astype(np.float64) / 255.0
    one, other = (_smooth(picture, where) for picture in (drawn, photo))
    one, other = one - one.mean(axis=0), other - other.mean(axis=0)
    if one.std() < PLAIN:
        return None
    return float((one * other).sum() / max(np.sqrt((one**2).sum() * (other**2).sum()), 1e-12))


def _smooth(picture: np.ndarray, where: np.ndarray) -> np.ndarray:
    """Colours (N, 3) of the pixels `where`, averaged over neighbours in it, because borders are inexact by a pixel."""
    from scipy import ndimage  # a plan imports this module

    weight = ndimage.uniform_filter(where.astype(np.float64), 3)
    sums = ndimage.uniform_filter(np.where(where[..., None], picture, 0.0), (3, 3, 1))
    return np.asarray((sums / np.maximum(weight, 1e-9)[..., None])[where])
