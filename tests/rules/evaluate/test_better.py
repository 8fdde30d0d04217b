"""evaluate.better: two policies on the same starts, until it is decided which one is better."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.tasks.trials import Compared, Trials
from dextera_build.errors import RuleError
from dextera_build.testing import RuleRunner
from tests import episodes, gate
from tests.policy import policies
from tests.rules.evaluate.test_rollouts import nothing, saying

MADE_BY = {"first": "learn.act", "second": "learn.act"}
LABELS = {"first_label": "pushes", "second_label": "stops"}


@pytest.fixture
def runner(tmp_path):
    return RuleRunner(tmp_path, made_by=MADE_BY)


@pytest.mark.medium
def test_the_trials_end_when_one_policy_is_the_better_one(runner):
    bundle = gate.bundle()
    given = {"bundle": bundle, "first": saying(gate.PUSHES, bundle), "second": saying(gate.STOPS_SHORT, bundle)}
    found: Compared = runner.run("evaluate.better", **given, options={"trials": 30, **LABELS})
    # Eight wins in a row have an e-value of 256 / 9.
    assert found.decided == 8
    assert (found.first.successes, found.second.successes) == (8, 0)
    assert [len(part.items) for part in (found.first, found.second)] == [8, 8]
    assert found.first.stopped
    assert [trial.start for trial in found.first.items] == [trial.start for trial in found.second.items]
    assert np.array_equal(found.first.placed, found.second.placed)
    assert runner.outcome.line == "pushes is better, known after 8 starts: pushes 8/8 against stops 0/8"
    assert runner.outcome.metrics["pushes: success"] == (100.0, "%")
    assert runner.outcome.metrics["stops: progress"] == (25.0, "%")
    parts = Collection[Trials](items={"first": found.first, "second": found.second})
    (row,) = runner.run("evaluate.paired", trials=parts).rows
    assert row[1:5] == ("pushes, twin", "stops, twin", 8, 8)
    assert row[-1] == 8


@pytest.mark.slow
def test_its_trials_are_those_of_rollouts(runner, tmp_path):
    bundle = gate.bundle()
    first, second = saying(gate.PUSHES, bundle), saying(gate.STOPS_SHORT, bundle)
    found = runner.run(
        "evaluate.better", bundle=bundle, first=first, second=second, options={"trials": 2, "seed": 3, **LABELS}
    )
    alone = RuleRunner(tmp_path / "alone", made_by={"checkpoint": "learn.act"})
    for checkpoint, part in ((first, found.first), (second, found.second)):
        same = alone.run("evaluate.rollouts", bundle=bundle, checkpoint=checkpoint, options={"trials": 2, "seed": 3})
        assert same.items == part.items
    assert found.decided is None
    assert runner.outcome.line == "open after 2 starts: pushes 2/2 against stops 0/2"


@pytest.mark.medium
def test_the_picture_goes_to_the_policy_that_sees(runner):
    bundle, view = gate.bundle(), gate.view()
    sees = saying(gate.PUSHES, bundle, ("joints", "rgb"), view)
    found = runner.run(
        "evaluate.better",
        bundle=bundle,
        first=saying(gate.PUSHES, bundle),
        second=sees,
        view=view,
        options={"trials": 1},
    )
    assert (found.first.label, found.second.label) == ("ACT", "ACT image")
    assert (found.first.successes, found.second.successes) == (1, 1)


@pytest.mark.slow
def test_trials_that_were_done_are_not_made_again(tmp_path, monkeypatch):
    bundle = gate.bundle()
    given = {"bundle": bundle, "first": saying(gate.PUSHES, bundle), "second": saying(gate.STOPS_SHORT, bundle)}
    options = {"trials": 3, **LABELS}
    whole = RuleRunner(tmp_path / "whole", made_by=MADE_BY)
    expected = whole.encode(whole.run("evaluate.better", **given, options=options))
    parts = RuleRunner(tmp_path / "parts", made_by=MADE_BY)
    module = parts.find("evaluate.better").backends["mujoco"].module
    real, made = module.better, []

    def tired(*words):
        for attempt in real(*words):
            if len(made) == 3:
                raise KeyboardInterrupt
            made.append(attempt)
            yield attempt

    monkeypatch.setattr(module, "better", tired)
    with pytest.raises(KeyboardInterrupt):
        parts.run("evaluate.better", **given, options=options)
    monkeypatch.setattr(module, "better", real)
    assert parts.encode(parts.run("evaluate.better", **given, options=options)) == expected


def test_two_policies_need_two_names(runner):
    bundle = gate.bundle()
    with pytest.raises(RuleError, match="both policies are called `ACT`"):
        runner.run(
            "evaluate.better",
            bundle=bundle,
            first=saying(gate.PUSHES, bundle),
            second=saying(gate.STOPS_SHORT, bundle),
        )


def test_a_checkpoint_for_something_else_is_refused(runner):
    bundle, arm = gate.bundle(), policies.checkpoint(policies.contract(episodes.bundle()))
    with pytest.raises(RuleError, match="another embodiment"):
        runner.run("evaluate.better", bundle=bundle, first=saying(gate.PUSHES, bundle), second=arm, options=LABELS)


def test_with_stubs_two_equal_policies_stay_open(runner):
    found = runner.run(
        "evaluate.better",
        profile="stub",
        bundle=episodes.bundle(),
        first=nothing(),
        second=nothing(),
        options={"trials": 12, **LABELS},
    )
    assert found.decided is None
    assert len(found.first.items) == 12
