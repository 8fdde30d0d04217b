"""What separates a tracked human hand from a smooth motion: tremor, noise, drift, losses, an uneven clock."""

from __future__ import annotations

import numpy as np
from pydantic import Field, NonNegativeFloat, PositiveFloat

from dextera_build.rule import Options


class UnsteadyOptions(Options):
    """Tremor of the hand and errors of its tracking; one set of values for every person and headset.

    Tremor: "A Normative Study of Postural Tremor of the Hand" (Archives of Neurology 39, 1982) finds a most frequent
    amplitude of 0.01 g at 7 Hz, which is 51 um; Lakie et al. (Journal of Physiology 593, 2015) a peak between 6 and 12
    Hz. Tracking: Abdlkarim et al. (Behavior Research Methods 56, 2024) measured errors of 1.1 cm at the fingertips and
    9.6 deg at finger joints with a Meta Quest 2. An operator who sees the robot corrects what is constant of them; the
    drift here is what is assumed to remain. All other values are assumptions.
    """

    tremor_m: NonNegativeFloat = 0.00005
    """Tremor of the wrist's position per axis, standard deviation [m]."""
    tremor_deg: NonNegativeFloat = 0.05
    """Tremor of the wrist's rotation vector and of finger joints, standard deviation [deg]."""
    tremor_hz: tuple[PositiveFloat, PositiveFloat] = (8.0, 12.0)
    """Lowest and highest frequency of the tremor [Hz]."""
    jitter_m: NonNegativeFloat = 0.0003
    """Noise of the wrist's position from message to message per axis, standard deviation [m]."""
    jitter_deg: NonNegativeFloat = 0.2
    """Noise of the wrist's rotation vector and of finger joints from message to message, standard deviation [deg]."""
    drift_m: NonNegativeFloat = 0.002
    """Slow error of the wrist's position per axis, standard deviation [m]."""
    drift_deg: NonNegativeFloat = 1.0
    """Slow error of the wrist's rotation vector and of finger joints, standard deviation [deg]."""
    drift_s: PositiveFloat = 2.0
    """Time after which the slow error is forgotten by 63 % [s]."""
    losses_per_min: NonNegativeFloat = Field(6.0, le=600.0)
    """Number of times per minute that the tracking of a hand is lost."""
    loss_s: PositiveFloat = 0.12
    """Mean duration of a loss [s]."""
    predicted_s: NonNegativeFloat = 0.03
    """Beginning of a loss during which the device repeats the last pose as a prediction [s]."""
    clock_s: NonNegativeFloat = 0.0005
    """Standard deviation of the time of a message, at most a quarter of the time between two [s]."""


def errors(
    options: UnsteadyOptions, rate_hz: float, count: int, lengths: tuple[int, int], random: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Errors of positions (N, P) [m] and of angles (N, Q) [rad]: tremor, jitter and drift.

    Args:
        options: Their sizes.
        rate_hz: Rate of the messages [Hz].
        count: N.
        lengths: P and Q.
        random: Source of the noise.
    """
    found = []
    scales = (
        (lengths[0], 1.0, options.tremor_m, options.jitter_m, options.drift_m),
        (lengths[1], np.deg2rad(1.0), options.tremor_deg, options.jitter_deg, options.drift_deg),
    )
    for columns, unit, tremor, jitter, drift in scales:
        shaking = banded(random, rate_hz, count, columns, options.tremor_hz)
        slow = _drift(random, count, columns, np.exp(-1 / (rate_hz * options.drift_s)))
        found.append(unit * (tremor * shaking + jitter * random.standard_normal((count, columns)) + drift * slow))
    return found[0], found[1]


def banded(
    random: np.random.Generator, rate_hz: float, count: int, columns: int, band_hz: tuple[float, float]
) -> np.ndarray:
    """Noise (N, K) of standard deviation 1 whose frequencies lie in a band [Hz]; 0 where the rate is too low."""
    spectrum = np.fft.rfft(random.standard_normal((count, columns)), axis=0)
    frequencies = np.fft.rfftfreq(count, 1 / rate_hz)
    spectrum[(frequencies < band_hz[0]) | (frequencies > band_hz[1])] = 0
    found = np.fft.irfft(spectrum, count, axis=0)
    size = found.std()
    return found / size if size > 0 else found


def losses(options: UnsteadyOptions, rate_hz: float, count: int, random: np.random.Generator) -> np.ndarray:
    """Number (N,) of messages since tracking was lost, 1 for the first lost one; 0 where it is tracked."""
    found = np.zeros(count, np.int64)
    for first in np.flatnonzero(random.random(count) < options.losses_per_min / 60 / rate_hz):
        lasting = 1 + int(rate_hz * random.exponential(options.loss_s))
        if not found[first]:
            stretch = found[first : first + lasting]
            stretch[:] = np.arange(1, len(stretch) + 1)
    return found


def clock(options: UnsteadyOptions, rate_hz: float, count: int, random: np.random.Generator) -> np.ndarray:
    """Times (N,) of messages [s], whole nanoseconds, increasing from about 0."""
    most = 0.25 / rate_hz
    late = np.clip(options.clock_s * random.standard_normal(count), -most, most) + most
    return np.asarray(np.round(np.arange(count) / rate_hz + late, 9))


def _drift(random: np.random.Generator, count: int, columns: int, keep: float) -> np.ndarray:
    """A stationary first-order process (N, K) of standard deviation 1."""
    drawn = random.standard_normal((count, columns))
    found = np.empty_like(drawn)
    value = drawn[0]
    for row in range(count):
        value = value if row == 0 else keep * value + np.sqrt(1 - keep**2) * drawn[row]
        found[row] = value
    return found
