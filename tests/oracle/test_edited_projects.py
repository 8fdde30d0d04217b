"""Random edits of code, packages, search paths, recipes and inputs: each build is as a clean one by plain Python."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from tests.oracle.plain import build, expected, placed
from tests.oracle.projects import RandomProject

_STEPS = 6


def play(seed: int, folder: Path, *, workers: bool = False, spawns: bool = False, steps: int = _STEPS) -> None:
    """Build a project, edit it, and so on.

    Args:
        seed: Of the project and its edits.
        folder: Where it lies.
        workers: Nodes run in workers.
        spawns: Rules call some functions in processes that the workers start.
        steps: Number of builds.
    """
    project = RandomProject(seed, folder / "project", spawns=spawns)
    edit = ""
    for step in range(steps):
        time.sleep(0.03)  # or no snapshot is made
        right = expected(project.files(), folder / f"clean{step}")
        said = build(project, "--console", "plain", workers=workers)
        assert placed(project, said) == right, project.edits
        assert not (edit.startswith("harmless") and " ran" in said.text), project.edits
        assert not edit.startswith("version") or " ran" in said.text, project.edits
        again = build(project, "--console", "plain")
        assert placed(project, again) == right, project.edits
        assert "up to date" in again.text, (project.edits, again.text)
        edit = project.edit()


@pytest.mark.medium
@pytest.mark.parametrize("seed", range(1))
def test_a_build_after_any_edit_is_as_a_clean_one(seed: int, tmp_path: Path) -> None:
    """Promise: whatever was edited, appeared or vanished, a build gives what plain Python gives."""
    play(seed, tmp_path)


@pytest.mark.parametrize("seed", range(100, 101))
@pytest.mark.medium
def test_a_build_by_workers_after_any_edit_is_as_a_clean_one(seed: int, tmp_path: Path) -> None:
    """Promise: the same where workers run nodes."""
    play(seed, tmp_path, workers=True)


@pytest.mark.parametrize("seed", [208])  # edits what a process imports
@pytest.mark.medium
def test_a_build_whose_workers_spawn_processes_is_as_a_clean_one(seed: int, tmp_path: Path) -> None:
    """Promise: the same where processes run functions that workers start."""
    play(seed, tmp_path, workers=True, spawns=True, steps=2)


@pytest.mark.slow
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("part", range(4))
def test_more_projects_are_built_as_clean_ones_after_any_edit(part: int, tmp_path: Path) -> None:
    """Promise: the same, 30 projects in each of four parts, one in six by workers, half of these with processes."""
    for seed in range(1000 + part, 1040, 4):
        play(seed, tmp_path / str(seed), workers=seed % 6 == 0, spawns=seed % 12 == 0)
