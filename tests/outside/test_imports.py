"""What a program imports from beside it is part of it, declared or not."""

from __future__ import annotations

from pathlib import Path

import pytest

from dextera_build.outside.imports import imported

FILES = {
    "prog.py": "import os, numpy\nfrom helper import F\n",
    "helper.py": "def late():\n    if 1: import pkg.inner.leaf\n",
    "pkg/__init__.py": "",
    "pkg/inner/leaf.py": "from .. import other\nfrom ..deep import (\n    thing,\n    more,\n)\nfrom . import *\n",
    "pkg/other.py": "",
    "pkg/deep/__init__.py": "",
    "pkg/deep/thing.py": "print 'Python 2'\n",
    "pkg/__main__.py": "",
    "unused.py": "",
}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    return tmp_path


def test_everything_that_is_imported_from_its_folder_is_found(folder: Path) -> None:
    found, missing = imported([folder / "prog.py"], [folder])
    assert {path.relative_to(folder).as_posix() for path in found} == set(FILES) - {"unused.py", "pkg/__main__.py"}
    assert {folder / "numpy.py", folder / "helper/__init__.py", folder / "pkg/deep/more.py"} <= missing


def test_a_module_that_the_command_names_begins(folder: Path) -> None:
    found, _ = imported([], [folder], ["pkg"])
    assert found == {folder / "pkg/__init__.py", folder / "pkg/__main__.py"}
