"""Hands of an operator: a film of their skeletons from behind and from the side, and a strip of moments."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from itertools import pairwise
from typing import Any

import numpy as np

from dextera_build.artifacts.base import Artifact
from dextera_build.artifacts.cameras.image import png
from dextera_build.artifacts.robots.hand_stream import LOST, HandStream
from dextera_build.geometry import hands, quaternions
from dextera_build.geometry.plot import COLOURS

PANEL = (320, 230)
"""Size of one view [px]."""
_STRIP, _SMOOTH, _TRAIL_S = 44, 2, 1.0
"""Height of the time line [px], samples per pixel edge, length of a wrist's trail [s]."""
_PAPER, _INK, _PALM = (255, 255, 255), (60, 60, 60), (236, 226, 216)
_STATES = {"lost": (214, 70, 60), "tracked": (200, 204, 210), "clutch": COLOURS[0]}
MOMENTS = 4
"""Moments in a strip."""
_Views = list[tuple[str, np.ndarray]]


def frames(stream: HandStream, rate_hz: float = 24.0, most_s: float = np.inf) -> Iterator[np.ndarray]:
    """Pictures (H, W, 3) uint8 of the skeletons, evenly in time, one at a time.

    Args:
        stream: The hands.
        rate_hz: Pictures per second of the recording.
        most_s: Time of the recording after which the film ends [s].
    """
    drawing = _Drawing(stream)
    start = float(stream.stamps[0])
    end = min(float(stream.stamps[-1]), start + most_s)
    for time in np.arange(start, end + 1e-6, 1 / rate_hz):
        yield drawing.at(int(np.searchsorted(stream.stamps, time, side="right")) - 1)


def strip(stream: HandStream, count: int = MOMENTS) -> np.ndarray:
    """Moments (H, W, 3) uint8 below one another, evenly among the messages in which a hand is tracked."""
    seen = np.flatnonzero((stream.tracking > LOST).any(axis=1))
    chosen = seen if len(seen) else np.zeros(1, int)
    drawing = _Drawing(stream)
    places = ((np.arange(count) + 0.5) * len(chosen) / count).astype(int)
    return np.vstack([drawing.at(int(row)) for row in chosen[places]])


class _Drawing:
    """Draws messages of a stream in views that show all of its motion.

    Args:
        stream: The hands.
    """

    def __init__(self, stream: HandStream) -> None:
        self._stream = stream
        self._views = _views(stream)
        points = stream.positions[np.isfinite(stream.positions).all(axis=-1)]
        points = points if len(points) else np.zeros((1, 3))
        self._middle = (points.min(axis=0) + points.max(axis=0)) / 2
        spans = [np.ptp(points @ axes, axis=0) for _, axes in self._views]
        room = np.array(PANEL, np.float64) - 40
        self._scale = float(min((room / np.maximum(span, 0.05)).min() for span in spans))

    def at(self, row: int) -> np.ndarray:
        """The picture (H, W, 3) uint8 of a message."""
        from PIL import Image, ImageDraw

        width, height = PANEL[0] * len(self._views), PANEL[1] + _STRIP
        picture = Image.new("RGB", (width * _SMOOTH, height * _SMOOTH), _PAPER)
        pen = ImageDraw.Draw(picture)
        for number, (_, axes) in enumerate(self._views):
            for hand in range(len(hands.SIDES)):
                self._trail(pen, row, hand, axes, number)
                if self._stream.tracking[row, hand] > LOST:
                    self._hand(pen, self._placed(self._stream.positions[row, hand], axes, number))
        small = picture.resize((width, height), Image.Resampling.LANCZOS)
        self._words(ImageDraw.Draw(small), row)
        return np.asarray(small)

    def _placed(self, points: np.ndarray, axes: np.ndarray, panel: int) -> np.ndarray:
        """Places (K, 2) of points (K, 3) in the large picture [px]."""
        flat = (points - self._middle) @ axes * self._scale * [1, -1]
        centre = np.array([PANEL[0] * (panel + 0.5), 10 + PANEL[1] / 2])
        return np.asarray(_SMOOTH * (flat + centre))

    def _trail(self, pen: Any, row: int, hand: int, axes: np.ndarray, panel: int) -> None:
        stream = self._stream
        first = int(np.searchsorted(stream.stamps, stream.stamps[row] - _TRAIL_S))
        wrist = self._placed(stream.positions[first : row + 1, hand, hands.WRIST], axes, panel)
        for start, end in pairwise(wrist):
            if np.isfinite([start, end]).all():
                pen.line([*start, *end], fill=(190, 190, 190), width=_SMOOTH)

    def _hand(self, pen: Any, places: np.ndarray) -> None:
        palm = [hands.WRIST, hands.CHAINS[0][0], *(chain[1] for chain in hands.CHAINS[1:])]
        pen.polygon([tuple(places[joint]) for joint in palm], fill=_PALM)
        for finger, chain in enumerate(hands.CHAINS):
            colour = COLOURS[finger]
            for joint in chain:
                pen.line([*places[hands.PARENTS[joint]], *places[joint]], fill=colour, width=2 * _SMOOTH)
            for joint in chain:
                size = _SMOOTH * (2.5 if joint == chain[-1] else 1.5)
                x, y = places[joint]
                pen.ellipse([x - size, y - size, x + size, y + size], fill=colour)

    def _words(self, pen: Any, row: int) -> None:
        stream = self._stream
        for number, (name, _) in enumerate(self._views):
            pen.text((PANEL[0] * number + 6, 4), name, fill=_INK)
        if stream.synthetic:
            pen.text((6, 16), "made by a program: no person, no headset", fill=_STATES["lost"])
        length = PANEL[0] * len(self._views) - 130
        for hand, side in enumerate(hands.SIDES):
            top = PANEL[1] + 4 + 16 * hand
            lost, driving = stream.tracking[row, hand] == LOST, stream.clutch[row, hand]
            state = "lost" if lost else f"{'drives' if driving else 'free'}, pinch {stream.pinch[row, hand]:.1f}"
            pen.text((6, top - 2), f"{side} {state}", fill=_INK)
            for first, last, name in _runs(stream, hand):
                across = [124 + length * share for share in (first / len(stream.stamps), last / len(stream.stamps))]
                pen.rectangle([across[0], top, across[1], top + 9], fill=_STATES[name])
        now = 124 + length * row / len(stream.stamps)
        pen.line([now, PANEL[1] + 2, now, PANEL[1] + 32], fill=_INK, width=2)
        words = f"{stream.stamps[row] - stream.stamps[0]:.2f} s"
        pen.text((min(now + 4, PANEL[0] * len(self._views) - 48), PANEL[1] + 32), words, fill=_INK)


