"""evaluate.early: the curve, the choice, and that no start of it is one that is reported."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from dextera_build.artifacts.tasks.policy import Checkpoint, EarlyTrials
from dextera_build.artifacts.tasks.trials import Attempt
from dextera_build.errors import RuleError
from dextera_build.rule import Context
from dextera_build.testing import RuleRunner
from rules.evaluate.protocol import seeds
from tests import episodes
from tests.policy import policies

BUNDLE = episodes.bundle()
SNAPSHOTS = {"100": b"early", "1000": b"late", "200": b"middle"}


def checkpoint() -> Checkpoint:
    made = policies.checkpoint(policies.contract(BUNDLE))
    return made.model_copy(
        update={"snapshots": SNAPSHOTS, "steps": np.array([1, 1200], np.int64), "curve": np.ones(2, np.float32)}
    )


def stub(tmp_path: Path) -> ModuleType:
    """The stub as calls find it."""
    return RuleRunner(tmp_path).find("evaluate.early").backends["stub"].module


def run(tmp_path: Path, made: Checkpoint, **options: Any) -> Checkpoint:
    runner = RuleRunner(tmp_path, made_by={"checkpoint": "learn.act"})
    return runner.run("evaluate.early", profile="stub", bundle=BUNDLE, checkpoint=made, options=options)


def test_later_snapshots_are_tried_later(tmp_path: Path) -> None:
    found = run(tmp_path, checkpoint(), trials=40).early
    assert found is not None
    assert (found.steps, found.trials, found.chosen) == ((100, 200, 1000, 1200), 40, 1200)
    assert list(found.successes) == sorted(found.successes)
    assert found.successes[0] < 20 < found.successes[-1] == 40
    assert found.progress[-1] == 1.0


def test_the_best_has_the_most_successes_and_the_last_is_the_end_of_the_training(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from dextera_build.sim.runtime.fake_trials import fake_trial

    def attempts(ctx: Context, bundle: Any, snapshots: Mapping[int, Checkpoint], view: Any, cases: Any, *_: Any) -> Any:
        for step, seed in cases:
            one = fake_trial(bundle, seed, "policy", success=step == 200)
            yield Attempt(seed=seed, episode=one, placed=one.objects[0])

    monkeypatch.setattr(stub(tmp_path), "attempts", attempts)
    made = checkpoint()
    best, last = (run(tmp_path / choose, made, trials=3, choose=choose) for choose in ("best", "last"))
    assert (best.weights, last.weights) == (b"middle", made.weights)
    assert (best.early, last.early) == (
        EarlyTrials(steps=(100, 200, 1000, 1200), successes=(0, 3, 0, 0), progress=(0, 1, 0, 0), trials=3, chosen=200),
        EarlyTrials(steps=(100, 200, 1000, 1200), successes=(0, 3, 0, 0), progress=(0, 1, 0, 0), trials=3, chosen=1200),
    )
    assert best.snapshots == last.snapshots == {}


def test_no_start_is_one_of_those_that_are_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []
    own = stub(tmp_path).attempts

    def attempts(*given: Any) -> Any:
        asked.extend(seed for _, seed in given[4])
        return own(*given)

    monkeypatch.setattr(stub(tmp_path), "attempts", attempts)
    run(tmp_path, checkpoint(), trials=30)
    assert len(set(asked)) == 30
    assert set(asked).isdisjoint(seed for family in range(5) for seed in seeds(family, 200))


def test_a_checkpoint_without_snapshots_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RuleError, match="the checkpoint holds no snapshot") as refused:
        run(tmp_path, checkpoint().model_copy(update={"snapshots": {}}))
    assert "snapshot_every" in str(refused.value.hint)


def test_an_interruption_loses_no_attempt(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found, early_stub = RuleRunner(tmp_path).find("evaluate.early"), stub(tmp_path)
    options = found.rule.options(trials=4)
    own, made = early_stub.attempts, list[tuple[int, int]]()

    def attempts(ctx: Context, bundle: Any, snapshots: Any, view: Any, cases: Any, *rest: Any) -> Any:
        for case, attempt in zip(cases, own(ctx, bundle, snapshots, view, cases, *rest), strict=True):
            made.append(case)
            yield attempt

    monkeypatch.setattr(early_stub, "attempts", attempts)

    def call(stop: int | None) -> Any:
        def emit(kind: str, event: Mapping[str, object]) -> None:
            if kind != "log" and event.get("done") == stop:
                raise KeyboardInterrupt

        ctx = Context(early_stub, scratch=tmp_path / "scratch", emit=emit, keep=tmp_path / "keep")
        return found.rule(ctx, BUNDLE, checkpoint(), options=options)

    with pytest.raises(KeyboardInterrupt):
        call(6)
    whole = call(None)
    assert len(made) == len(set(made)) == 16
    assert whole.early.trials == 4
