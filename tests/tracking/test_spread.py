"""Stated errors of a fit: what averages out, what stays, what nothing determines, and what an earlier view leaves."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.geometry import transforms
from dextera_build.geometry.lie import rotation
from dextera_build.tracking import spread
from dextera_build.tracking.terms import Look, Rows, Spots


def rows(count: int, noise: float = 0.0, lasting: float = 0.0, patches: int = 4, size: int = 6) -> Rows:
    """Rows that determine all motions equally."""
    jacobian = np.random.default_rng(0).normal(size=(count, size))
    weight, patch = np.full(count, 1e6), np.arange(count) % patches
    return Rows(jacobian, np.zeros(count), weight, np.full(count, noise), np.full((count, 1), lasting), patch)


def deviation(found: np.ndarray) -> float:
    return float(np.sqrt(np.trace(found[:3, :3]) / 3))


def test_noise_averages_out_over_rows_and_frames() -> None:
    few, many = (spread.of([rows(count, noise=1e-2)], None) for count in (400, 1600))
    assert deviation(few.covariance()) == pytest.approx(1e-2 / np.sqrt(400), rel=0.1)
    assert deviation(many.covariance()) == pytest.approx(0.5 * deviation(few.covariance()), rel=0.1)
    assert deviation(few.covariance(25)) == pytest.approx(0.2 * deviation(few.covariance()), rel=0.05)


def test_what_is_alike_in_a_patch_does_not() -> None:
    """More rows of the same surface tell nothing new of a mesh that is off there."""
    directions = np.random.default_rng(1).normal(size=(8, 6))

    def bent(each: int) -> spread.Spread:
        jacobian, patch = np.repeat(directions, each, axis=0), np.repeat(np.arange(8), each)
        count = len(patch)
        made = Rows(jacobian, np.zeros(count), np.full(count, 1e6), np.zeros(count), np.full((count, 1), 2e-3), patch)
        return spread.of([made], None)

    few, many = bent(10), bent(1000)
    assert many.covariance() == pytest.approx(few.covariance(), rel=0.05)
    assert deviation(many.covariance(50)) == pytest.approx(deviation(many.covariance()), rel=0.05)
    expected = 2e-3**2 * np.linalg.inv(directions.T @ directions)
    assert many.covariance() == pytest.approx(expected, rel=0.05, abs=1e-9)


def test_residuals_that_a_patch_has_in_common_are_an_error() -> None:
    good = rows(400, noise=1e-3)
    worse = Rows(good.jacobian, np.where(good.patch == 0, 0.02, 0.0), *_rest(good))
    assert deviation(spread.of([worse], None).covariance()) > 2 * deviation(spread.of([good], None).covariance())


def _rest(made: Rows) -> tuple[np.ndarray, ...]:
    return made.weight, made.noise, made.lasting, made.patch


def test_what_no_row_determines_is_said_to_be_unknown() -> None:
    """Such as the turn of a plain round thing."""
    made = rows(300, noise=1e-3)
    made.jacobian[:, 5] = 0.0
    found = spread.of([made], None).covariance()
    assert np.sqrt(found[5, 5]) == pytest.approx(1.8, rel=1e-3)
    assert deviation(found) < 1e-3


def test_an_error_of_the_earlier_view_is_repeated() -> None:
    earlier = np.diag([1e-3, 2e-3, 3e-3, 0.01, 0.02, 0.03]) ** 2
    assert spread.of([rows(2000, noise=1e-5)], earlier).covariance() == pytest.approx(earlier, rel=0.05, abs=1e-7)


def test_that_error_turns_with_the_object() -> None:
    spots = Spots(np.zeros((1, 3)), np.zeros((1, 3)), np.zeros(1, np.int64))
    wide = np.diag([1e-3, 0.0, 0.0, 0.0, 0.0, 0.0]) ** 2
    look = Look(spots, np.zeros(1), np.array([0.0, 0.0, 1.0]), np.eye(3), wide)
    now = transforms.rigid(rotation(np.array([0.0, 0.0, np.pi / 2])), np.zeros(3))
    assert np.sqrt(np.diag(look.error(now))) == pytest.approx([0.0, 1e-3, 0.0, 0.0, 0.0, 0.0], abs=1e-9)
