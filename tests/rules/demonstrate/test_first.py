"""demonstrate.first: successes, and what goes wrong where there are none."""

from __future__ import annotations

from pathlib import Path

from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.testing import RuleRunner
from tests import episodes


def failed() -> Episodes:
    """Two attempts of 6 and 12 steps, neither of which succeeded."""
    short, long = (
        next(iter(episodes.small(1, count).items.values())).model_copy(update={"success": False, "reason": reason})
        for count, reason in ((6, "touched the table"), (12, "dropped"))
    )
    return episodes.small(1, 6).model_copy(
        update={"items": {}, "failures": {"00000": short, "00001": long}, "attempts": 2}
    )


def test_the_first_successes_are_kept_without_failures(tmp_path: Path) -> None:
    kept = RuleRunner(tmp_path).run("demonstrate.first", episodes=episodes.small(3, 6))
    assert list(kept.items) == ["0"]
    assert (kept.failures, kept.attempts) == ({}, 1)


def test_the_longest_failure_is_kept_where_asked_for_and_none_succeeded(tmp_path: Path) -> None:
    runner = RuleRunner(tmp_path)
    assert runner.run("demonstrate.first", episodes=failed()).items == {}
    kept = runner.run("demonstrate.first", episodes=failed(), options={"failed": True})
    assert list(kept.items) == ["00001"]
    assert runner.outcome.line == "no success; failed: dropped"
    successes = runner.run("demonstrate.first", episodes=episodes.small(3, 6), options={"failed": True})
    assert list(successes.items) == ["0"]
