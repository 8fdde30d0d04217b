"""Code digests: what changes them, and what must not."""

from __future__ import annotations

from pathlib import Path

import pytest

from dextera_build.code.loader import Library

RULE = '''"""A rule."""
from __future__ import annotations
from typing import TYPE_CHECKING
from dextera_build.geometry import transforms
from .helper import double
if TYPE_CHECKING:
    from .never import nothing

LIMIT = 3

def mesh(x):
    """Docstring."""
    return double(x) + LIMIT  # a comment
'''
HELPER = "from . import deeper\n\ndef double(x):\n    return deeper.twice(x)\n"


@pytest.fixture
def stage(tmp_path: Path) -> Path:
    folder = tmp_path / "rules" / "toy"
    folder.mkdir(parents=True)
    (folder / "mesh.py").write_text(RULE)
    (folder / "helper.py").write_text(HELPER)
    (folder / "deeper.py").write_text("def twice(x):\n    return 2 * x\n")
    (folder / "never.py").write_text("nothing = 0\n")
    return folder


def code(stage: Path) -> dict[str, dict[str, str]]:
    return Library(stage.parents[1]).code.of(stage / "mesh.py")


def test_the_closure_holds_what_runs(stage):
    assert set(code(stage)) == {
        "rules/toy/mesh.py",
        "rules/toy/helper.py",
        "rules/toy/deeper.py",
        "dextera_build/geometry/__init__.py",
        "dextera_build/geometry/transforms.py",
    }


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("  # a comment", "  # another"),
        ('"""Docstring."""', '"""Other words."""'),
        ('    """Docstring."""\n', ""),
        ("LIMIT = 3\n", "\n\n\nLIMIT   =   3\n"),
        ('"""A rule."""', '"""The rule."""'),
    ],
)
def test_comments_docstrings_and_spaces_do_not_count(stage, old, new):
    before = code(stage)
    assert old in RULE
    (stage / "mesh.py").write_text(RULE.replace(old, new))
    assert code(stage) == before


@pytest.mark.parametrize(
    ("file", "old", "new", "where"),
    [
        ("mesh.py", "LIMIT = 3", "LIMIT = 4", ("rules/toy/mesh.py", "LIMIT")),
        ("mesh.py", "+ LIMIT", "- LIMIT", ("rules/toy/mesh.py", "mesh")),
        ("deeper.py", "2 * x", "3 * x", ("rules/toy/deeper.py", "twice")),
    ],
)
def test_a_change_names_its_definition(stage, file, old, new, where):
    before = code(stage)
    text = (stage / file).read_text()
    (stage / file).write_text(text.replace(old, new))
    after = code(stage)
    changed = [(name, part) for name in after for part in after[name] if after[name][part] != before[name].get(part)]
    assert changed == [where]


def test_a_definition_is_found_again(stage):
    index = Library(stage.parents[1]).code
    index.of(stage / "mesh.py")
    assert index.find("rules/toy/mesh.py", "mesh") == (stage / "mesh.py", 11)
    assert index.find("rules/toy/gone.py", "mesh") is None
