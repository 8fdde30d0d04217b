"""The low pass against the definition of its cut-off, and at its edges."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.sim.retarget.low_pass import LowPass


def power(cut_off_hz: float, hz: float, rate_hz: float) -> float:
    """Power that a sine of `hz` keeps, after the filter has settled: over whole periods, by a regression."""
    times = np.arange(int(rate_hz * 40)) / rate_hz
    filtered, sine = LowPass(cut_off_hz), np.sin(2 * np.pi * hz * times)
    found = np.array([filtered.next(np.array([value]), 1 / rate_hz)[0] for value in sine])
    half = len(times) // 2
    waves = np.stack([np.sin(2 * np.pi * hz * times[half:]), np.cos(2 * np.pi * hz * times[half:])], axis=1)
    return float(np.square(np.linalg.lstsq(waves, found[half:], rcond=None)[0]).sum())


@pytest.mark.parametrize("rate_hz", [30.0, 72.0, 90.0])
@pytest.mark.parametrize("cut_off_hz", [2.0, 5.0, 10.0])
def test_half_of_the_power_passes_at_the_cut_off_at_every_rate(cut_off_hz: float, rate_hz: float) -> None:
    assert 10 * np.log10(power(cut_off_hz, cut_off_hz, rate_hz)) == pytest.approx(-10 * np.log10(2), abs=0.01)


def test_slow_motion_passes_and_fast_motion_does_not() -> None:
    assert power(5.0, 0.2, 72.0) > 0.99
    assert power(5.0, 25.0, 72.0) < 0.02


def test_a_constant_stays_and_the_first_value_is_not_delayed() -> None:
    filtered = LowPass(3.0)
    assert filtered.next(np.array([0.7]), 0.0)[0] == 0.7
    assert [filtered.next(np.array([0.7]), 0.01)[0] for _ in range(5)] == pytest.approx([0.7] * 5)


@pytest.mark.parametrize(("cut_off_hz", "seconds"), [(0.0, 0.01), (40.0, 1 / 72), (5.0, 0.1)])
def test_without_a_cut_off_below_half_of_the_rate_nothing_is_filtered(cut_off_hz: float, seconds: float) -> None:
    filtered = LowPass(cut_off_hz)
    filtered.next(np.zeros(1), 0.0)
    assert filtered.next(np.ones(1), seconds)[0] == 1.0


def test_it_stays_between_the_values_that_it_saw() -> None:
    filtered, random = LowPass(4.0), np.random.default_rng(0)
    found = [filtered.next(random.uniform(-1, 2, 3), random.uniform(1e-3, 0.2)) for _ in range(200)]
    assert np.min(found) >= -1
    assert np.max(found) <= 2
