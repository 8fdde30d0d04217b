"""How many trials a comparison, or an estimate in another world, takes: tests and intervals on simulated verdicts.

`python -m tests.benchmarks.fewer_trials` prints the tables of docs/benchmarks/trials.md. Verdicts are drawn from known
rates; the functions of `dextera_build.statistics` judge them.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator, Sequence

import numpy as np

from dextera_build.statistics import Paired, Rate, confidence_sequence, joined, wilson

ALPHA = 0.05
RUNS = 20_000
SEED = 0


def chances(first: float, second: float, shared: float) -> np.ndarray:
    """Chances (4,) of the cells of a pair: both, only the first, only the second, neither.

    Args:
        first: Rate of the first.
        second: Rate of the second.
        shared: 0: verdicts are independent; 1: they agree as often as the rates allow.
    """
    both = first * second + shared * (min(first, second) - first * second)
    return np.array([both, first - both, second - both, 1 - first - second + both]).clip(0.0)


def wins(cells: np.ndarray, starts: int, runs: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Starts that only the first, and only the second solved so far, two of (runs, starts) int."""
    drawn = rng.random((runs, starts))
    first = (drawn >= cells[0]) & (drawn < cells[0] + cells[1])
    second = (drawn >= cells[:2].sum()) & (drawn < cells[:3].sum())
    return first.cumsum(axis=1), second.cumsum(axis=1)


@functools.cache
def tested(most: int) -> tuple[np.ndarray, np.ndarray]:
    """Whether `Paired.e` decides, and whether `Paired.p` would, by the starts that only the first or the second solved.

    Args:
        most: Largest number of such starts of either side.

    Returns:
        Two of (most + 1, most + 1) bool.
    """
    pairs = [[Paired(0, first, second, 0) for second in range(most + 1)] for first in range(most + 1)]
    by_e = np.array([[pair.e >= 1 / ALPHA for pair in row] for row in pairs])
    return by_e, np.array([[pair.p <= ALPHA for pair in row] for row in pairs])


