"""Bazel, which nobody here wrote, shares its results through a server of ours."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from dextera_build.store.remotes.grpc_server import GrpcServer
from dextera_build.store.store import Store
from tests.store.remotes.things import digest_of

pytestmark = pytest.mark.slow

BUILD = """
genrule(name = "said", outs = ["said.txt"], cmd = "echo hello > $@; echo noise; echo moan >&2")
genrule(name = "large", outs = ["large.bin"], cmd = "head -c 9000000 /dev/zero > $@; echo $$RANDOM$$RANDOM >> $@")
genrule(name = "empty", outs = ["empty.txt"], cmd = "touch $@")
genrule(
    name = "all",
    srcs = ["said.txt", "large.bin", "empty.txt"],
    outs = ["all.txt"],
    cmd = "cat $(SRCS) | sha256sum > $@",
)
"""


def bazel(root: Path, port: int, home: str) -> str:
    """Build with a home of its own, as another machine has it."""
    command = ["bazel", "--batch", f"--output_user_root={root / home}", "build"]
    command += [f"--remote_cache=grpc://127.0.0.1:{port}", "--spawn_strategy=local", "--noshow_progress", "//:all"]
    done = subprocess.run(command, cwd=root / "project", capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return done.stderr


@pytest.mark.skipif(shutil.which("bazel") is None, reason="Bazel is not installed (Debian: bazel-bootstrap)")
def test_what_one_bazel_built_another_takes(server: GrpcServer, store: Store, tmp_path: Path) -> None:
    (tmp_path / "project").mkdir()
    (tmp_path / "project" / "WORKSPACE").touch()
    (tmp_path / "project" / "BUILD").write_text(BUILD)
    assert "remote cache hit" not in bazel(tmp_path, server.port, "one")
    made = (tmp_path / "project" / "bazel-bin" / "large.bin").read_bytes()
    assert store.blobs.get(digest_of(made).hash) == made
    said = bazel(tmp_path, server.port, "two")
    assert "4 remote cache hit" in said
    assert "moan" in said
    assert (tmp_path / "project" / "bazel-bin" / "large.bin").read_bytes() == made
    # Without one of its blobs a result is none: Bazel runs that action again, and only that one.
    store.blobs.path(digest_of(made).hash).unlink()
    assert "remote cache hit" in (said := bazel(tmp_path, server.port, "three"))
    assert "4 remote cache hit" not in said
