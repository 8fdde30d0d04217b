"""Sensor models: rates, delays and noise applied to exact measurements, term by term.

All random numbers are derived from the seed of the episode and the name of the term, so that a repeated episode has the
same measurements, independent of the other terms.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping

import numpy as np

from dextera_build import digest
from dextera_build.artifacts.robots.noise import ColourNoise, DepthNoise
from dextera_build.errors import RuleError, did_you_mean, listing
from dextera_build.geometry import cameras, lie, quaternions
from dextera_build.policy.declared import HIDDEN
from dextera_build.policy.observation import Frame, Measurement
from dextera_build.policy.terms import Sensor, Term
from dextera_build.sim.render import sensor as camera_sensor


class Sensors:
    """The sensors of one environment.

    Args:
        terms: Terms with their sensors; only inexact terms of a `Measurement` have an effect.
        intrinsics: Camera -> K (3, 3) [px], for depth and its points.
    """

    def __init__(self, terms: Iterable[Term], intrinsics: dict[str, np.ndarray]) -> None:
        measured = [term for term in terms if term.declared.name in MEASURED and term.sensor != Sensor()]
        self._numbers = {term.declared.name: _Delayed(term) for term in measured if not term.camera}
        self._pictures = {(term.declared.name, term.camera): _Delayed(term) for term in measured if term.camera}
        self._intrinsics = intrinsics

    def reset(self, seed: int, noise: float = 1.0) -> None:
        """Discard all samples; draw errors from `seed`, those of cameras scaled by `noise`."""
        for delayed in (*self._numbers.values(), *self._pictures.values()):
            delayed.reset(seed, noise)

    def measure(self, truth: Measurement, now: float) -> Measurement:
        """Measurements available at `now` [s] after the start, given the current `truth`. Time must not decrease."""
        if not self._numbers and not self._pictures:
            return truth
        known = {name: getattr(truth, name) for name in MEASURED_NUMBERS}
        known |= {name: delayed.take(known[name], now) for name, delayed in self._numbers.items()}
        frames = {name: self._frame(name, frame, now) for name, frame in truth.frames.items()}
        return Measurement(**known, frames=frames)

    def _frame(self, camera: str, frame: Frame, now: float) -> Frame:
        rgb, depth, cloud = frame.rgb, frame.depth, frame.cloud
        if rgb is not None and ("rgb", camera) in self._pictures:
            rgb = self._pictures["rgb", camera].take(rgb, now)
        if depth is not None and ("depth", camera) in self._pictures:
            light = np.full((*depth.shape, 3), 0.5) if frame.rgb is None else frame.rgb / 255.0
            depth = self._pictures["depth", camera].take(depth, now, light=light, k=self._intrinsics[camera])
            if cloud is not None:
                cloud = cameras.backproject(depth, self._intrinsics[camera]).astype(np.float32)
        return Frame(rgb, depth, cloud)


def check(sensors: Mapping[str, Sensor], views: Iterable[str]) -> None:
    """Raise for sensors of unmeasured terms.

    Args:
        sensors: Name of a term, or `name/camera`, -> its sensor.
        views: Names of the cameras.

    Raises:
        RuleError: A name belongs to a privileged term, or to none.
    """
    known = [*MEASURED, *(f"{name}/{view}" for name in ("rgb", "depth") for view in views)]
    for name in sensors:
        if name in known:
            continue
        why = "is privileged, so that no sensor measures it" if name in HIDDEN else "is nothing that a sensor measures"
        raise RuleError(
            f"`{name}` {why}",
            code="DXB-B514",
            facts={"sensors": listing(known, most=30)},
            hint=did_you_mean(name, known) or "leave it out of `sensors`",
        )


MEASURED_NUMBERS = ("joints", "objects", "displacement")
"""Fields of a `Measurement` that are numbers."""
MEASURED = (*MEASURED_NUMBERS, "rgb", "depth")


class _Delayed:
    """One term: sampled at its rate, available after its delay."""

    def __init__(self, term: Term) -> None:
        self._term, self._sensor = term, term.sensor
        self._step = 0.0 if term.sensor.rate_hz is None else 1.0 / term.sensor.rate_hz
        self.reset(0, 1.0)

    def reset(self, seed: int, noise: float) -> None:
        self._colour, self._depth = _scaled(self._term.sensor, noise)
        self._random = np.random.default_rng([seed, int(digest.of_value(["sensor", self._term.key])[:15], 16)])
        self._waiting: deque[tuple[float, np.ndarray]] = deque()
        self._due = 0.0
        self._last: np.ndarray | None = None

    def take(self, truth: np.ndarray, now: float, **picture: np.ndarray) -> np.ndarray:
        """The last sample available at `now`; the first one is available at once, because a robot waits for it."""
        if now >= self._due - 1e-9:
            lost = self._sensor.loss and self._last is not None and self._random.uniform() < self._sensor.loss
            if not lost:
                self._waiting.append((now + self._sensor.delay_s, self._noisy(truth, **picture)))
            # Samples keep their own clock; a slower control period only skips some.
            while self._step and self._due <= now + 1e-9:
                self._due += self._step
        if self._last is None:
            self._last = self._waiting[0][1]
        while self._waiting and self._waiting[0][0] <= now + 1e-9:
            self._last = self._waiting.popleft()[1]
        return self._last

    def _noisy(self, truth: np.ndarray, light: np.ndarray | None = None, k: np.ndarray | None = None) -> np.ndarray:
        sensor, name = self._sensor, self._term.declared.name
        if name == "rgb":
            colour = self._colour
            return truth if colour is None else camera_sensor.measure_colour(truth / 255.0, colour, self._random)
        if name == "depth":
            if self._depth is None or light is None or k is None:
                return truth
            return camera_sensor.measure_depth(truth.astype(np.float64), light, k, self._depth, self._random)
        if name == "objects":
            return self._disturbed(truth)
        return np.asarray(truth + sensor.sigma * self._random.standard_normal(truth.shape))

    def _disturbed(self, poses: np.ndarray) -> np.ndarray:
        """Poses (O, 7) with errors of position and, about the axes of the base, of rotation."""
        found = poses.copy()
        found[:, :3] += self._sensor.sigma * self._random.standard_normal((len(poses), 3))
        for row, turn in zip(
            found, self._sensor.turn_sigma_rad * self._random.standard_normal((len(poses), 3)), strict=True
        ):
            row[3:] = quaternions.multiply(quaternions.from_matrix(lie.rotation(turn)), row[3:])
            if row[3] < 0:
                row[3:] *= -1
        return found


def _scaled(sensor: Sensor, noise: float) -> tuple[ColourNoise | None, DepthNoise | None]:
    """The noise of a camera multiplied by a factor: deviations, and the fractions of lost depth."""
    colour, depth = sensor.colour, sensor.depth
    if colour is not None:
        colour = colour.model_copy(update={"sigma": colour.sigma * noise})
    if depth is not None:
        lost = {name: min(1.0, getattr(depth, name) * noise) for name in ("dropout", "patches")}
        depth = depth.model_copy(update={"subpixel_px": depth.subpixel_px * noise, **lost})
    return colour, depth
