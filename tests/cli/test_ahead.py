"""What makes workers is begun early where a node will mostly run, and nowhere else."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from dextera_build.cli import ahead, quick


@pytest.mark.parametrize(
    "words", [["ls"], ["build", "x", "--check"], ["build", "x", "--executor", "ray"], ["build", "--help"], []]
)
def test_a_command_that_needs_no_workers_or_others_begins_none(
    words: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(quick, "is_known", lambda words: True)
    assert ahead.begin(words) is None


def test_what_was_never_built_begins_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    assert not quick.is_known(["build", "x"])
    assert ahead.begin(["build", "x"]) is None


_SAY = """
import os
os.sched_getaffinity = lambda pid: set(range(int(os.environ["CORES"])))
os.getloadavg = lambda: (float(os.environ["LOAD"]), 0.0, 0.0)
from dextera_build.cli import ahead, quick
quick.is_known = lambda words: True
made = ahead.begin(["build", "x"])
if made is not None:
    assert made.is_running()
    made.end()
    assert not made.is_running()
print(made is not None)
"""


@pytest.mark.parametrize(
    ("cores", "load", "more", "said"),
    [
        ("2", "1.9", {}, "True"),
        ("2", "2.0", {}, "False"),
        ("1", "0.0", {}, "False"),
        ("2", "0.0", {"DXB_EXECUTOR": "ray"}, "False"),
    ],
)
def test_it_is_begun_where_another_core_can_load_it(cores: str, load: str, more: dict[str, str], said: str) -> None:
    env = {name: value for name, value in os.environ.items() if not name.startswith("DXB_")}
    env |= {"CORES": cores, "LOAD": load, "PYTHONPATH": str(Path(__file__).parents[2]), **more}
    done = subprocess.run([sys.executable, "-c", _SAY], env=env, capture_output=True, text=True)
    assert done.stdout.strip() == said, done.stderr
