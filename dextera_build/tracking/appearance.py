"""Appearance of one tracked object: its colours, brightness from several directions, and features of its texture."""

from __future__ import annotations

import numpy as np

from dextera_build.geometry import transforms
from dextera_build.tracking import landmarks, terms
from dextera_build.tracking.colours import Colours, bins
from dextera_build.tracking.frame import Frame
from dextera_build.tracking.model import Cast, Model, State

LOOKS = 24
"""Maximum number of stored views."""
APART = np.cos(np.radians(20.0))
"""Cosine of the minimum angle between the directions of two stored views."""
PATTERN = 12.0
"""Standard deviation of brightness above which an object has a texture, 0..255."""


class Appearance:
    """Appearance of an object, learned from frames in which it was tracked.

    Args:
        number: Its number, as in `Frame.owner`.
        model: Its shape.
    """

    def __init__(self, number: int, model: Model) -> None:
        self._number, self._model, self.colours = number, model, Colours()
        self.landmarks: list[landmarks.Landmarks] = []
        self._looks: list[terms.Look] = []

    @property
    def textured(self) -> bool:
        """Whether its texture is sufficient to distinguish views."""
        return any(float(look.grey.std()) > PATTERN for look in self._looks)

    def learn(self, frame: Frame, state: State, rate: float) -> None:
        """Learn the colours of its pixels and of its surroundings, with weight `rate`."""
        cast = self._model.cast(state, frame.k, frame.shape, 1200)
        box = self._model.box(state, frame.k, frame.shape, margin=0.35)
        if cast is None or box is None:
            return
        z = frame.depth[np.ix_(cast.rows, cast.columns)]
        others = frame.others(cast.rows[:, None], cast.columns[None], self._number)
        shown = cast.drawn & ~others & ((z == 0) | (np.abs(z - cast.depth) < 0.012))
        rows, columns = np.nonzero(shown)
        inside = bins(frame.rgb[cast.rows[rows], cast.columns[columns]])
        step = max(1, (box[3] - box[1]) // 40)
        around = bins(frame.rgb[box[1] : box[3] : step, box[0] : box[2] : step])
        rows, columns = np.arange(box[1], box[3], step), np.arange(box[0], box[2], step)
        outside = around[cast.link_at(rows[:, None], columns[None]) < 0]
        if rate == 1.0:
            # The whole first picture, too, so that the search accounts for other objects with these colours.
            outside = np.concatenate([outside, bins(frame.rgb[4::16, 4::16])[frame.owner[4::16, 4::16] < 0]])
        self.colours.learn(inside, outside, rate)

    def nearest(self, state: State) -> terms.Look | None:
        """The stored view from the nearest direction; None if none is near."""
        if not self._looks:
            return None
        towards = _towards(state, self._model)
        found = max(self._looks, key=lambda look: float(look.towards @ towards))
        return found if float(found.towards @ towards) > np.cos(np.radians(50.0)) else None

    def remember(self, frame: Frame, state: State, covariance: np.ndarray) -> None:
        """Store the current view, unless a view from about this direction exists.

        Args:
            frame: The current frame.
            state: Its state in this frame.
            covariance: (6, 6) of its pose.
        """
        towards = _towards(state, self._model)
        if len(self._looks) >= LOOKS or any(float(look.towards @ towards) > APART for look in self._looks):
            return
        cast = self._model.cast(state, frame.k, frame.shape)
        if cast is None or cast.drawn.sum() < 40:
            return
        spots = _inside(cast, 250)
        placed = terms.Placed.of(self._model, state, spots)
        rows, columns, inside = frame.nearest(placed.points)
        z = frame.depth[rows, columns]
        good = inside & (z > 0) & (np.abs(z - placed.points[:, 2]) < 0.01)
        good &= ~frame.others(rows, columns, self._number)
        if good.sum() < 40:
            return
        kept = terms.Spots(spots.points[good], spots.normals[good], spots.link[good])
        grey = frame.smooth[rows[good], columns[good]].astype(np.float64)
        self._looks.append(terms.Look(kept, grey, towards, state.pose[:3, :3], covariance))
        known = landmarks.of(frame, cast)
        self.landmarks += [] if known is None else [known]


def _towards(state: State, model: Model) -> np.ndarray:
    """Direction (3,) from the object's centre to the camera, in the object frame."""
    away = transforms.apply(transforms.invert(state.pose), np.zeros((1, 3)))[0] - model.centre
    return np.asarray(away / np.linalg.norm(away))


def _inside(cast: Cast, most: int) -> terms.Spots:
    """Hits away from the outline, where brightness is mixed with that of the surroundings."""
    import cv2

    inner = cv2.erode(np.pad(cast.drawn, 1).astype(np.uint8), np.ones((3, 3), np.uint8))[1:-1, 1:-1]
    chosen = np.flatnonzero(inner)
    return terms.Spots.at(cast, chosen[:: max(1, -(-len(chosen) // most))])
