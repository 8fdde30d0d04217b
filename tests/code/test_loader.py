"""How rules are found and imported."""

from __future__ import annotations

from pathlib import Path

import pytest

from dextera_build.code.loader import Library
from dextera_build.errors import RecipeError

RULE = '''"""toy.NAME: a rule."""

from __future__ import annotations

from dextera_build.artifacts.base import File
from dextera_build.rule import Backend, Context, rule

from ..numbers import SMALL
from .large import LARGE


@rule(version=1)
def NAME(ctx: Context) -> File:
    """Some bytes."""
    return File(data=b"%d" % (SMALL + LARGE))
'''
BACKEND = 'from dextera_build.rule import Backend\n\nBACKEND = Backend(profiles=("cpu",), summary="fast")\n'


def make(project: Path, **files: str) -> Library:
    for name, text in files.items():
        file = project / "rules" / "toy" / f"{name.replace('__', '/')}.py"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    return Library(project)


def test_a_rule_in_a_folder_of_its_stage_keeps_its_address(tmp_path):
    library = make(
        tmp_path,
        numbers="SMALL = 1\n",
        shapes__large="LARGE = 20\n",
        shapes__mesh=RULE.replace("NAME", "mesh"),
        shapes__mesh_fast=BACKEND,
    )
    found = library.find("toy.mesh")
    assert found.file == tmp_path / "rules" / "toy" / "shapes" / "mesh.py"
    assert found.rule.returns.__name__ == "File"
    assert list(found.backends) == ["fast"]
    assert found.backends["fast"].load().BACKEND.summary == "fast"
    assert "toy.mesh" in [rule.path for rule in library.rules()]
    assert set(library.code.of(found.file)) == {
        "rules/toy/numbers.py",
        "rules/toy/shapes/large.py",
        "rules/toy/shapes/mesh.py",
    } | {name for name in library.code.of(found.file) if name.startswith("dextera_build/")}


def test_folders_of_a_stage_are_no_part_of_an_address(tmp_path):
    library = make(tmp_path, shapes__mesh=RULE.replace("NAME", "mesh"))
    with pytest.raises(RecipeError, match="no rule is called"):
        library.find("toy.shapes")
    with pytest.raises(RecipeError, match="no rule is called"):
        library.find("toy.shapes.mesh")


def test_two_files_of_one_rule_are_refused(tmp_path):
    library = make(tmp_path, mesh=RULE.replace("NAME", "mesh"), shapes__mesh=RULE.replace("NAME", "mesh"))
    with pytest.raises(RecipeError, match=r"two files hold the rule `toy.mesh`"):
        library.find("toy.mesh")


def test_a_new_folder_of_a_stage_is_looked_for(tmp_path):
    library = make(tmp_path, shapes__mesh=RULE.replace("NAME", "mesh"))
    assert {tmp_path / "rules", tmp_path / "rules" / "toy", tmp_path / "rules" / "toy" / "shapes"} <= set(
        library.folders()
    )