def _views(stream: HandStream) -> _Views:
    """Name, and axes (3, 2) to the right and up of the picture, of each view."""
    up, ahead = np.array([0.0, 0, 1]), np.array([1.0, 0, 0])
    heads = stream.known_heads
    if len(heads):
        looks = -quaternions.to_matrix(heads[:, 3:].mean(axis=0))[:, 2] * [1, 1, 0]
        ahead = looks / np.linalg.norm(looks) if np.linalg.norm(looks) > 0.1 else ahead
    right = np.cross(ahead, up)
    tilt = np.deg2rad(25)
    above = np.cos(tilt) * up + np.sin(tilt) * ahead
    return [("from behind", np.stack([right, above], axis=1)), ("from the right", np.stack([ahead, up], axis=1))]


def _runs(stream: HandStream, hand: int) -> Iterator[tuple[int, int, str]]:
    """First message, one past the last, and state of stretches of one state."""
    state = np.where(stream.tracking[:, hand] == LOST, 0, 1 + stream.clutch[:, hand])
    edges = [0, *(np.flatnonzero(np.diff(state)) + 1), len(state)]
    for first, last in pairwise(edges):
        yield first, last, tuple(_STATES)[state[first]]


def _facts(stream: HandStream) -> Iterator[str]:
    """Duration, rate, device, how often each hand is tracked, size of the hands, takes."""
    yield f"{stream.stamps[-1] - stream.stamps[0]:.1f} s at {stream.rate_hz:.0f} Hz"
    for hand, side in enumerate(hands.SIDES):
        seen = stream.tracking[:, hand] > LOST
        if seen.any():
            size = float(np.median(hands.hand_size(stream.positions[seen, hand])))
            yield f"{side} hand {1000 * size:.0f} mm, tracked {100 * seen.mean():.0f} %"
        else:
            yield f"no {side} hand"
    yield "with head" if stream.head is not None else "no head"
    if stream.workplace is not None:
        yield f"of {stream.workplace.task} with {stream.workplace.robot}"
    if stream.takes:
        yield f"{len(stream.takes)} take{'' if len(stream.takes) == 1 else 's'}"
    yield f"made by a program, no person and no headset ({stream.device})" if stream.synthetic else stream.device


FACTS: Mapping[type[Artifact], Callable[[Any], Iterator[str]]] = {HandStream: _facts}
PICTURES: Mapping[type[Artifact], Callable[[Any], bytes]] = {HandStream: lambda stream: png(strip(stream, 1))}
