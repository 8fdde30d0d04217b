"""Histories of edits, builds, failures, kills, refusals, collections and damage, against the reference."""

from __future__ import annotations

import pytest
from hypothesis import HealthCheck, Phase, settings
from hypothesis.stateful import run_state_machine_as_test

from tests.oracle.histories import Histories, HistoriesWithWorkers


def play(histories: int, steps: int, machine: type[Histories] = Histories) -> None:
    """Try so many histories; a failing one is said as it was found, then made smaller."""
    run_state_machine_as_test(
        machine,
        settings=settings(
            max_examples=histories,
            stateful_step_count=steps,
            deadline=None,
            database=None,
            phases=(Phase.generate, Phase.shrink),
            suppress_health_check=list(HealthCheck),
        ),
    )


@pytest.mark.medium
def test_a_few_histories_end_as_the_reference_says() -> None:
    """Promise: after any history a build is what a build of everything would be, and runs only what is stale."""
    play(8, 8)


@pytest.mark.slow
@pytest.mark.timeout(3000)
@pytest.mark.parametrize("part", range(4))
def test_hundreds_of_histories_end_as_the_reference_says(part: int) -> None:
    """Promise: the same, 150 histories in each of four parts."""
    play(150, 12)


@pytest.mark.slow
@pytest.mark.timeout(3000)
def test_histories_with_worker_processes_end_as_the_reference_says() -> None:
    """Promise: the same where workers run nodes and publish results."""
    play(40, 6, HistoriesWithWorkers)
