"""demonstrate.synthesize in MuJoCo, and demonstrate.gather: what is kept, what is discarded, and why."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import mink
import numpy as np
import pytest

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.tasks.episode import Episode, Episodes, Shard
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.errors import RuleError
from dextera_build.sim.control.ik import ArmKinematics
from dextera_build.sim.experts import synthesis
from dextera_build.sim.experts.filters import SYNTHESIS
from dextera_build.testing import RuleRunner
from rules.demonstrate.synthesize import SynthesizeOptions
from tests import episodes, gantry, task_bundles

QUIET = {"noise_position_m": 0.0, "noise_rotation_deg": 0.0, "noise_finger_deg": 0.0}


@pytest.fixture(scope="module")
def bundle() -> TaskBundle:
    return task_bundles.lift(reset=gantry.RESET)


@pytest.fixture(scope="module")
def sources(bundle: TaskBundle) -> Episodes:
    return gantry.demonstrations(bundle, 3)


def synthesised(
    folder: Path, bundle: TaskBundle, sources: Episodes, count: int, first: int = 0, **options: Any
) -> tuple[Episodes, RuleRunner]:
    runner = RuleRunner(folder)
    made: Episodes = runner.run(
        "demonstrate.synthesize",
        backend="mujoco",
        bundle=bundle,
        sources=sources,
        shard=Shard(first=first, count=count, seed=0),
        options={"noise_finger_deg": 0.05, "noise_rotation_deg": 0.0} | options,
    )
    return made, runner


@pytest.mark.medium
def test_episodes_succeed_with_noise_on_what_is_sent_and_none_in_the_label(
    tmp_path: Path, bundle: TaskBundle, sources: Episodes
) -> None:
    made, runner = synthesised(tmp_path, bundle, sources, 4)
    assert len(made.items) == 4
    assert made.attempts == len(made.items) + len(made.failures)
    assert len({episode.start.seed for episode in made.items.values()}) == 4
    for episode in made.items.values():
        apart = np.abs(episode.action - episode.executed)[:, :3]
        assert apart.max() > 1e-3
        # A label without noise is as smooth as a demonstration.
        smooth, shaken = (np.abs(np.diff(each[:, 1], 2)).sum() for each in (episode.action, episode.executed))
        assert smooth < shaken
    assert runner.outcome.metrics["yield"][0] == len(made.items) / made.attempts


def test_a_wall_in_the_way_is_a_counted_reason_and_attempts_are_capped(tmp_path: Path, sources: Episodes) -> None:
    x, y = task_bundles.BOX_M
    place = task_bundles.WORLD_FROM_BASE @ [x / 2, y / 2, 0.16, 1.0]
    wall = f'<geom name="static_wall" type="box" size="0.02 0.02 0.16" pos="{place[0]} {place[1]} {place[2]}"/>'
    blocked = task_bundles.lift(reset=gantry.RESET, extra=wall)
    with pytest.raises(RuleError, match="only 0 of 2 episodes") as caught:
        synthesised(tmp_path, blocked, sources, 2, tries=2)
    assert caught.value.facts["attempts"] == "4"
    assert caught.value.facts["reasons"] == "4 x touched `wall` in `approach`"


def test_episodes_are_kept_when_the_attempts_are_used_up(
    tmp_path: Path, bundle: TaskBundle, sources: Episodes, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = next(iter(sources.items.values()))
    every = iter([True, False, True, False, False, False])

    def synthesise(*words: Any) -> Episode:
        success = next(every)
        return made.model_copy(update={"success": success, "reason": "" if success else "missed"})

    monkeypatch.setattr(synthesis, "synthesise", synthesise)
    found, runner = synthesised(tmp_path, bundle, sources, 3, tries=2)
    assert (list(found.items), len(found.failures), found.attempts) == (["00000", "00001"], 4, 6)
    assert runner.outcome.warnings == ["only 2 of 3 episodes came out: 4 x missed"]


def test_attempts_without_inverse_kinematics_are_discarded_with_the_reason(
    tmp_path: Path, bundle: TaskBundle, sources: Episodes, monkeypatch: pytest.MonkeyPatch
) -> None:
    solve, calls = ArmKinematics.track, []

    def sometimes(self: ArmKinematics, *words: Any, **more: Any) -> np.ndarray:
        calls.append(1)
        if len(calls) == 5:
            raise mink.NoSolutionFound("daqp")
        return solve(self, *words, **more)

    monkeypatch.setattr(ArmKinematics, "track", sometimes)
    made, _ = synthesised(tmp_path, bundle, sources, 1)
    assert len(made.items) == 1
    assert list(made.reasons) == ["the inverse kinematics found no solution in `the plan`"]
    assert len(made.failures) == 1


def test_a_larger_data_set_begins_with_the_shards_of_a_smaller_one(tmp_path: Path) -> None:
    runner = RuleRunner(tmp_path)
    small, large = (
        runner.run("demonstrate.shards", options={"episodes": count, "per_shard": 10}).items for count in (100, 300)
    )
    assert len(large) == 30
    assert {name: large[name] for name in small} == small


def test_of_episodes_with_one_seed_the_first_is_kept(tmp_path: Path) -> None:
    one, other = episodes.small(2, 6), episodes.small(2, 6)
    other = other.model_copy(update={"items": dict(zip("56", other.items.values(), strict=True)), "failures": {}})
    shards = Collection[Episodes](items={"00000": one, "00005": other})
    gathered = RuleRunner(tmp_path).run("demonstrate.gather", shards=shards)
    assert list(gathered.items) == ["0", "1"]
    assert gathered.reasons["its start is that of another episode"] == 2
    assert gathered.attempts == one.attempts + other.attempts


def test_rehearsals_are_filtered_as_syntheses_are_by_default() -> None:
    options = SynthesizeOptions().model_dump()
    filters = {name: value for name, value in asdict(SYNTHESIS).items() if name != "fingers"}
    assert {name: options[name] for name in filters} == filters
