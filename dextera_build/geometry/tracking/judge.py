"""Whether a pose agrees with a frame: what is seen where the model is, before it and behind it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.geometry import planes
from dextera_build.geometry.tracking.colours import Colours, bins
from dextera_build.geometry.tracking.frame import Frame
from dextera_build.geometry.tracking.model import Cast, Model, State
from dextera_build.geometry.tracking.solve import Fit

TOLERANCE_M = 0.008
"""Distance in depth up to which a pixel shows the model, added to three standard deviations of the noise [m]."""


@dataclass(frozen=True)
class Gate:
    """When a pose counts as measured."""

    agreement: float = 0.7
    """Least part of the pixels with depth that show the model, of those where it is not hidden."""
    visible: float = 0.18
    """Least part of the model's pixels, hidden ones included, that show it."""
    pixels: float = 120.0
    """Least number of pixels whose depth shows it."""
    correlation: float = 0.35
    """Least correlation of brightness with an earlier view, where the object has a texture."""
    outline: float = 0.45
    """Least part of the unhidden outline that is seen within 4 px."""
    sharp: float = 0.0
    """Least part of the unhidden outline that is seen there clearly."""
    odds: float = -0.3
    """Least mean log-likelihood ratio of the object's colours where it is seen."""
    sigma_m: float = 0.012
    """Largest standard deviation of the place of its middle along any axis [m]."""


@dataclass(frozen=True)
class Verdict:
    """How a pose agrees with a frame."""

    agreement: float  # of the unhidden pixels with depth, the part that shows the model
    visible: float  # of the model's pixels, the part that shows it
    hidden: float  # the part that something nearer hides
    outside: float  # the part that is outside the picture
    pixels: float  # pixels whose depth shows it
    odds: float  # mean log-likelihood ratio of the colours there

    @property
    def score(self) -> float:
        """For comparing poses; higher is better."""
        return self.visible * (1.0 + 0.3 * self.odds) - 1.5 * (1.0 - self.agreement) * (
            1.0 - self.hidden - self.outside
        )


LOST = Verdict(0.0, 0.0, 0.0, 1.0, 0.0, 0.0)
"""Of a pose that is outside the picture."""


def look(
    model: Model, frame: Frame, state: State, colours: Colours, number: int = 0, rays: int = 700
) -> tuple[Verdict, Cast | None]:
    """Compare the model under a state with a frame."""
    cast = model.cast(state, frame.k, frame.shape, rays)
    if cast is None or cast.drawn.sum() < 12:
        return LOST, cast
    rows, columns = np.nonzero(cast.drawn)
    own = cast.depth[rows, columns]
    rows, columns = cast.rows[rows], cast.columns[columns]
    z, others = frame.depth[rows, columns], frame.others(rows, columns, number)
    limit = TOLERANCE_M + 3.0 * planes.depth_sigma(own) + 0.5 * _thickness(cast)
    agree = (z > 0) & (np.abs(z - own) < limit) & ~others
    before, behind = ((z > 0) & (z < own - limit)) | others, (z > own + limit) & ~others
    odds = colours.odds()[bins(frame.rgb[rows, columns])]
    measured = float(agree.sum())
    # Without depth, colours tell: dark and shining surfaces return none.
    agree |= (z == 0) & (odds > 0.5) & ~others
    count, whole = len(z), _whole(model, state, frame, cast)
    shown = float(agree.sum())
    return (
        Verdict(
            agreement=shown / max(shown + float(behind.sum()), 1.0),
            visible=shown / whole,
            hidden=float(before.sum()) / whole,
            outside=(whole - count) / whole,
            pixels=measured * cast.stride**2,
            odds=float(odds[agree].mean()) if colours.known and agree.any() else 0.0,
        ),
        cast,
    )


def passes(fit: Fit, verdict: Verdict, gate: Gate) -> str:
    """Why a pose is not measured, in words; empty if it is."""
    reasons = {
        "outside the picture or hidden": verdict.visible < gate.visible or verdict.pixels < gate.pixels,
        "something else is seen behind it": verdict.agreement < gate.agreement,
        "its texture does not agree": fit.correlation < gate.correlation,
        "its outline is elsewhere": fit.outline < gate.outline,
        "its outline is not seen": fit.sharp < gate.sharp,
        "its colours are not seen": verdict.odds < gate.odds,
        "its position is not determined": fit.middle_sigma_m > gate.sigma_m,
    }
    return next((why for why, holds in reasons.items() if holds), "")


def _thickness(cast: Cast) -> np.ndarray:
    """How much the depth of the model changes from ray to ray [m]: pixels do not coincide better."""
    filled = np.where(cast.drawn, cast.depth, np.nan)
    down, right = np.abs(np.diff(filled, axis=0, append=np.nan)), np.abs(np.diff(filled, axis=1, append=np.nan))
    return np.asarray(np.minimum(np.nan_to_num(np.fmax(down, right))[cast.drawn], 0.02))


def _whole(model: Model, state: State, frame: Frame, cast: Cast) -> float:
    """Rays that would meet the model if the picture had no border."""
    height, width = frame.shape
    box = model.box(state, frame.k, (1 << 20, 1 << 20))
    inside = model.box(state, frame.k, frame.shape)
    count = float(cast.drawn.sum())
    if box is None or inside is None:
        return count
    # The box of the whole model may begin left of or above the picture.
    points = state.pose[:3, :3] @ model.centre + state.pose[:3, 3]
    reach = model.radius / points[2] * np.array([frame.k[0, 0], frame.k[1, 1]])
    middle = points[:2] / points[2] * [frame.k[0, 0], frame.k[1, 1]] + frame.k[:2, 2]
    low, high = np.maximum(middle - reach, 0), np.minimum(middle + reach, [width, height])
    part = float(np.prod(np.maximum(high - low, 1.0)) / np.prod(2 * reach))
    return count / min(max(part, 0.05), 1.0)
