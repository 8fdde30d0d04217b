"""Measurements are ordered by stamp; clocks that were set, and delays, are noticed."""

from __future__ import annotations

import pytest

from dextera_build.deploying.stream import Sample, Stream

MS = 1_000_000


def stream(*pairs: tuple[int, int]) -> Stream:
    """Measurements from (stamp, arrival) [ms]."""
    made = Stream("/states")
    for stamp, arrived in pairs:
        made.add(Sample(stamp * MS, arrived * MS, stamp))
    return made


def test_offset_is_that_of_the_shortest_delay() -> None:
    made = stream((0, 1030), (10, 1020), (20, 1050))
    assert made.offset_s == pytest.approx(1.010, abs=1e-5)
    assert made.late_s() == pytest.approx(0.020, abs=1e-5)
    assert made.silent_s(1090 * MS) == pytest.approx(0.040)
    assert made.rate_hz() == pytest.approx(100.0)


def test_the_nearest_is_found_by_stamp() -> None:
    made = stream((0, 5), (10, 15), (20, 25))
    found = made.nearest(12 * MS)
    assert found is not None
    assert found.value == 10


def test_a_measurement_that_comes_after_a_newer_one_is_left_out() -> None:
    made = stream((0, 5), (20, 25), (10, 26))
    assert made.last is not None
    assert (made.last.value, made.stale, made.fault) == (20, 1, "")


@pytest.mark.parametrize(("stamp", "told"), [(2010, "+2.00 s"), (-1990, "-2.00 s")])
def test_a_clock_that_was_set_is_a_fault_for_good(stamp: int, told: str) -> None:
    made = stream((0, 5), (stamp, 15), (20, 25))
    assert made.fault == f"the stamps of `/states` jumped by {told}"


def test_the_clock_of_both_that_was_set_back_is_a_fault() -> None:
    assert stream((5000, 5005), (3010, 3015)).fault == "the stamps of `/states` jumped by -1.99 s"


def test_a_fast_stream_keeps_as_long_as_a_slow_one() -> None:
    made = stream(*((now, now + 1) for now in range(3000)))
    found = made.nearest(1100 * MS)
    assert found is not None
    assert found.value == 1100


def test_a_clock_that_is_slower_than_the_one_here_is_no_delay() -> None:
    made, slower = Stream("/states"), 50e-6
    for second in range(0, 3600, 2):
        made.add(Sample(round(second * 1000 * (1 - slower) * MS), (second * 1000 + 5) * MS, None))
        assert made.late_s() < 0.001
    assert made.offset_s == pytest.approx(0.005 + 3600 * slower, abs=0.001)


def test_the_first_answers_of_a_tracker_may_be_slow() -> None:
    def fed(**options: bool) -> Stream:
        made = Stream("/tf", of="cube", **options)
        for second in range(10):
            made.add(Sample(1000 * second * MS, (1000 * second + 750) * MS, None))
        made.add(Sample(10_000 * MS, 10_060 * MS, None))
        return made

    assert fed(steady=False).fault == ""
    assert fed(steady=False).offset_s == pytest.approx(0.06)
    assert "jumped by +0.69 s" in fed().fault


def test_a_message_that_is_very_late_is_no_fault_of_its_own() -> None:
    made = stream((0, 5), (10, 915))
    assert made.fault == ""
    assert made.late_s() == pytest.approx(0.9, abs=1e-3)
    made.add(Sample(900 * MS, 915 * MS, None))
    assert made.fault == ""
    assert made.late_s() == pytest.approx(0.01, abs=1e-3)
    assert stream().late_s() == float("inf")
