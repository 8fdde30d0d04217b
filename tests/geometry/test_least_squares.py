"""Searches: they end at the minimum, refuse what is worse, and obey their schedules."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest
from scipy import optimize

from dextera_build.geometry import least_squares, lie, transforms
from dextera_build.geometry.least_squares import Local, Normal, Schedule

POINTS = np.random.default_rng(0).normal(size=(40, 3))
ROWS, OFF = np.random.default_rng(1).normal(size=(30, 3)), np.random.default_rng(2).normal(size=30)
WEIGHT = np.random.default_rng(3).uniform(0.1, 2.0, 30)


def test_a_step_is_that_of_weighted_least_squares_with_a_prior():
    sigma, expected = np.array([0.5, 2.0, np.inf]), np.array([0.3, -0.1, 7.0])
    found = (least_squares.normal(ROWS, OFF, WEIGHT) + least_squares.prior(sigma, expected)).solved()
    root = np.sqrt(WEIGHT)[:, None]
    stacked = np.concatenate([root * ROWS, np.diag(1.0 / sigma)])
    wanted = np.concatenate([root[:, 0] * OFF, expected / sigma])
    assert found == pytest.approx(np.linalg.lstsq(stacked, wanted, rcond=None)[0])


def test_a_step_within_a_basis_is_the_best_of_its_steps():
    basis = np.array([[1.0, 0.0], [1.0, 0.0], [0.0, 2.0]])
    found = least_squares.normal(ROWS, OFF, WEIGHT).within(basis).solved()
    assert found == pytest.approx(least_squares.normal(ROWS @ basis, OFF, WEIGHT).solved())


def test_the_shortest_step_leaves_out_what_no_row_determines():
    flat = ROWS * [1.0, 1.0, 0.0]
    found = least_squares.normal(flat, OFF, WEIGHT).shortest(1e-10)
    assert found[:2] == pytest.approx(least_squares.normal(flat[:, :2], OFF, WEIGHT).solved())
    assert found[2] == 0.0


def test_robust_weights():
    off = np.array([0.0, 0.5, 1.0, 2.0, 4.0])
    assert least_squares.huber(off, 1.0).tolist() == [1.0, 1.0, 1.0, 0.5, 0.25]
    assert least_squares.tukey(-off, 2.0) == pytest.approx([1.0, (15 / 16) ** 2, (3 / 4) ** 2, 0.0, 0.0])


def test_gauss_newton_finds_a_pose_and_stops_when_it_is_there():
    truth = lie.retract(np.eye(4), [0.1, -0.2, 0.3, 0.4, -0.3, 0.2])
    target, normals = transforms.apply(truth, POINTS), np.roll(POINTS, 1, axis=0)

    def step(now: np.ndarray, _: int) -> tuple[np.ndarray, np.ndarray]:
        placed = transforms.apply(now, POINTS)
        rows = lie.point_to_plane_rows(placed - now[:3, 3], normals)[:, :6]
        off = ((target - placed) * normals).sum(axis=1)
        change = least_squares.normal(rows, off, np.ones(len(off))).solved()
        return change, lie.retract(now, change)

    found = list(least_squares.gauss_newton(np.eye(4), step, range(50), still=1e-9))
    assert found[-1] == pytest.approx(truth, abs=1e-12)
    assert found[0] is not truth
    assert 3 < len(found) < 12


def test_gauss_newton_gives_the_start_and_ends_where_no_step_is_found():
    def step(now: float, gate: float) -> tuple[np.ndarray, float] | None:
        return None if gate < 1.0 else (np.ones(1), now + gate)

    assert list(least_squares.gauss_newton(0.0, step, [4.0, 2.0, 0.5, 8.0])) == [0.0, 4.0, 6.0]
    assert list(least_squares.gauss_newton(0.0, step, [])) == [0.0]


@dataclass
class Valley:
    """Rosenbrock's function; undamped steps leave the valley."""

    tried: list[np.ndarray] = field(default_factory=list)
    linearised: int = 0

    def at(self, p: np.ndarray) -> np.ndarray:
        self.tried.append(p)
        return np.array([10.0 * (p[1] - p[0] ** 2), 1.0 - p[0]])

    def value(self, seen: np.ndarray, before: np.ndarray) -> float:
        return float(seen @ seen)

    def local(self, p: np.ndarray, seen: np.ndarray) -> Local:
        self.linearised += 1
        found = least_squares.normal(np.array([[-20.0 * p[0], 10.0], [-1.0, 0.0]]), -seen, np.ones(2))
        return Local(found, np.diag(found.matrix))

    def moved(self, p: np.ndarray, step: np.ndarray) -> np.ndarray:
        return p + step


