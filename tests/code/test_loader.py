"""How rules are found and imported."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from dextera_build.code.loader import Library
from dextera_build.errors import RecipeError
from dextera_build.project.project import Project
from dextera_build.store.signature import Watch

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
    assert found.backends["fast"].module.BACKEND.summary == "fast"
    assert "toy.mesh" in [rule.path for rule in library.rules()]
    assert set(library.code.of(found.file).definitions) == {
        "rules/toy/numbers.py",
        "rules/toy/shapes/large.py",
        "rules/toy/shapes/mesh.py",
    } | {name for name in library.code.of(found.file).definitions if name.startswith("dextera_build/")}


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


@pytest.mark.parametrize(
    "new",
    [
        "rules/toy/mesh_slow.py",
        "rules/toy/rooms/mesh.py",
        "rules/toy/fast.py",
        "rules/toy/fast/__init__.py",
        "rules/toy/deep/__init__.py",
        "rules/toy/__init__.py",
        "rules/toy/lib/inner/__init__.py",
    ],
)
def test_what_would_come_first_is_looked_for(tmp_path, new):
    text = "try:\n    from .fast import F\nexcept ImportError:\n    from .deep import F\nfrom .lib import inner\n"
    library = make(tmp_path, mesh=RULE.replace("NAME", "mesh"), large="LARGE = 2\n", deep="F = 1\n", lib__inner="")
    (tmp_path / "rules/toy/mesh.py").write_text(text + "@rule()\ndef mesh(): pass\n")
    (tmp_path / "rules/toy/rooms").mkdir()
    library.code.of(library.find("toy.mesh").file)
    watch = noted(library)
    assert watch.settled()
    (tmp_path / new).parent.mkdir(exist_ok=True)
    (tmp_path / new).write_text("")
    assert not watch.settled()


def test_the_first_rules_of_a_project_are_looked_for(tmp_path):
    library = Library(tmp_path)
    library.find("capture.folder")
    watch = noted(library)
    assert watch.settled()
    (tmp_path / "rules/capture").mkdir(parents=True)
    assert not watch.settled()


def test_a_rule_beside_a_bundled_one_is_looked_for(tmp_path):
    library = make(tmp_path, mesh=RULE.replace("NAME", "mesh"))
    (tmp_path / "rules/capture").mkdir(parents=True)
    library.find("capture.folder")
    watch = noted(library)
    assert watch.settled()
    (tmp_path / "rules/capture/folder.py").write_text("")
    assert not watch.settled()


def test_a_recipe_that_shadows_a_bundled_one_is_looked_for(tmp_path):
    (tmp_path / "recipes/robot").mkdir(parents=True)
    project = Project(tmp_path)
    assert project.recipe("robot/kuka_leap")
    watch = noted(project)
    assert watch.settled()
    (tmp_path / "recipes/robot/kuka_leap.yaml").write_text("")
    assert not watch.settled()


def test_a_folder_of_the_search_path_that_appears_later_is_searched(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(tmp_path / "late"))
    library = make(tmp_path, numbers="SMALL = 1\n", large="LARGE = 1\n", mesh=RULE.replace("NAME", "mesh"))
    (tmp_path / "rules/toy/large.py").write_text("try:\n    import late_own\nexcept ImportError:\n    LARGE = 1\n")
    assert "late_own.py" not in library.code.of(library.find("toy.mesh").file).definitions
    (tmp_path / "late").mkdir()
    (tmp_path / "late/late_own.py").write_text("")
    library = Library(tmp_path)
    assert "late_own.py" in library.code.of(library.find("toy.mesh").file).definitions


def noted(asked: Library | Project) -> Watch:
    watch = Watch()
    watch.started_ns = 2**62  # what was written just now counts as old
    for path in asked.looked_at():
        (watch.folder if os.path.isdir(path) else watch.file)(path)
    return watch


def test_a_folder_that_is_removed_while_rules_are_looked_for_has_none(tmp_path, monkeypatch):
    library, listed, failed = make(tmp_path, kept=RULE.replace("NAME", "kept")), Path.glob, []

    def gone(self: Path, pattern: str) -> list[Path]:
        if not failed:
            failed.append(pattern)
            raise FileNotFoundError(2, "No such file or directory", "rules/toy/removed")
        return list(listed(self, pattern))

    monkeypatch.setattr(Path, "glob", gone)
    assert library.find("toy.kept").file == tmp_path / "rules" / "toy" / "kept.py"
    assert failed
