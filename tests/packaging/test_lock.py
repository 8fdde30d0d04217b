"""The lock: exact versions without addresses, fitting what pyproject.toml asks for."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

REPO = Path(__file__).parent.parent.parent
LINES = (REPO / ".ci" / "requirements.lock").read_text().splitlines()
PINS = dict(line.split("==") for line in LINES if "==" in line)
PROJECT = tomllib.loads((REPO / "pyproject.toml").read_text())
EXTRAS = PROJECT["project"]["optional-dependencies"]
NEEDED = [
    *PROJECT["build-system"]["requires"],
    *PROJECT["project"]["dependencies"],
    *(text for extra in ("twin", "learn", "recordings", "share", "cloud", "view") for text in EXTRAS[extra]),
    *(text for group in PROJECT["dependency-groups"].values() for text in group),
]


def test_every_line_is_a_name_and_a_public_version():
    assert [line for line in LINES if not re.fullmatch(r"[a-z0-9-]+==[0-9][0-9a-z.!]*", line)] == []
    assert sorted(PINS) == list(PINS)


@pytest.mark.parametrize("text", NEEDED)
def test_every_requirement_is_pinned_to_a_version_that_fits(text):
    need = Requirement(text)
    assert PINS[canonicalize_name(need.name)] in need.specifier


def test_torch_is_the_version_that_make_installs_first():
    assert f"torch=={PINS['torch']}" in (REPO / "Makefile").read_text()


def test_all_brings_every_other_extra():
    (everything,) = EXTRAS["all"]
    # robosuite pins packages that `learn` needs in other versions; Rerun takes 0.7 GB for one kind of file.
    assert Requirement(everything).extras == set(EXTRAS) - {"all", "repair", "rerun", "robots"}
