"""Signed bundles go to a real OCI registry and back with `skopeo`, by the exact commands of the docs."""

from __future__ import annotations

import re
import shutil
import socket
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from dextera_build.bundle import importer, layout, sign
from tests.bundle.conftest import bundle

REPO = Path(__file__).parents[2]
DOCS = REPO / "dextera_build" / "docs" / "bundles.md"
PORT = 5000
"""As in `cache/registry.yml` and the docs."""

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not shutil.which("docker-registry") or not shutil.which("skopeo"), reason="`make servers`"),
]


def commands() -> list[str]:
    """The commands about registries on the page on bundles, one per line."""
    (block,) = re.findall(r"## Registries\n.*?```text\n(.*?)```", DOCS.read_text(), re.DOTALL)
    return [line for line in block.splitlines() if line]


@pytest.fixture
def registry(tmp_path: Path) -> Iterator[None]:
    """A registry started by the first command of the page, in a folder of this test."""
    words = commands()[0].removesuffix(" &").split()
    (tmp_path / "cache").mkdir()
    shutil.copy(REPO / "cache" / "registry.yml", tmp_path / "cache")
    with (tmp_path / "registry.log").open("wb") as log:
        process = subprocess.Popen(words, cwd=tmp_path, stdout=log, stderr=log)
    try:
        until = time.monotonic() + 30
        while time.monotonic() < until and process.poll() is None:
            try:
                socket.create_connection(("127.0.0.1", PORT), 1).close()
                break
            except OSError:
                time.sleep(0.05)
        if process.poll() is not None:
            pytest.skip(f"port {PORT} is taken")
        yield
    finally:
        process.kill()
        process.wait()


@pytest.mark.xdist_group("registry")
def test_a_signed_bundle_goes_to_a_registry_and_back(registry, tmp_path, store, other, plan):
    made = bundle(store, plan, "full")
    sign.generate(tmp_path / "key", "anna")
    made.attach(sign.seal(made.digest, tmp_path / "key")[0])
    made.write(tmp_path / "laptop_scene.tar")
    copies = [command for command in commands() if command.startswith("skopeo ")]
    assert len(copies) >= 2
    for command in copies:
        done = subprocess.run(command, shell=True, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{command}: {done.stderr}"
    opened = importer.open_bundle(layout.Layout(tmp_path / "pulled.tar"))
    assert opened.digest == made.digest
    assert sign.judge(opened, sign.trusted([tmp_path / "key.pub"])).state == "trusted"
    importer.take(opened, other)
    assert set(other.actions.keys()) == set(store.actions.keys())
