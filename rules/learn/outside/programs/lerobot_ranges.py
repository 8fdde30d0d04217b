"""A LeRobot data set whose statistics have ranges of a least size, for the program of learn.lerobot."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

_PAIRS = (("min", "max"), ("q01", "q99"), ("q10", "q90"))
"""Ends of the ranges by which LeRobot scales, with other settings by other ones."""
Narrow = dict[str, list[bool]]
"""Lower end of a range, or `std` -> which numbers of a feature have less than the least."""


def linked(data: Path, to: Path, least: float) -> Path:
    """A folder that links all files of a data set but its statistics, which are widened.

    Args:
        data: The data set, of version v2.1 or v3.0.
        to: Where the folder is made anew.
        least: Least range of a number [rad or m].
    """
    shutil.rmtree(to, ignore_errors=True)
    (to / "meta").mkdir(parents=True)
    for path in [each for each in data.iterdir() if each.name != "meta"] + [*(data / "meta").iterdir()]:
        (to / path.relative_to(data)).symlink_to(path.resolve())
    whole = data / "meta" / "stats.json"
    stats = json.loads(whole.read_text())
    features = json.loads((data / "meta" / "info.json").read_text())["features"]
    numbers = [name for name, facts in features.items() if name in stats and _scaled(name, facts)]
    narrow = {name: _narrow(stats[name], least) for name in numbers}
    _replace(to / "meta" / whole.name, json.dumps(_widened(stats, narrow, least)))
    episodes = data / "meta" / "episodes_stats.jsonl"  # of v2.1, whose sum LeRobot scales by
    if episodes.is_file():
        rows = [json.loads(line) for line in episodes.read_text().splitlines()]
        wide = [{**row, "stats": _widened(row["stats"], narrow, least)} for row in rows]
        _replace(to / "meta" / episodes.name, "".join(f"{json.dumps(row)}\n" for row in wide))
    return to


def _scaled(name: str, facts: dict[str, Any]) -> bool:
    """Whether a feature is numbers that a policy sees or gives."""
    return str(facts["dtype"]).startswith("float") and (name == "action" or name.startswith("observation."))


def _narrow(stats: dict[str, Any], least: float) -> Narrow:
    """The numbers of a feature that hardly move in the whole data set."""
    ranges = {low: zip(stats[low], stats[high], strict=True) for low, high in _PAIRS if low in stats}
    found = {low: [above - below < least for below, above in ends] for low, ends in ranges.items()}
    return {**found, "std": [each < least / 4 for each in stats["std"]]}


def _widened(stats: dict[str, Any], narrow: dict[str, Narrow], least: float) -> dict[str, Any]:
    """Statistics by feature, in which every range of a narrow number is at least `least`, about its middle."""
    found = {name: dict(own) for name, own in stats.items()}
    for name, thin in narrow.items():
        own = found[name]
        for low, high in ((low, high) for low, high in _PAIRS if low in own):
            more = [
                max(least - (above - below), 0.0) / 2 if few else 0.0
                for below, above, few in zip(own[low], own[high], thin[low], strict=True)
            ]
            own[low] = [end - each for end, each in zip(own[low], more, strict=True)]
            own[high] = [end + each for end, each in zip(own[high], more, strict=True)]
        own["std"] = [max(std, least / 4) if few else std for std, few in zip(own["std"], thin["std"], strict=True)]
    return found


def _replace(path: Path, text: str) -> None:
    """Write a file in place of a link."""
    path.unlink(missing_ok=True)
    path.write_text(text)
