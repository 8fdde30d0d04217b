"""evaluate.success, .outcomes and .paired: tables of trials."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.tasks.trials import Sighting, Trials
from dextera_build.errors import RuleError
from dextera_build.statistics import confidence_sequence, wilson
from dextera_build.testing import RuleRunner
from tests import series
from tests.series import trials


@pytest.fixture
def runner(tmp_path):
    return RuleRunner(tmp_path)


def together(*parts: Trials) -> Collection[Trials]:
    return Collection[Trials](items={f"part {number}": part for number, part in enumerate(parts)})


def ours() -> Collection[Trials]:
    return together(
        trials((93, 100)),
        trials((88, 100), world="reference"),
        trials((47, 50), "replay", "reference"),
        trials((70, 100), name="LiftBlueMug"),
        trials((60, 100), name="LiftBlueMug", world="reference"),
        trials((90, 100), "PPO"),
        trials((85, 100), "PPO", "reference"),
    )


def rows(table):
    names = [column.name for column in table.columns]
    return [dict(zip(names, row, strict=True)) for row in table.rows]


def test_a_row_per_task_with_both_worlds_and_the_replay(runner):
    table = runner.run("evaluate.success", trials=ours(), options={"paper": False})
    assert [column.name for column in table.columns] == ["task", "worlds", "trials", "ACT", "PPO", "replay"]
    laptop, mug, mean = rows(table)
    assert laptop == {
        "task": "KL: CloseLaptop",
        "worlds": "twin / reference",
        "trials": "100 / 100, replay 50",
        "ACT": "93 (86-97) / 88 (80-93)",
        "PPO": "90 (83-94) / 85 (77-91)",
        "replay": "94 (84-98)",
    }
    assert (mug["task"], mug["ACT"], mug["PPO"]) == ("KL: LiftBlueMug", "70 (60-78) / 60 (50-69)", None)
    assert mean["task"] == "mean of 2 tasks"
    assert mean["ACT"].startswith("82 (") or mean["ACT"].startswith("81 (")
    assert " / 74 (" in mean["ACT"]
    assert any("ACT over 2, PPO over 1, replay over 1" in note for note in table.notes)
    assert runner.outcome.line == "ACT 82 / 74, PPO 90 / 85, replay 47/50, 2 tasks"
    assert len(runner.outcome.previews) == 1


def test_the_paper_s_rows_are_marked_and_another_robot_s_too(runner):
    table = runner.run("evaluate.success", trials=ours(), options={"policies": ("ACT", "PPO", "T-S")})
    found = [row for row in rows(table) if str(row["worlds"]).startswith("paper")]
    laptop, mug, mean = found
    assert laptop["task"] == "KL: CloseLaptop"
    assert laptop["worlds"] == "paper: simulation / hardware"
    assert laptop["ACT"] == "100 (96-100) / 100 (84-100)"
    assert laptop["PPO"] is None
    assert laptop["T-S"].startswith("82 (")
    assert " / 75 (" in laptop["T-S"]
    assert laptop["replay"] == "100 (89-100)"
    assert mug["task"] == "OB: LiftBlueMug"
    assert mug["worlds"] == "paper, another robot: simulation / hardware"
    assert mug["ACT"].startswith("82 (")
    assert " / 100 (" in mug["ACT"]
    assert mean["task"] == "mean of 13 tasks"
    assert mean["ACT"].startswith("58 (")
    assert " / 54 (" in mean["ACT"]
    assert mean["replay"].startswith("88 (")


def test_a_task_that_the_paper_lacks_has_no_row_of_the_paper(runner):
    table = runner.run("evaluate.success", trials=together(trials((1, 2), name="OpenGate")))
    assert len(table.rows) == 2
    assert table.rows[0][1] == "twin / -"


def test_the_order_and_the_labels_of_the_inputs_do_not_matter(runner):
    one = runner.run("evaluate.success", trials=ours())
    turned = Collection[Trials](items={f"x{n}": part for n, part in enumerate(reversed(ours().items.values()))})
    assert runner.encode(runner.run("evaluate.success", trials=turned)) == runner.encode(one)


def test_a_perturbed_world_is_named_and_reference_comes_first(runner):
    table = runner.run(
        "evaluate.success",
        trials=together(*(trials((5, 10), world=world) for world in ("perturbed", "reference", "twin"))),
        options={"paper": False},
    )
    assert [row[1] for row in table.rows[:2]] == ["twin / reference", "twin / perturbed"]


def test_trials_with_a_tracker_have_rows_of_their_own(runner):
    exact = (trials((18, 20)), trials((17, 20), world="reference"))
    tracked = trials((14, 20), world="reference", poses="tracked")
    table = runner.run(
        "evaluate.success",
        trials=together(*exact, tracked, trials((19, 20), "replay", "reference", poses="tracked")),
        options={"paper": False},
    )
    first, second, mean, mean_tracked = rows(table)
    assert (first["worlds"], second["worlds"]) == ("twin / reference", "twin / reference, tracked")
    assert first["ACT"].startswith("90 (")
    assert " / 85 (" in first["ACT"]
    assert " / 70 (" in second["ACT"]
    assert (first["replay"], second["replay"][:4]) == (None, "95 (")
    assert (mean["worlds"], mean_tracked["worlds"]) == ("twin / other", "twin / other, tracked")
    assert (" / 85 (" in mean["ACT"], " / 70 (" in mean_tracked["ACT"]) == (True, True)
    moved = runner.run("evaluate.transfer", trials=together(*exact, tracked)).rows
    assert [row[0] for row in moved[:4]] == [
        *("cells: policy in a task", "cells, reference world", "cells, reference, tracked world"),
        "means of policies",
    ]
    assert [row[1] for row in moved[:4]] == [2, 1, 1, 2]


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ([], "there are no trials"),
        ([trials((1, 2)), trials((2, 2))], "two sets of trials are both `ACT` in the twin world of `KL: CloseLaptop`"),
        (
            [trials((1, 2)), trials((2, 2), world="reference", task=series.task(hold_s=0.1))],
            "success in `KL: CloseLaptop` was not judged alike: `hold_s`",
        ),
        (
            [trials((1, 2)), trials((2, 2), world="reference", embodiment="f" * 64)],
            "robots with other joints or limits are both called `KL`",
        ),
    ],
)
@pytest.mark.parametrize("rule", ["success", "success_rates", "paired", "transfer", "each_trial"])
def test_what_cannot_stand_in_one_table_is_refused(runner, rule, parts, message):
    with pytest.raises(RuleError) as caught:
        runner.run(f"evaluate.{rule}", trials=together(*parts))
    assert caught.value.message == message


def test_starts_may_be_drawn_differently_in_another_world(runner):
    from dextera_build.artifacts.tasks.task import Reset

    other = trials((2, 2), world="reference", task=series.task().model_copy(update={"reset": Reset(dynamics=0.0)}))
    assert runner.run("evaluate.success", trials=together(trials((1, 2)), other)).rows


def test_outcomes_have_times_and_reasons(runner):
    part = trials((3, 4), excluded={"no start": 2}, world="reference")
    table = runner.run("evaluate.success_rates", trials=together(part))
    (row,) = rows(table)
    assert (row["task"], row["actor"], row["world"]) == ("KL: CloseLaptop", "ACT", "reference")
    assert (row["trials"], row["successes"], row["success"]) == (4, 3, 75.0)
    assert row["low"] == pytest.approx(30.1, abs=0.1)
    assert row["mean time"] == pytest.approx((40 + 42 + 44) / 3 / 20)
    assert (row["failures"], row["left out"]) == ("1 x slipped", "2 x no start")
    assert row["progress"] == pytest.approx(100 * 3.5 / 4)
    assert row["progress, low"] < row["progress"] < row["progress, high"]
    assert runner.outcome.line == "1 sets of trials, 4 tries, 3 succeeded"


NOWHERE = {"distances_m": (), "angles_rad": (), "joints_rad": ()}
"""Errors of a tracker that nobody asks for."""


def test_outcomes_say_how_often_what_was_measured_was_judged_like_the_truth(runner):
    part = trials([True, True, False, False], poses="tracked", world="reference")
    seen = [True, False, False, None]
    items = [
        trial.model_copy(update={"sighting": Sighting(found_s=0.1, frames=9, tracked=8, success=verdict, **NOWHERE)})
        for trial, verdict in zip(part.items, seen, strict=True)
    ]
    tracked = part.model_copy(update={"items": tuple(items)})
    table = runner.run("evaluate.success_rates", trials=together(trials((1, 2)), tracked))
    assert [row["judged alike"] for row in rows(table)] == [None, "2 of 3"]


def test_reasons_come_by_frequency_and_a_few(runner):
    part = trials((0, 6))
    items = [
        trial.model_copy(update={"reason": reason})
        for trial, reason in zip(part.items, ["b", "a", "b", "c", "d", "b"], strict=True)
    ]
    table = runner.run(
        "evaluate.success_rates",
        trials=together(part.model_copy(update={"items": tuple(items)})),
        options={"reasons": 2},
    )
    assert rows(table)[0]["failures"] == "3 x b, 1 x a, 2 x others"
    assert rows(table)[0]["mean time"] is None


def test_pairs_are_matched_by_seed(runner):
    first = trials([True, True, False, True], seeds=[1, 2, 3, 4])
    second = trials([False, True, True], "PPO", seeds=[2, 4, 9])
    table = runner.run("evaluate.paired", trials=together(first, second))
    (row,) = rows(table)
    assert (row["first"], row["second"]) == ("ACT, twin", "PPO, twin")
    assert (row["starts"], row["placed alike"]) == (2, 2)
    assert (row["both"], row["only first"], row["only second"], row["neither"]) == (1, 1, 0, 0)
    assert (row["p"], row["e"], row["decided after"]) == (1.0, pytest.approx(1.0), None)
    assert row["difference"] == 50.0
    assert row["from"] < 0 < row["to"] <= 100.0


def test_other_worlds_are_compared_with_the_same_actor_alone(runner):
    moved = series.placed(range(8)) + np.array([0, 0, 0.01, 0, 0, 0, 0])
    table = runner.run(
        "evaluate.paired",
        trials=together(
            trials([True] * 8),
            trials([False] * 8, world="reference", placed=moved.astype("float32")),
            trials([True] * 8, "PPO"),
        ),
    )
    found = {(row["first"], row["second"]): row for row in rows(table)}
    assert set(found) == {("ACT, twin", "ACT, reference"), ("ACT, twin", "PPO, twin")}
    worlds = found["ACT, twin", "ACT, reference"]
    assert (worlds["only first"], worlds["placed alike"]) == (8, 0)
    assert worlds["p"] == pytest.approx(2 / 2**8)
    assert (worlds["e"], worlds["decided after"]) == (pytest.approx(2**8 / 9), 8)
    assert runner.outcome.line == "2 comparisons on the same starts, 1 decided"


def test_the_difference_of_two_trainings_is_averaged_over_tasks(runner):
    parts = [
        trials((count, 20), label, name=name)
        for name, pair in {"CloseLaptop": (18, 10), "LiftMug": (12, 12)}.items()
        for label, count in zip(("ACT", "ACT twin only"), pair, strict=True)
    ]
    *each, mean = rows(runner.run("evaluate.paired", trials=together(*parts)))
    assert [row["difference"] for row in each] == pytest.approx([40.0, 0.0])
    assert (mean["task"], mean["first"], mean["second"]) == ("mean of 2", "ACT, twin", "ACT twin only, twin")
    assert mean["difference"] == pytest.approx(20.0)
    assert 0 < mean["from"] < 20 < mean["to"]
    assert (mean["starts"], mean["p"], mean["decided after"]) == (None, None, None)


def test_trials_that_ended_with_their_decision_have_wider_intervals_and_no_p(runner):
    both = together(trials([True] * 8, stopped=True), trials([False] * 8, "PPO", stopped=True))
    (row,) = rows(runner.run("evaluate.paired", trials=both))
    assert (row["p"], row["difference"], row["decided after"]) == (None, None, 8)
    first = rows(runner.run("evaluate.success_rates", trials=both))[0]
    assert first["low"] == pytest.approx(100 * confidence_sequence(8, 8)[0])
    assert first["low"] < 100 * wilson(8, 8)[0]


def test_every_trial_has_a_row_with_its_stage(runner):
    found = rows(runner.run("evaluate.each_trial", trials=together(trials([True, False], seeds=[7, 9]))))
    first, second = found
    assert (first["seed"], first["success"], first["stage"], first["progress"]) == (7, True, "success", 100.0)
    assert (second["stage"], second["progress"], second["reason"]) == ("halfway", 50.0, "slipped")
    assert second["time"] == pytest.approx(42 / 20)
    assert runner.outcome.line == "2 trials of 1 sets"


def test_without_a_shared_start_nothing_can_be_compared(runner):
    parts = together(trials([True, False], seeds=[1, 2]), trials([True, False], "PPO", seeds=[3, 4]))
    with pytest.raises(RuleError, match="no two sets of trials share a start"):
        runner.run("evaluate.paired", trials=parts)
