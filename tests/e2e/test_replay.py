"""Episodes of the twin are replayed on a simulated robot over DDS, and the table of such trials continues."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.formats.ros import reading
from dextera_build.policy import layout, robot_run
from dextera_build.sim.runtime.fake_trials import fake_trial
from tests import episodes
from tests.benchmarks import robot_runs
from tests.e2e.robots import DOMAIN, NAMES, RECIPE, STORED, built, ended, lift, started, stored
from tests.e2e.space import Space

pytest.importorskip("cyclonedds", reason="needs cyclonedds (extra `ros`)")

STEPS = 15
ASIDE_M = np.array([0.03, -0.02, 0.0])
"""How far from its usual place the object of the episodes stands [m]."""


def moved() -> Episodes:
    """Two episodes of `lift`, whose robot goes to another place in each, and whose object stands aside."""
    bundle, items = lift(), {}
    for number in range(2):
        still = fake_trial(bundle, number, "synthesis", success=True)
        to = np.array([0.05 + 0.02 * number, -0.03, 0.04, 0.03, 0.03])
        path = np.linspace(0.0, 1.0, STEPS)[:, None] * (to - still.start.ctrl) + still.start.ctrl
        there = np.array(still.objects)
        there[:, 0, :3] += ASIDE_M
        rows = {name: np.repeat(values[:1], STEPS, axis=0) for name, values in still.terms.items()}
        made = still.model_copy(
            update={
                "action": path.astype(np.float32),
                "executed": path.astype(np.float32),
                "hand": np.repeat(still.hand[:1], STEPS, axis=0),
                "terms": rows,
            }
        )
        items[str(number)] = episodes.observed(made, objects=np.repeat(there[:1], STEPS, axis=0))
    return layout.gathered(bundle, items, {}, len(items))


def with_episodes(space: Space) -> Space:
    """The project of `built` with episodes."""
    space.write("data/episodes.json", stored(moved()))
    rule = STORED.replace("NAME", "episodes").replace("tasks.task import KIND", "tasks.episode import Episodes")
    space.write("rules/demo/episodes.py", rule.replace("KIND", "Episodes").lstrip())
    built(space)
    more = RECIPE.replace("  camera:", "  shown: data/episodes.json\n  camera:")
    more = more.replace("  view: {", "  episodes: {rule: demo.episodes, stored: $shown}\n  view: {")
    space.write("recipes/task/try.yaml", more.replace("names, view]", "names, view, episodes]"))
    done = space.build("task/try")
    assert done.code == 0, done.err[-3000:]
    return space


@pytest.mark.slow
def test_the_targets_of_an_episode_are_sent_where_it_began(space: Space) -> None:
    with_episodes(space)
    shown = moved().items["1"]
    robot = started(space, "--start", "task/try:episodes", "--episode", "1")
    try:
        which = ("--replay", "task/try:episodes", "--episode", "1", "--speed", "1", "--ramp", "0")
        done = space.dxb("run", "task/try", *which, *NAMES, "--out", "replay.mcap", "--json")
    finally:
        heard = ended(robot)
    assert done.code == 0, done.err
    assert done.document["steps"] == STEPS + 5, "a second longer than the episode"
    with (space.root / "replay.mcap").open("rb") as stream:
        run = robot_run.read(stream, "replay.mcap", lift())
    assert (run.about["origin"], run.about["algorithm"]) == ("replay", "")
    assert run.requested[:STEPS] == pytest.approx(shown.executed, abs=1e-6)
    assert run.requested[STEPS:] == pytest.approx(np.tile(shown.executed[-1], (5, 1)), abs=1e-6)
    assert run.measured[0].objects[0, :2] == pytest.approx(shown.objects[0, 0, :2], abs=2e-3)
    assert list(heard["joints"].values()) == pytest.approx(shown.executed[-1], abs=5e-3)
    trials = space.build("task/from_robot", "--input", "task=task/try:task", "--input", "runs=replay.mcap")
    assert trials.code == 0, trials.err[-3000:]
    assert "replay" in space.dxb("show", "task/from_robot:trials").out
    beyond = space.dxb("run", "task/try", "--replay", "task/try:episodes", "--episode", "2", *NAMES)
    assert (beyond.code, "DXB-U355" in beyond.err) == (2, True)


@pytest.mark.slow
def test_a_table_of_runs_keeps_the_trials_that_it_has(space: Space, capsys: pytest.CaptureFixture[str]) -> None:
    with_episodes(space)
    nodes = ["--task", "task", "--world", "task", "--names", "task/try:names", "--domain", DOMAIN]
    words = [str(space.root), str(space.root / "table"), "task/try", "--replay", "episodes", *nodes]
    robot_runs.main([*words, "--trials", "1"])
    first = capsys.readouterr()
    assert "| task/try | replay of episodes | 0 of 1 [0, 79] % | 0 of 1 | 0 |" in first.out
    made = {path: path.stat().st_mtime_ns for path in Path(space.root / "table").glob("*/0.*")}
    assert {path.suffix for path in made} == {".json", ".mcap"}
    robot_runs.main([*words, "--trials", "2"])
    second = capsys.readouterr()
    assert "0 of 2 [0, 66] %" in second.out
    assert second.err.count("not done within") == 1, "only the second trial was made"
    assert {path: path.stat().st_mtime_ns for path in made} == made
    with next(path for path in made if path.suffix == ".mcap").open("rb") as stream:
        assert reading.index(stream, "0.mcap")[0]
