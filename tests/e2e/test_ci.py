"""What lies ready under cache/ci: the script of a job, and the action around it."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from tests.e2e.machines import EVERY, agree, results
from tests.e2e.space import Answer, Space
from tests.e2e.test_expect import BOUNDS, RECIPE, SIZED

CACHE = Path(__file__).parents[2] / "cache"


@pytest.fixture
def programs(tmp_path: Path) -> Path:
    """A folder with `dxb` as this checkout has it."""
    folder = tmp_path / "bin"
    folder.mkdir()
    (folder / "dxb").write_text(f'#!/bin/sh\nexec {sys.executable} -m dextera_build "$@"\n')
    (folder / "dxb").chmod(0o755)
    return folder


def job(space: Space, programs: Path, store: str, *words: str, **env: str) -> Answer:
    path = f"{programs}{os.pathsep}{os.environ['PATH']}"
    environment = space.environment(DXB_CACHE=store, PATH=path, TWIN_REMOTE="./share", **env)
    command = ["bash", str(CACHE / "ci" / "build.sh"), "say/words", *words]
    done = subprocess.run(command, cwd=space.root, env=environment, capture_output=True, text=True, timeout=300)
    return Answer(done.returncode, done.stdout, done.stderr)


@pytest.mark.slow
def test_main_gives_and_a_pull_request_takes(space: Space, programs: Path) -> None:
    assert space.dxb("build", "say/words", "--lock", env={"DXB_CACHE": "own"}).code == 0
    reader = job(space, programs, "zero")
    assert reader.code == 0, reader.err
    assert not (space.root / "share/ac").exists()
    assert job(space, programs, "one", TWIN_WRITE="true").code == 0
    second = job(space, programs, "two", TWIN_LOCKED="true")
    assert second.code == 0, second.err
    assert f"{len(EVERY)} nodes: {len(EVERY)} fetched" in second.err
    assert agree(space, "two", "one")
    space.edit("recipes/say/words.yaml", "one two", "one three")
    changed = job(space, programs, "two", TWIN_LOCKED="true")
    assert changed.code == 3, changed.err


@pytest.mark.slow
def test_the_store_does_not_grow_from_job_to_job(space: Space, programs: Path) -> None:
    assert job(space, programs, "one").code == 0
    before = set(results(space, "one"))
    for path in (space.root / "one").rglob("*"):
        if path.is_file():
            os.utime(path, (1e9, 1e9))
    space.edit("recipes/say/words.yaml", "one two", "three four")
    assert job(space, programs, "one", TWIN_STORE_MAX="1kB").code == 0
    after = set(results(space, "one"))
    assert before - after
    assert space.dxb("plan", "say/words", "--check", env={"DXB_CACHE": "one"}).code == 0


@pytest.mark.medium
def test_a_missed_bound_fails_the_job(space: Space, programs: Path) -> None:
    space.write("rules/toy/sized.py", SIZED.lstrip())
    space.write("recipes/say/words.yaml", RECIPE + BOUNDS % 5)
    answer = job(space, programs, "one")
    assert answer.code == 1
    assert "MISSED" in answer.out


def test_the_action_gives_the_script_all_that_it_reads() -> None:
    action = yaml.safe_load((CACHE / "ci" / "action.yml").read_text())
    restore, build, save = action["runs"]["steps"]
    script = (CACHE / "ci" / "build.sh").read_text()
    assert set(re.findall(r"TWIN_[A-Z_]+", script)) <= set(build["env"])
    used = set(re.findall(r"inputs\.([a-z-]+)", str(action["runs"])))
    assert used == set(action["inputs"])
    assert "${{" not in build["run"]
    assert restore["with"]["key"] == save["with"]["key"]
    assert restore["with"]["key"].startswith(restore["with"]["restore-keys"])
    assert build["env"]["DXB_CACHE"].endswith(restore["with"]["path"])


def test_the_configuration_of_bazel_remote_is_one() -> None:
    text = (CACHE / "bazel-remote.yml").read_text()
    spoken = "\n".join(re.sub(r"^#   ", "", line) for line in text.splitlines())
    assert {"dir", "max_size"} <= set(yaml.safe_load(text))
    assert yaml.safe_load(spoken)["allow_unauthenticated_reads"] is True