START = np.array([-1.2, 1.0])


def searched(schedule: Schedule) -> tuple[Valley, np.ndarray, np.ndarray]:
    valley = Valley()
    found, seen = least_squares.levenberg_marquardt(START, valley.at(START), valley, schedule)
    return valley, found, seen


def taken_in(valley: Valley) -> int:
    """Number of steps that were better than all before."""
    values = [float(np.square(valley.at(p)).sum()) for p in tuple(valley.tried)]
    return sum(value < min(values[:k]) for k, value in enumerate(values) if k)


def test_levenberg_marquardt_reaches_the_minimum_and_takes_only_steps_down():
    valley, found, seen = searched(Schedule(100, gain=1e-9))
    tried, linearised = len(valley.tried) - 1, valley.linearised
    assert found == pytest.approx(optimize.least_squares(Valley().at, START).x, abs=1e-4)
    assert seen == pytest.approx(valley.at(found))
    assert linearised <= 1 + taken_in(valley) < tried, "a refused step needs no new derivatives"


@pytest.mark.parametrize(
    ("schedule", "tried"),
    [(Schedule(7), 7), (Schedule(0), 0), (Schedule(100, still=1e3), 0), (Schedule(100, promise=1e3), 0)],
    ids=["tries", "none", "still", "promise"],
)
def test_a_search_tries_what_its_schedule_says(schedule, tried):
    valley, _, _ = searched(schedule)
    assert len(valley.tried) == 1 + tried


@pytest.mark.parametrize(
    ("schedule", "taken"), [(Schedule(100, taken=3), 3), (Schedule(100, gain=0.9999), 1)], ids=["taken", "gain"]
)
def test_a_search_takes_what_its_schedule_says(schedule, taken):
    valley, _, _ = searched(schedule)
    assert taken_in(valley) == taken


@pytest.mark.parametrize(("schedule", "evaluations"), [(Schedule(100, in_turn=4), 4), (Schedule(100, most=1.0), 4)])
def test_a_search_that_finds_nothing_better_gives_up(schedule, evaluations):
    class Worse(Valley):
        def value(self, seen: np.ndarray, before: np.ndarray) -> float:
            return 0.0 if seen is before else 1.0

    worse = Worse()
    found, _ = least_squares.levenberg_marquardt(START, worse.at(START), worse, schedule)
    assert found is START
    assert len(worse.tried) == 1 + evaluations
    assert worse.linearised == 1
    scale = np.sqrt(worse.local(START, worse.at(START)).scale)
    steps = [np.linalg.norm(scale * (each - START)) for each in worse.tried[1 : 1 + evaluations]]
    assert steps == sorted(steps, reverse=True), "every refused step is followed by a shorter one"


def test_what_a_step_promises_is_the_decrease_of_the_linear_model():
    local = Local(Normal(np.array([[4.0]]), np.array([8.0])), np.array([4.0]))
    assert local.gain(local.step(0.0)) == pytest.approx(8.0)
    assert local.step(1.0) == pytest.approx([1.0])
    assert Local(local.normal, local.scale, floor=4.0).step(0.0) == pytest.approx([1.0])
