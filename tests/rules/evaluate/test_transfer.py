"""evaluate.transfer: how well the twin predicts the other world."""

from __future__ import annotations

import pytest

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.tasks.trials import Trials
from dextera_build.errors import RuleError
from dextera_build.statistics import Rate
from dextera_build.testing import RuleRunner
from tests.series import trials

TASKS = ("CloseLaptop", "LiftBlueMug", "LiftMustardBottle")


@pytest.fixture
def runner(tmp_path):
    return RuleRunner(tmp_path)


def cells(rates: dict[tuple[str, str], tuple[int, int]], world="reference") -> Collection[Trials]:
    parts = {}
    for (label, name), (here, there) in rates.items():
        parts[f"{label} {name}"] = trials((here, 100), label, name=name)
        parts[f"{label} {name} {world}"] = trials((there, 100), label, world, name=name)
    return Collection[Trials](items=parts)


def rows(table):
    names = [column.name for column in table.columns]
    return {row[0]: dict(zip(names, row, strict=True)) for row in table.rows}


def test_the_paper_s_numbers_come_out_of_the_paper_s_tables(runner):
    table = runner.run("evaluate.transfer", trials=cells({("ACT", name): (50, 50) for name in TASKS}))
    found = rows(table)
    everything, means = found["paper, cells: simulation and hardware"], found["paper, means of policies"]
    assert (everything["points"], everything["Pearson"]) == (78, pytest.approx(0.814, abs=5e-4))
    assert (means["points"], means["Pearson"], means["MMRV"]) == (6, pytest.approx(0.927, abs=5e-4), 0.0)
    assert means["low"] < 0.5 < 0.99 < means["high"]


def test_worlds_that_agree_correlate_and_rank_alike(runner):
    rates = {("ACT", name): (k, k - 10) for name, k in zip(TASKS, (90, 60, 30), strict=True)}
    table = runner.run("evaluate.transfer", trials=cells(rates), options={"paper": False})
    row = rows(table)["cells: policy in a task"]
    assert row["Pearson"] == pytest.approx(1.0)
    assert row["MMRV"] == 0.0
    assert (row["twin"], row["other world"]) == (pytest.approx(60), pytest.approx(50))
    assert rows(table)["means of policies"]["Pearson"] is None
    assert runner.outcome.line == "Pearson 1.00, MMRV 0.00 over 3 cells"
    assert len(runner.outcome.previews) == 1


def test_a_swapped_rank_shows(runner):
    rates = {("ACT", TASKS[0]): (90, 40), ("PPO", TASKS[0]): (80, 70)}
    table = runner.run("evaluate.transfer", trials=cells(rates), options={"paper": False})
    row = rows(table)["means of policies"]
    assert (row["points"], row["MMRV"], row["Pearson"]) == (2, pytest.approx(0.3), None)


def test_a_tie_in_the_twin_costs_half_and_the_notes_say_so(runner):
    rates = {("ACT", TASKS[0]): (80, 40), ("PPO", TASKS[0]): (80, 70)}
    table = runner.run("evaluate.transfer", trials=cells(rates), options={"paper": False})
    assert rows(table)["means of policies"]["MMRV"] == pytest.approx(0.15)
    assert any("of cells that tie in the twin alone, the better one counts" in note for note in table.notes)


def test_kinds_of_worlds_have_rows_of_their_own(runner):
    first = cells({("ACT", TASKS[0]): (90, 80), ("PPO", TASKS[0]): (70, 50)})
    second = cells({("ACT", TASKS[1]): (60, 60)}, world="perturbed")
    both = Collection[Trials](items={**first.items, **second.items})
    found = rows(runner.run("evaluate.transfer", trials=both, options={"paper": False}))
    assert found["cells, reference world"]["points"] == 2
    assert found["cells, perturbed world"]["points"] == 1
    assert found["cells: policy in a task"]["points"] == 3


def test_a_twin_that_agrees_narrows_the_other_world_s_interval(runner):
    """The first twenty starts were tried in both worlds, eighty more in the twin."""
    verdicts = [number % 4 > 0 for number in range(100)]
    both = {"twin": trials(verdicts), "other": trials(verdicts[:20], world="reference")}
    table = runner.run("evaluate.transfer", trials=Collection[Trials](items=both), options={"paper": False})
    found = rows(table)
    row = found["ACT in KL: CloseLaptop, reference world"]
    assert (row["trials"], row["other world"]) == (20, 75.0)
    alone = Rate(15, 20).interval()
    assert (row["other world, low"], row["other world, high"]) == pytest.approx([100 * end for end in alone])
    assert row["joined"] == pytest.approx(75.0)
    assert row["joined, high"] - row["joined, low"] < 0.8 * (row["other world, high"] - row["other world, low"])
    assert 10 < row["saved"] < 80
    assert found["cells: policy in a task"]["saved"] == row["saved"]
    assert found["means of policies"]["saved"] is None


@pytest.mark.parametrize(
    ("twin", "other"),
    [({}, {"seeds": range(100)}), ({"seeds": range(1, 101)}, {}), ({}, {"stopped": True}), ({"stopped": True}, {})],
    ids=["no other start", "a start of its own", "stopped", "a twin that was stopped"],
)
def test_where_the_twin_cannot_be_joined_the_other_world_stands_alone(runner, twin, other):
    count = len(other.get("seeds", range(20)))
    both = {"a": trials((50, 100), **twin), "b": trials((count // 2, count), world="reference", **other)}
    table = runner.run("evaluate.transfer", trials=Collection[Trials](items=both), options={"paper": False})
    row = rows(table)["ACT in KL: CloseLaptop, reference world"]
    assert (row["joined"], row["saved"], row["trials"]) == (None, None, count)


def test_replays_and_policies_of_one_world_alone_are_left_out(runner):
    parts = {
        **cells({("ACT", TASKS[0]): (90, 80)}).items,
        "r": trials((50, 50), "replay", "reference"),
        "p": trials((1, 100), "PPO"),
    }
    found = rows(runner.run("evaluate.transfer", trials=Collection[Trials](items=parts), options={"paper": False}))
    assert found["cells: policy in a task"]["points"] == 1


def test_one_world_alone_predicts_nothing(runner):
    with pytest.raises(RuleError, match="no policy was tried both in a twin and in another world") as caught:
        runner.run("evaluate.transfer", trials=Collection[Trials](items={"a": trials((1, 2))}))
    assert caught.value.facts["cells"] == "ACT in KL: CloseLaptop (twin)"
