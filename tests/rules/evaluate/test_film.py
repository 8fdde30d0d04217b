"""evaluate.film: a success and a failure side by side, as they were recorded."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.cameras.video import Video
from dextera_build.artifacts.tasks.trials import Trials
from dextera_build.errors import RuleError
from dextera_build.sim.render.stills import Stills
from dextera_build.testing import RuleRunner
from rules.evaluate.panels import GAP
from tests import gate
from tests.rules.evaluate.test_rollouts import saying

BUNDLE = gate.bundle()


def tried(tmp_path: Path, goal: float) -> Trials:
    runner = RuleRunner(tmp_path, made_by={"checkpoint": "learn.act"})
    made = runner.run("evaluate.rollouts", bundle=BUNDLE, checkpoint=saying(goal, BUNDLE), options={"trials": 1})
    assert isinstance(made, Trials)
    return made


def filmed(tmp_path: Path, trials: dict[str, Trials], backend: str = "mujoco", **more: Any) -> tuple[Video, RuleRunner]:
    runner = RuleRunner(tmp_path)
    inputs: dict[str, Any] = {"bundle": BUNDLE, "trials": Collection[Trials](items=trials)} | more
    made = runner.run("evaluate.film", backend=backend, options={"width_px": 96}, **inputs)
    assert isinstance(made, Video)
    return made, runner


def frames(made: Video) -> np.ndarray:
    return np.stack(list(made.every()))


@pytest.mark.slow
def test_a_success_is_on_the_left_and_a_failure_on_the_right(tmp_path: Path) -> None:
    pushes, waits = tried(tmp_path, gate.PUSHES), tried(tmp_path, 0.0)
    assert (pushes.successes, waits.successes) == (1, 0)
    failed = waits.examples.failures["0"]
    examples = pushes.examples.model_copy(update={"failures": {"1": failed}})
    made, runner = filmed(tmp_path, {"act": pushes.model_copy(update={"examples": examples}), "none": waits})
    pictures = frames(made).astype(int)
    steps, rate = len(failed.action), BUNDLE.task.control_hz
    assert len(made.stamps) / 10.0 == pytest.approx(2 * steps / rate, abs=0.5)
    # Above the pictures of 96 x 72 px are their titles, and between them a gap.
    rows, top = np.arange(0, steps + 1, round(rate / 10)), len(pictures[0]) - 72 - GAP
    for episode, left in ((pushes.examples.items["0"], 0), (failed, 96 + GAP)):
        wanted = Stills(BUNDLE, None, 96).at(episode, rows).astype(int)
        shown = pictures[: len(rows), top : top + 72, left : left + 96]
        assert np.abs(shown - wanted).mean() < 4
        assert np.abs(shown[::-1] - wanted).mean() > np.abs(shown - wanted).mean()
    # The second policy has no success: its failure is alone.
    assert pictures[-1][top:, 96 + GAP :].min() > 240
    assert "3 episodes of 2 policies" in runner.outcome.line


def test_trials_of_another_world_are_refused(tmp_path: Path) -> None:
    runner = RuleRunner(tmp_path, made_by={"checkpoint": "learn.act"})
    checkpoint = saying(gate.PUSHES, BUNDLE)
    made = runner.run("evaluate.rollouts", backend="stub", bundle=BUNDLE, checkpoint=checkpoint, options={"trials": 2})
    video, _ = filmed(tmp_path, {"act": made}, backend="stub")
    assert len(frames(video)) > 1
    elsewhere = BUNDLE.model_copy(update={"kind": "reference"})
    with pytest.raises(RuleError, match="tried in another world"):
        filmed(tmp_path, {"act": made}, backend="stub", bundle=elsewhere)
