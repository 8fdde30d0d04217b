"""Settings of a project."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from dextera_build.errors import UsageError
from dextera_build.project.project import find

SWITCHES = ["durable", "require_signed"]


@pytest.mark.parametrize("name", SWITCHES)
@pytest.mark.parametrize(
    ("spelled", "means"),
    [("true", True), ('"Yes"', True), ("1", True), ("false", False), ('"off"', False), ("0", False), ('"NO"', False)],
)
def test_a_switch_is_spelled_the_same_way_everywhere(tmp_path: Path, name: str, spelled: str, means: bool) -> None:
    (tmp_path / "dxb.toml").write_text(f"{name} = {spelled}\n")
    assert getattr(find(tmp_path), name) is means


@pytest.mark.parametrize("name", SWITCHES)
def test_what_is_neither_on_nor_off_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    (tmp_path / "dxb.toml").write_text("")
    monkeypatch.setenv(f"DXB_{name.upper()}", "flase")
    with pytest.raises(UsageError, match=f"`{name}` cannot be `flase`") as caught:
        getattr(find(tmp_path), name)
    assert caught.value.code == "DXB-U103"
    assert caught.value.facts["from"] == "environment"


def test_a_folder_whose_path_is_not_utf8_is_refused(tmp_path):
    folder = tmp_path / os.fsdecode(b"caf\xe9")
    folder.mkdir()
    with pytest.raises(UsageError, match=r"the path `.*/caf\\xe9` is not UTF-8") as caught:
        find(folder)
    assert (caught.value.code, caught.value.hint) == ("DXB-U194", "rename the folder whose name shows \\x")
