"""`dxb cache serve` under Bazel: what one workspace built another takes."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.store.remotes import servers

BUILD = """
genrule(name = "hello", outs = ["hello.txt"], cmd = "echo hello > $@")
genrule(name = "twice", srcs = [":hello"], outs = ["twice.txt"], cmd = "cat $(SRCS) $(SRCS) > $@")
"""

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which("bazel") is None, reason="bazel is not installed (Debian: bazel-bootstrap)"),
]


def bazel(folder: Path, root: Path, *words: str) -> str:
    command = ["bazel", f"--output_user_root={root}", "--max_idle_secs=5", "--batch", *words]
    done = subprocess.run(
        command, cwd=folder, env={**os.environ, "HOME": str(root)}, capture_output=True, text=True, timeout=400
    )
    assert done.returncode == 0, done.stderr
    return done.stderr


def test_two_bazels_share_what_they_build(tmp_path: Path) -> None:
    work = tmp_path / "work"
    work.mkdir()
    (work / "WORKSPACE").write_text('workspace(name = "tiny")\n')
    (work / "BUILD").write_text(BUILD)
    with servers.own(tmp_path / "store") as url:
        cold = bazel(work, tmp_path / "first", "build", "//:twice", f"--remote_cache={url}")
        assert "remote cache hit" not in cold
        warm = bazel(work, tmp_path / "second", "build", "//:twice", f"--remote_cache={url}")
        assert "2 remote cache hit" in warm
    assert (work / "bazel-bin" / "twice.txt").read_text() == "hello\nhello\n"
