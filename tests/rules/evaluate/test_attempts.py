"""Trials that are killed go on where they were, and end with the same bytes."""

from __future__ import annotations

import pytest

from dextera_build.artifacts.tasks.trials import Trials
from dextera_build.testing import RuleRunner
from tests import gate
from tests.rules.evaluate.test_rollouts import saying
from tests.sim.runtime import cells

SEVERAL = {"trials": 5}


class KilledError(Exception):
    """What a kill looks like to the code that runs."""


def killed_after(monkeypatch: pytest.MonkeyPatch, runner: RuleRunner, count: int) -> list[int]:
    """Kill the next call after some attempts; the list is of the seeds that calls have tried since."""
    module = runner.find("evaluate.rollouts").backends["mujoco"].module
    real, tried = module.rollouts, []

    def counted(*given):
        for number, attempt in enumerate(real(*given)):
            if number == count and len(tried) == count:
                raise KilledError
            tried.append(attempt.seed)
            yield attempt

    monkeypatch.setattr(module, "rollouts", counted)
    return tried


@pytest.mark.slow
@pytest.mark.parametrize("tracked", [False, True])
def test_the_trials_that_were_done_are_not_made_again(tmp_path, monkeypatch, tracked):
    bundle = gate.bundle("reference", yaw_rad=0.5)
    given = {"bundle": bundle, "checkpoint": saying(0.65, bundle)} | ({"cell": cells.cell()} if tracked else {})
    alone, runner = (RuleRunner(tmp_path / name, made_by={"checkpoint": "learn.act"}) for name in ("whole", "parts"))
    whole: Trials = alone.run("evaluate.rollouts", options=SEVERAL, **given)
    tried = killed_after(monkeypatch, runner, 3)
    with pytest.raises(KilledError):
        runner.run("evaluate.rollouts", options=SEVERAL, **given)
    again: Trials = runner.run("evaluate.rollouts", options=SEVERAL, **given)
    assert tried == [trial.seed for trial in whole.items]
    assert runner.encode(again) == runner.encode(whole)
    assert not (tmp_path / "parts" / "keep").exists()
