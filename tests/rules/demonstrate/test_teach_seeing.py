"""demonstrate.teach with a student that sees pictures: it opens a gate that it only sees.

The teacher sees states.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.artifacts.tasks.trials import Trials
from dextera_build.errors import RuleError
from dextera_build.testing import RuleRunner
from tests import gate
from tests.rules.learn.test_in_mujoco import BUNDLE, shown

__all__ = ["shown"]

VIEW = gate.view()
SMALL = {"batch": 32, "warm_up": 20, "held_out": 0.0, "width": 32, "heads": 2, "chunk": 10}


def run(tmp_path: Path, rule: str, options: dict[str, Any], **inputs: Any) -> Any:
    runner = RuleRunner(tmp_path, made_by=dict.fromkeys(("teacher", "student", "checkpoint"), "learn.act"))
    return runner.run(rule, bundle=BUNDLE, options=options, **inputs)


def student(tmp_path: Path, episodes: Episodes, steps: int) -> Checkpoint:
    film = run(tmp_path, "demonstrate.film", {}, episodes=episodes, view=VIEW)
    options = SMALL | {"steps": steps, "inputs": ("joints", "rgb")}
    made = run(tmp_path, "learn.act", options, episodes=episodes, film=film, backend="torch")
    assert isinstance(made, Checkpoint)
    return made


@pytest.mark.slow
def test_a_student_that_sees_learns_from_its_teacher(tmp_path: Path, shown: Episodes) -> None:
    teacher = run(tmp_path, "learn.act", SMALL | {"steps": 400}, episodes=shown, backend="torch")
    rounds = {"0": run(tmp_path, "demonstrate.teach", {"episodes": 6}, teacher=teacher)}
    assert all(one.success for one in rounds["0"].items.values())
    first = student(tmp_path, rounds["0"], 40)
    with pytest.raises(RuleError, match="view"):
        run(tmp_path, "demonstrate.teach", {"episodes": 2}, teacher=teacher, student=first)
    seen = {"teacher": teacher, "student": first, "view": VIEW}
    rounds["1"] = run(tmp_path, "demonstrate.teach", {"episodes": 6, "first": 50}, **seen)
    gathered = RuleRunner(tmp_path).run("demonstrate.gather", shards=Collection[Episodes](items=rounds))
    last = student(tmp_path, gathered, 300)
    assert {channel.name for channel in last.contract.inputs} == {"joints", "rgb"}
    tried = run(tmp_path, "evaluate.rollouts", {"trials": 10}, checkpoint=last, view=VIEW)
    assert isinstance(tried, Trials)
    assert tried.successes >= 9