def sequential(first: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Whether series of `wins` are decided at any time (runs,), and starts used (runs,)."""
    starts = first.shape[1]
    over = tested(starts)[0][first, second]
    done = over.any(axis=1)
    return done, np.where(done, over.argmax(axis=1) + 1, starts)


def error(decisive: int) -> float:
    """Probability of ever naming a better one of two equal sides, within `decisive` starts that one side solves.

    Exact, not simulated.
    """
    open_, wrong = np.array([1.0]), 0.0
    for number in range(1, decisive + 1):
        open_ = 0.5 * (np.append(open_, 0.0) + np.append(0.0, open_))
        over = np.array([Paired(0, a, number - a, 0).e >= 1 / ALPHA for a in range(number + 1)])
        wrong += open_[over].sum()
        open_[over] = 0.0
    return float(wrong)


def fixed(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Whether McNemar's exact test decides series of `wins` if it ends after so many starts (runs, starts)."""
    return np.asarray(tested(first.shape[1])[1][first, second])


@functools.cache
def _joined(both: int, first: int, second: int, neither: int, more: int, rest: int) -> tuple[float, float, float]:
    """Ends of the interval of `joined`, and the trials that it is worth."""
    found = joined(Paired(both, first, second, neither), Rate(more, rest))
    return *found.interval(), found.trials


def estimate(cells: np.ndarray, pairs: int, rest: int, runs: int, rng: np.random.Generator) -> np.ndarray:
    """Coverage and mean width of the joined interval, the same of Wilson's, and the mean trials saved, (5,).

    Args:
        cells: See `chances`; the first is the twin.
        pairs: Number of starts in both worlds.
        rest: Number of other starts in the twin alone.
        runs: Number of simulated evaluations.
        rng: Draws the verdicts.
    """
    truth = cells[0] + cells[2]
    drawn = rng.multinomial(pairs, cells / cells.sum(), runs)
    more = rng.binomial(rest, cells[:2].sum(), runs)
    found = np.array([_joined(*row, extra, rest) for row, extra in zip(drawn.tolist(), more.tolist(), strict=True)])
    alone = np.array([wilson(count, pairs) for count in range(pairs + 1)])[drawn[:, 0] + drawn[:, 2]]
    ends = (found[:, :2], alone)
    shares = [((low <= truth) & (truth <= high)).mean() for low, high in (each.T for each in ends)]
    widths = [np.ptp(each, axis=1).mean() for each in ends]
    return np.array([shares[0], widths[0], shares[1], widths[1], found[:, 2].mean() - pairs])


def grid() -> Iterator[tuple[float, float, float]]:
    """Rates of twin and other world, and how far their verdicts agree."""
    for twin in (0.5, 0.8, 0.95):
        for other in (0.3, 0.5, 0.7, 0.9, 0.97):
            for shared in (0.0, 0.5, 0.9):
                yield twin, other, shared


def always(rate: float, trials: int, runs: int, rng: np.random.Generator) -> float:
    """Fraction of series in which the confidence sequence holds the true rate after every trial."""
    totals = (rng.random((runs, trials)) < rate).cumsum(axis=1)
    holds = np.ones((trials + 1, trials), bool)
    for number in range(1, trials + 1):
        for total in range(number + 1):
            low, high = confidence_sequence(total, number)
            holds[total, number - 1] = low <= rate <= high
    return float(holds[totals, np.arange(trials)].all(axis=1).mean())


def mean_progress(shares: Sequence[float], trials: int, runs: int, rng: np.random.Generator) -> float:
    """Coverage of Wilson's interval for the mean of stages that are reached with these chances (K,), 0 to K - 1."""
    steps = np.arange(len(shares)) / (len(shares) - 1)
    sums = rng.multinomial(trials, shares, runs) @ steps
    truth = float(np.array(shares) @ steps)
    return float(np.mean([low <= truth <= high for low, high in (wilson(total, trials) for total in sums)]))


COMPARED = [(0.9, 0.9), (0.5, 0.5), (0.9, 0.75), (0.7, 0.5), (0.9, 0.6), (0.6, 0.3), (0.9, 0.4)]


def main() -> None:
    """Print the tables."""
    rng = np.random.default_rng(SEED)
    print("wrong decisions of the sequential test, exact: ", end="")
    print(", ".join(f"{100 * error(count):.2f} % within {count}" for count in (20, 50, 200, 1000)))
    print(
        "\n| rates | agreement | starts | decided | starts used, mean | fixed test: decided | as strong a fixed test |"
    )
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for first, second in COMPARED:
        for shared, starts in ((0.0, 50), (0.0, 100), (0.5, 100)):
            series = wins(chances(first, second, shared), starts, RUNS, rng)
            done, used = sequential(*series)
            power = fixed(*series).mean(axis=0)
            alike = "-" if first == second else f"{np.argmax(power >= done.mean()) + 1} starts"
            numbers = f"{100 * done.mean():.1f} % | {used.mean():.0f} | {100 * power[-1]:.1f} % | {alike}"
            print(f"| {first:g}, {second:g} | {shared:g} | {starts} | {numbers} |")
    print("\n| pairs | twin alone | covered, joined: mean (least) | covered, Wilson | width | saved: mean (most) |")
    print("| --- | --- | --- | --- | --- | --- |")
    for pairs, rest in ((10, 90), (20, 80), (50, 50), (50, 200), (100, 900)):
        found = np.array([estimate(chances(*case), pairs, rest, RUNS // 4, rng) for case in grid()])
        shares = [f"{100 * found[:, column].mean():.1f} % ({100 * found[:, column].min():.1f})" for column in (0, 2)]
        width = 100 * (found[:, 1] / found[:, 3]).mean()
        saved = f"{found[:, 4].mean():.1f} ({found[:, 4].max():.1f})"
        print(f"| {pairs} | {rest} | {shares[0]} | {shares[1]} | {width:.0f} % | {saved} |")
    print("\nconfidence sequence holds after each of 200 trials:", end=" ")
    print(", ".join(f"rate {rate:g}: {100 * always(rate, 200, RUNS, rng):.1f} %" for rate in (0.5, 0.8, 0.95)))
    print("mean progress, 20 trials, covered:", end=" ")
    for shares in ((0.1, 0.1, 0.1, 0.1, 0.6), (0.0, 0.3, 0.0, 0.0, 0.7), (0.3, 0.3, 0.2, 0.1, 0.1)):
        print(f"{100 * mean_progress(shares, 20, RUNS, rng):.1f} %", end=" ")
    looks = fixed(*wins(chances(0.5, 0.5, 0.0), 150, RUNS, rng)).any(axis=1).mean()
    print(f"\nMcNemar's p below {ALPHA} at any of 150 starts, both rates 0.5: {100 * looks:.1f} %")


if __name__ == "__main__":
    main()
