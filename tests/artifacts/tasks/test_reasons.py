"""Reasons of failed attempts: counted as one where only a measured number differs, and spelled."""

from __future__ import annotations

from dextera_build.artifacts.tasks.reasons import spelled, tally


def test_reasons_that_differ_by_what_was_measured_are_one():
    said = ["out of reach by 3 mm and 4 deg", "slipped at 2 m", "out of reach by 20 mm and 11 deg", "slipped at 3 m"]
    assert tally(said) == {"out of reach by N mm and N deg": 2, "slipped at 2 m": 1, "slipped at 3 m": 1}


def test_the_most_frequent_come_first():
    assert list(tally(["one", "two", "two"])) == ["two", "one"]


def test_all_but_the_most_frequent_are_others():
    counts = {"slipped": 3, "out of reach": 12, "dropped": 2, "touched": 2}
    assert spelled(counts, most=2) == "12 x out of reach, 3 x slipped, 4 x others"
    assert spelled(counts, most=4) == "12 x out of reach, 3 x slipped, 2 x dropped, 2 x touched"
    assert spelled({}, most=4) == ""
