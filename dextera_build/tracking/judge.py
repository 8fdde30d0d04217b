"""Agreement of a pose with a frame: measurements on the model, in front of it and behind it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.geometry import planes
from dextera_build.tracking.colours import Colours, bins
from dextera_build.tracking.frame import Frame
from dextera_build.tracking.model import Cast, Model, State
from dextera_build.tracking.solve import Fit

TOLERANCE_M = 0.008
"""Depth difference up to which a pixel shows the model, added to three standard deviations of the noise [m]."""


@dataclass(frozen=True)
class Gate:
    """Requirements for a measured pose."""

    agreement: float = 0.7
    """Minimum fraction of the unoccluded pixels with depth that show the model."""
    visible: float = 0.18
    """Minimum fraction of the model's pixels, including hidden ones, that show it."""
    pixels: float = 120.0
    """Minimum number of pixels whose depth shows the model."""
    correlation: float = 0.35
    """Minimum correlation of brightness with a stored view, if the object has a texture."""
    outline: float = 0.45
    """Minimum fraction of the unoccluded outline that is detected within 4 px."""
    sharp: float = 0.0
    """Minimum fraction of the unoccluded outline that is detected there clearly."""
    odds: float = -0.3
    """Minimum mean log-likelihood ratio of the object's colours on its visible pixels."""
    sigma_m: float = 0.012
    """Maximum standard deviation of the position of its centre along any axis [m]."""


@dataclass(frozen=True)
class Verdict:
    """Agreement of a pose with a frame."""

    agreement: float  # fraction of the unoccluded pixels with depth that shows the model
    visible: float  # fraction of the model's pixels that shows it
    hidden: float  # fraction hidden by something nearer
    outside: float  # fraction outside the picture
    pixels: float  # number of pixels whose depth shows it
    odds: float  # mean log-likelihood ratio of the colours there

    @property
    def score(self) -> float:
        """For comparing poses; higher is better."""
        return self.visible * (1.0 + 0.3 * self.odds) - 1.5 * (1.0 - self.agreement) * (
            1.0 - self.hidden - self.outside
        )


LOST = Verdict(0.0, 0.0, 0.0, 1.0, 0.0, 0.0)
"""Verdict of a pose outside the picture."""


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
    # Without depth, colours are used: dark and shiny surfaces return none.
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
    """Reason why a pose does not count as measured, in words; empty if it does."""
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
    """Depth change of the model from ray to ray [m], the limit of depth comparisons."""
    filled = np.where(cast.drawn, cast.depth, np.nan)
    down, right = np.abs(np.diff(filled, axis=0, append=np.nan)), np.abs(np.diff(filled, axis=1, append=np.nan))
    return np.asarray(np.minimum(np.nan_to_num(np.fmax(down, right))[cast.drawn], 0.02))


def _whole(model: Model, state: State, frame: Frame, cast: Cast) -> float:
    """Number of rays that would hit the model in an unbounded picture."""
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
