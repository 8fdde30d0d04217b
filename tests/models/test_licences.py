"""Licences that forbid a use."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from dextera_build.models.licences import VARIABLE, Licences
from dextera_build.models.model import Model

FREE = Model("tiny", "a model", "", "MIT")
BOUND = replace(FREE, name="bound", licence="Research", forbids="commercial use")


def test_a_licence_that_forbids_a_use_is_accepted_once(tmp_path: Path) -> None:
    licences = Licences(tmp_path / "dxb" / "licences.json")
    assert licences.is_open(FREE)
    assert not licences.is_open(BOUND)
    licences.accept(BOUND)
    assert Licences(licences.path).is_open(BOUND)
    assert not licences.is_open(replace(BOUND, name="another"))


def test_a_licence_that_forbids_more_is_asked_again(tmp_path: Path) -> None:
    licences = Licences(tmp_path / "licences.json")
    licences.accept(BOUND)
    assert not licences.is_open(replace(BOUND, forbids="any use in Europe"))


def test_a_variable_accepts_in_ci(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "other,bound")
    assert Licences(tmp_path / "licences.json").is_open(BOUND)


@pytest.mark.parametrize("text", ["", "[]", "no JSON"])
def test_a_damaged_record_accepts_nothing(tmp_path: Path, text: str) -> None:
    (tmp_path / "licences.json").write_text(text)
    assert not Licences(tmp_path / "licences.json").is_open(BOUND)
