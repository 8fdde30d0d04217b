"""The table of variables is what the sources read, and a misspelled one is met with the nearest name."""

from __future__ import annotations

import re

import pytest

from dextera_build.cli import variables
from dextera_build.code.loader import PACKAGE, bundled
from dextera_build.project.project import Project


def test_every_setting_has_its_variable(tmp_path):
    settings = {name for name in Project(tmp_path).config if name not in ("remotes", "services")}
    assert {f"DXB_{name.upper()}" for name in settings} <= set(variables.SETTINGS)


def test_every_variable_that_the_sources_name_is_in_the_table_and_the_other_way_round():
    files = [*PACKAGE.rglob("*.py"), *bundled("rules").rglob("*.py")]
    texts = {file: file.read_text() for file in files if file.name != "variables.py"}
    named = {name for text in texts.values() for name in re.findall(r"DXB_[A-Z_]*[A-Z]", text)}
    assert named <= {*variables.SETTINGS, *variables.OTHERS}
    assert set(variables.OTHERS) <= named


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("DXB_PROFIL", "DXB_PROFILE"),
        ("DXB_REMOTE", "DXB_REMOTES"),
        ("DXB_KACHE", "DXB_CACHE"),
    ],
)
def test_the_nearest_name_is_told(name, meant):
    assert variables.meant(name) == f"did you mean `{meant}`?"


def test_what_is_near_nothing_is_told_where_to_look():
    assert variables.meant("DXB_QQQ") == "`dxb show --config` names every setting"


def test_a_variable_that_a_remote_names_is_the_users_own():
    here = {"DXB_MINE": "x", "DXB_CACHE": "y", "HOME": "z", "DXB_KACHE": "w"}
    assert variables.strangers(here, ["https://${DXB_MINE}@host"]) == ["DXB_KACHE"]
