"""Clocks of two devices, and spans of rest, against motions that are known."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from dextera_build.geometry import synchronisation

MOVES = ((0.8, 1.7), (2.6, 4.0), (5.1, 5.6), (7.0, 8.3), (9.3, 9.9), (11.2, 12.6), (13.5, 14.1))
"""Spans in which the joint moves [s]."""


def travelled(times: np.ndarray) -> np.ndarray:
    """Position of a joint that moves smoothly in MOVES, at unlike speeds [rad]."""
    found = np.zeros_like(times)
    for number, (start, end) in enumerate(MOVES):
        part = np.clip((times - start) / (end - start), 0.0, 1.0)
        found += (-1) ** number * 0.3 * (part * part * (3 - 2 * part))
    return found


def recorded(offset: float, seed: int = 0, repeat: bool = False) -> synchronisation.Offset | None:
    random = np.random.default_rng(seed)
    joints = np.arange(0.0, 16.0, 0.01)
    pictures = np.arange(0.5, 15.5, 1 / 30) + random.normal(0, 0.002, 450)
    move = (lambda t: 0.2 * np.sin(2 * np.pi * t)) if repeat else travelled
    positions = np.stack([move(joints), 0.5 * move(joints)], axis=1) + random.normal(0, 1e-4, (len(joints), 2))
    true = move(pictures + offset)
    changes = 0.4 + 8.0 * np.abs(np.diff(true)) ** 0.8 + random.normal(0, 0.02, len(pictures) - 1)
    return synchronisation.clock_offset(pictures, changes, joints, positions, 0.6)


@pytest.mark.parametrize("offset", [-0.31, -0.05, 0.0, 0.02, 0.18, 0.44])
def test_the_offset_is_found_within_its_sigma(offset):
    found = recorded(offset)
    assert found.correlation > 0.8
    assert found.rival < 0.8 * found.correlation
    assert found.sigma < 0.01
    assert abs(found.seconds - offset) < max(3 * found.sigma, 0.004)


def test_its_sigma_is_honest():
    """Of 40 recordings at most 4 are off by more than 2.5 sigma, and none by more than 10 ms."""
    errors = []
    for seed in range(40):
        found = recorded(0.11, seed)
        errors.append((abs(found.seconds - 0.11), found.sigma))
    far = sum(error > 2.5 * sigma for error, sigma in errors)
    assert far <= 4, errors
    assert max(error for error, _ in errors) < 0.01


def test_a_motion_that_repeats_has_a_rival():
    found = recorded(0.1, repeat=True)
    assert found.rival > 0.9 * found.correlation


def test_noise_is_not_correlated():
    random = np.random.default_rng(1)
    joints = np.arange(0.0, 16.0, 0.01)
    pictures = np.arange(0.5, 15.5, 1 / 30)
    changes = random.normal(1.0, 0.1, len(pictures) - 1)
    found = synchronisation.clock_offset(pictures, changes, joints, travelled(joints)[:, None], 0.6)
    assert found.correlation < 0.4


def test_too_little_tells_nothing():
    few = np.arange(10.0)
    assert synchronisation.clock_offset(few, few[1:], few, few[:, None], 0.5) is None
    long = np.arange(100) / 30
    assert synchronisation.clock_offset(long, np.ones(99), long, np.zeros((100, 1)), 0.5) is None


def test_rests_are_the_spans_between_motions():
    stamps = np.arange(0.0, 16.0, 0.01)
    noisy = travelled(stamps) + np.random.default_rng(2).normal(0, 2e-4, len(stamps))
    found = synchronisation.rests(stamps, noisy[:, None], slow=0.01, shortest_s=0.4)
    wanted = [
        (0.0, 0.8),
        *((end, start) for (_, end), (start, _) in itertools.pairwise(MOVES)),
        (14.1, 15.99),
    ]
    assert len(found) == len(wanted)
    for (start, end), (first, last) in zip(found, wanted, strict=True):
        assert first - 0.02 <= start <= first + 0.15
        assert last - 0.15 <= end <= last + 0.02


def test_a_gap_is_the_distance_to_the_nearest():
    found = synchronisation.nearest_gap(np.array([-1.0, 0.4, 0.6, 2.0, 9.0]), np.array([0.0, 1.0, 2.0]))
    np.testing.assert_allclose(found, [1.0, 0.4, 0.4, 0.0, 7.0])
