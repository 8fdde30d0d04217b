"""Objects as layers that move over the pictures: their motion since the first picture, and their visible pixels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .flow_motion import Flow, affine, flow, grid
from .flow_options import FlowOptions

_MARGIN = 8
"""Pixels around an object in the crop where it is aligned with the first picture."""
_AROUND = (5, 5)
"""Width and height of the window in which colours are compared [px]."""
_TELLING = 0.25
"""Minimum visible fraction of an object to estimate its brightness."""
_CORRECTION_PX = 4.0
"""Larger corrections in one picture are rejected [px]."""


@dataclass(frozen=True)
class Picture:
    """A picture of a film, prepared for layers."""

    colours: np.ndarray
    """(H, W, 3) uint8, slightly blurred."""
    grey: np.ndarray
    """(H, W) uint8."""

    @classmethod
    def of(cls, pixels: np.ndarray) -> Picture:
        """The picture of pixels (H, W, 3) uint8."""
        import cv2

        return cls(cv2.GaussianBlur(pixels, (0, 0), 1.0), cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY))


@dataclass
class Layer:
    """One object."""

    first: Picture
    """The picture in which it was marked."""
    outline: np.ndarray
    """(H, W) uint8, its mask in that picture."""
    motion: np.ndarray
    """(3, 3), affine, from pixels of the first picture to those of the current one."""
    visible: np.ndarray
    """(H, W) bool, visible pixels in the current picture."""
    light: float = 1.0
    """Brightness in the current picture relative to the first."""
    lost: bool = False

    @classmethod
    def of(cls, first: Picture, mask: np.ndarray) -> Layer:
        """The object with this mask (H, W) bool in the first picture."""
        return cls(first, mask.astype(np.uint8), np.eye(3), mask)

    def move(self, now: Picture, way: Flow, options: FlowOptions) -> tuple[np.ndarray, float]:
        """Follow the flow to the next picture.

        Returns:
            Difference (H, W) float32 to the object's colours in the first picture, infinite where it is not visible;
            and the fraction of consistent flow. `visible` is left to the caller, which has the other objects.
        """
        step, share = (None, 0.0) if self.lost else affine(way, self.visible, options.consistent_fraction)
        if step is not None:
            self.motion = step @ self.motion
            before = _moved(self.visible.astype(np.uint8), step) > 0
            self._correct(now, before, options.consistent_fraction)
            inside = self.inside
            off = self._difference(now, before, inside)
            steady = before & (_off_motion(way, step) < options.motion_px)
            shown = inside & (off < options.colour_difference * np.where(steady, 2.0, 1.0))
            if shown.sum() >= max(1.0, options.area_fraction * self.outline.sum()):
                return np.where(shown, off, np.inf).astype(np.float32), share
        self.lost = True
        return np.full(self.visible.shape, np.inf, np.float32), 0.0

    @property
    def inside(self) -> np.ndarray:
        """The moved outline, including occluded parts, (H, W) bool."""
        return _moved(self.outline, self.motion) > 0

    @property
    def seen(self) -> float:
        """The visible part of the moved outline."""
        return float(self.visible.sum() / max(self.inside.sum(), 1))

    def _correct(self, now: Picture, before: np.ndarray, least: float) -> None:
        """Align the moved first picture with the current one, to prevent drift."""
        import cv2

        inside = self.inside
        left, top, width, height = cv2.boundingRect(inside.astype(np.uint8))
        if not width:
            return
        origin = np.maximum([left - _MARGIN, top - _MARGIN], 0)
        box = np.s_[origin[1] : top + height + _MARGIN, origin[0] : left + width + _MARGIN]
        made = np.where(inside, _moved(self.first.grey, self.motion, smooth=True), now.grey)[box]
        change, _ = affine(flow(np.ascontiguousarray(made), np.ascontiguousarray(now.grey[box])), before[box], least)
        corners = np.array([(0, 0, 1), (width, 0, 1), (0, height, 1), (width, height, 1)]).T
        if change is not None and np.abs(change @ corners - corners).max() <= _CORRECTION_PX:
            shift = np.eye(3)
            shift[:2, 2] = origin
            self.motion = shift @ change @ np.linalg.inv(shift) @ self.motion

    def _difference(self, now: Picture, before: np.ndarray, inside: np.ndarray) -> np.ndarray:
        """Mean colour difference to the moved first picture around each pixel of the outline, (H, W) float32."""
        import cv2

        there = _moved(self.first.colours, self.motion, smooth=True).astype(np.float32)
        here, sample = now.colours.astype(np.float32), inside & before
        if sample.sum() > _TELLING * self.outline.sum():
            self.light = float(np.median(here[sample].mean(-1))) / max(float(np.median(there[sample].mean(-1))), 1.0)
        off = np.abs(here / max(self.light, 0.1) - there).mean(-1)
        around = [cv2.blur(each.astype(np.float32), _AROUND) for each in (off * inside, inside)]
        return np.asarray(around[0] / np.maximum(around[1], 1e-6))


def _moved(picture: np.ndarray, motion: np.ndarray, *, smooth: bool = False) -> np.ndarray:
    """A picture after an affine motion, 0 outside the source; bilinear, or by the nearest pixel."""
    import cv2

    size = (picture.shape[1], picture.shape[0])
    return np.asarray(
        cv2.warpAffine(picture, motion[:2], size, flags=cv2.INTER_LINEAR if smooth else cv2.INTER_NEAREST)
    )


def _off_motion(way: Flow, step: np.ndarray) -> np.ndarray:
    """Distance of the backward flow of each pixel from an affine motion, (H, W) [px]."""
    inverse = np.linalg.inv(step)
    back = grid(way.back.shape) @ (inverse[:2, :2] - np.eye(2)).T + inverse[:2, 2]
    return np.asarray(np.linalg.norm(way.back - back, axis=-1))
