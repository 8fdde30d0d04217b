"""LeRobot's statistics: min, max, mean, std, count and quantiles per feature."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

Stats = dict[str, np.ndarray]
QUANTILES = {"q01": 0.01, "q10": 0.10, "q50": 0.50, "q90": 0.90, "q99": 0.99}


def of_numbers(values: np.ndarray) -> Stats:
    """Statistics (N,) of samples (T, N), in double precision."""
    exact = values.astype(np.float64)
    found = {
        "min": exact.min(axis=0),
        "max": exact.max(axis=0),
        "mean": exact.mean(axis=0),
        "std": exact.std(axis=0),
        "count": np.array([len(exact)], np.int64),
    }
    quantiles = np.quantile(exact, list(QUANTILES.values()), axis=0)
    return found | dict(zip(QUANTILES, quantiles, strict=True))


def of_all(episodes: Sequence[Mapping[str, np.ndarray]]) -> dict[str, Stats]:
    """Statistics by feature of the columns (T, N) of all episodes."""
    return {name: of_numbers(np.concatenate([columns[name] for columns in episodes])) for name in episodes[0]}


def histogram(pixels: np.ndarray) -> np.ndarray:
    """Counts (3, 256) of the 256 values in pictures (..., 3), per channel."""
    return np.stack([np.bincount(pixels[..., channel].ravel(), minlength=256) for channel in range(3)])


def counted(frames: Iterable[np.ndarray], counts: np.ndarray) -> Iterator[np.ndarray]:
    """The same frames; their values are added to `counts` (3, 256) on the way."""
    for frame in frames:
        counts += histogram(frame)
        yield frame


def of_pictures(counts: np.ndarray, frames: int, full: float = 255.0) -> Stats:
    """Statistics (C, 1, 1) of all pixels from counts (C, L) of their values 0..L-1, in units of `full`.

    Sums of counts are exact, so the statistics of a data set do not depend on its division into episodes.
    """
    levels = np.arange(counts.shape[1]) / full
    total = counts.sum(axis=1)
    mean = counts @ levels / total
    seen = [np.flatnonzero(row) for row in counts]
    found = {
        "min": levels[[row[0] for row in seen]],
        "max": levels[[row[-1] for row in seen]],
        "mean": mean,
        "std": np.sqrt((counts * (levels - mean[:, None]) ** 2).sum(axis=1) / total),
    }
    for name, part in QUANTILES.items():
        found[name] = np.array([_quantile(row, part) for row in counts]) / full
    return {name: value.reshape(-1, 1, 1) for name, value in found.items()} | {"count": np.array([frames], np.int64)}


def _quantile(counts: np.ndarray, part: float) -> float:
    """Quantile with linear interpolation, NumPy's default."""
    upto = np.cumsum(counts)
    rank = part * (upto[-1] - 1)
    low, high = (np.searchsorted(upto, side, side="right") for side in (np.floor(rank), np.ceil(rank)))
    return float(low + (high - low) * (rank - np.floor(rank)))


def plain(stats: dict[str, Stats]) -> dict[str, dict[str, object]]:
    """Convert statistics to JSON values."""
    return {feature: {name: value.tolist() for name, value in own.items()} for feature, own in stats.items()}
