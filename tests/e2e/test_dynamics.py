"""Recordings of a robot narrow its twin, and only what depends on them is built again."""

from __future__ import annotations

import pytest

from dextera_build.artifacts.tasks.task import Reset
from tests import recorded_lifts
from tests.e2e.robots import STORED, TASK, stored
from tests.e2e.space import Space

RECIPE = """
summary: A task that learns from recordings.
inputs:
  stored: data/task.json
  recordings: data/recordings.json
nodes:
  task: {rule: demo.task, stored: $stored, lift: {height_m: 0.1}}
  # What a recording does not change.
  sources: {rule: demonstrate.operate, bundle: $task, episodes: 1, backend: stub}
  recorded: {rule: demo.episodes, stored: $recordings}
  dynamics: {rule: align.dynamics, bundle: $task, episodes: $recorded}
  identified: {rule: simulate.identified, bundle: $task, dynamics: $dynamics}
  # What follows from the twin that learned.
  made: {rule: demonstrate.operate, bundle: $identified, episodes: 1, backend: stub}
targets:
  default: [sources, made]
"""


@pytest.mark.slow
def test_new_recordings_rebuild_what_depends_on_them(space: Space) -> None:
    bundle, there = recorded_lifts.twin(), recorded_lifts.world()
    bundle = bundle.model_copy(update={"task": bundle.task.model_copy(update={"reset": Reset()})})
    space.write("data/task.json", stored(bundle))
    space.write("data/recordings.json", stored(recorded_lifts.recorded(there, "wave")))
    space.write("rules/demo/task.py", TASK.lstrip())
    episodes = STORED.replace("NAME", "episodes").replace("KIND", "Episodes").replace("tasks.task", "tasks.episode")
    space.write("rules/demo/episodes.py", episodes.lstrip())
    space.write("recipes/task/learned.yaml", RECIPE)
    first = space.build("task/learned", "--profile", "cpu")
    assert first.code == 0, first.err[-3000:]
    assert first.nodes("ran") == {"task", "sources", "recorded", "dynamics", "identified", "made"}
    assert "mass_kg of box is not identifiable from these recordings: the object was never moved" in first.err
    space.write("data/recordings.json", stored(recorded_lifts.recorded(there, "lift", "lift")))
    again = space.build("task/learned", "--profile", "cpu")
    assert again.code == 0, again.err[-3000:]
    assert again.nodes("ran") == {"recorded", "dynamics", "identified", "made"}
    assert again.nodes("cached") == {"task", "sources"}
    assert "mass_kg of box is not identifiable" not in again.err
