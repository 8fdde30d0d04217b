"""Code digests: what changes them, and what must not."""

from __future__ import annotations

import importlib
import sys
from importlib.util import spec_from_file_location
from pathlib import Path
from zipfile import ZipFile

import pytest

from dextera_build.code.distributions import version_of
from dextera_build.code.loader import Library, RuleFile

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
    return Library(stage.parents[1]).code.of(stage / "mesh.py").definitions


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


@pytest.mark.parametrize(
    ("first", "second", "counts"),
    [("T = {1: 2}", "T.update({1: 3})", True), ("def f(): ...", "def g(): ...", False)],
    ids=["what acts", "functions"],
)
def test_moved_statements_count_if_one_acts_on_the_other(stage, first, second, counts):
    seen = []
    for one, other in ((first, second), (second, first)):
        (stage / "deeper.py").write_text(f"import json\n{one}\n{other}\ndef twice(x):\n    return 2 * x\n")
        seen.append(code(stage))
    assert (seen[0] != seen[1]) == counts


def test_moved_functions_count_for_code_that_lists_the_names_of_a_module(stage):
    text = "def {}():\n    return 1\ndef {}():\n    return 1\n"
    seen = []
    for names in (("f", "twice"), ("twice", "f")):
        (stage / "deeper.py").write_text(text.format(*names))
        write(stage, {"helper.py": "from . import deeper\ndef double(x):\n    return list(vars(deeper))\n"})
        seen.append(code(stage))
    assert seen[0] != seen[1]
    assert seen[0]["rules/toy/mesh.py"] == seen[1]["rules/toy/mesh.py"]


OWN = "def rule(**given):\n    return lambda f: given\n"
THEIRS = "from dextera_build.rule import Backend, rule\n"


@pytest.mark.parametrize(
    ("text", "counts"),
    [
        pytest.param(f"{THEIRS}@rule(version=1, cpus=3)\ndef mesh(): ...\n", False, id="a rule"),
        pytest.param(f"{THEIRS}BACKEND = Backend(summary='', gpu_gb=3)\n", False, id="a backend"),
        pytest.param(f"{OWN}@rule(version=1, cpus=3)\ndef mesh(): ...\n", True, id="an own decorator"),
        pytest.param("from .helper import rule\n@rule(cpus=3)\ndef mesh(): ...\n", True, id="an imported one"),
        pytest.param("from mine import *\n@rule(cpus=3)\ndef mesh(): ...\n", True, id="perhaps an imported one"),
        pytest.param(f"{THEIRS}{OWN}@rule(cpus=3)\ndef mesh(): ...\n", True, id="one that hides the package's"),
        pytest.param(f"{THEIRS}if X:\n    rule = X\n@rule(cpus=3)\ndef mesh(): ...\n", True, id="a changed one"),
        pytest.param(f"{OWN}LIMIT = rule(cpus=3)\n", True, id="a call"),
        pytest.param(f"{THEIRS}LIMIT = Backend(summary='', gpu_gb=3).gpu_gb\n", True, id="a part of a backend"),
        pytest.param("def Backend(**given): ...\nBACKEND = Backend(gpu_gb=3)\n", True, id="an own class"),
        pytest.param(f"{THEIRS}@rule(cpus=(N := 3))\ndef mesh(): ...\n", True, id="a name that is bound aside"),
    ],
)
def test_what_a_rule_asks_for_is_no_code_if_it_asks_the_package(stage, text, counts):
    write(stage, {"mesh.py": text})
    before = code(stage)
    write(stage, {"mesh.py": text.replace("3", "5")})
    assert (code(stage) != before) == counts


@pytest.mark.parametrize(
    ("text", "runs"),
    [
        ("import typing as t\nif t.TYPE_CHECKING:\n    from .deep import F\n", False),
        ("TYPE_CHECKING = False\nif TYPE_CHECKING:\n    from .deep import F\n", False),
        ("TYPE_CHECKING = True\nif TYPE_CHECKING:\n    from .deep import F\n", True),
        ("from .own import X\nif X.TYPE_CHECKING:\n    from .deep import F\n", True),
        ("class X:\n    TYPE_CHECKING = 1\nif X.TYPE_CHECKING:\n    from .deep import F\n", True),
        ("from typing import TYPE_CHECKING\nTYPE_CHECKING = 1\nif TYPE_CHECKING:\n    from .deep import F\n", True),
        ("def f(TYPE_CHECKING):\n    if TYPE_CHECKING:\n        from .deep import F\n", True),
        ("def f():\n    (TYPE_CHECKING := True)\n    if TYPE_CHECKING:\n        from .deep import F\n", True),
    ],
)
def test_only_blocks_for_type_checkers_are_left_out(stage, text, runs):
    write(stage, {"mesh.py": text, "deep.py": "F = 1\n", "own.py": "X = 1\n"})
    assert ("rules/toy/deep.py" in code(stage)) == runs


def write(stage: Path, files: dict[str, str]) -> None:
    for name, text in files.items():
        (stage / name).parent.mkdir(parents=True, exist_ok=True)
        (stage / name).write_text(text)


@pytest.mark.parametrize(
    ("files", "edited"),
    [
        pytest.param(
            {"mesh.py": "from typing import TYPE_CHECKING\nif not TYPE_CHECKING:\n    from .deep import F\n"},
            "deep.py",
            id="what a type checker does not see",
        ),
        pytest.param(
            {"mesh.py": "import typing\nif typing.TYPE_CHECKING:\n    pass\nelse:\n    from .deep import F\n"},
            "deep.py",
            id="the other branch",
        ),
        pytest.param(
            {"mesh.py": "from .lib.deep import F\n", "lib/deep.py": "F = 1\n", "lib/__init__.py": ""},
            "lib/__init__.py",
            id="the package above",
        ),
        pytest.param(
            {"mesh.py": "from .lib import F\n", "lib.py": "F = 1\n", "lib/__init__.py": "F = 2\n"},
            "lib/__init__.py",
            id="a package before a module",
        ),
        pytest.param(
            {"mesh.py": "try:\n    from .fast import F\nexcept ImportError:\n    F = 3\n"}, "fast.py", id="a new module"
        ),
        pytest.param(
            {"mesh.py": "from .lib import *\n", "lib/__init__.py": "__all__ = ['deep']\n", "lib/deep.py": "F = 1\n"},
            "lib/deep.py",
            id="what a star imports",
        ),
        pytest.param(
            {"mesh.py": "def mesh():\n    from .lib import deep\n", "lib/deep.py": "F = 1\n"},
            "lib/deep.py",
            id="a package without a file",
        ),
        pytest.param({"mesh.py": "from . import F\n", "__init__.py": "F = 2\n"}, "__init__.py", id="the stage"),
    ],
)
def test_first_party_code_is_seen_as_python_finds_it(stage, files, edited):
    write(stage, {"deep.py": "F = 1\n", **files})
    before = code(stage)
    write(stage, {edited: "F = 4711\n"})
    assert code(stage) != before


def test_a_module_that_a_package_shadows_is_not_seen(stage):
    write(stage, {"mesh.py": "from .lib import F\n", "lib.py": "F = 1\n", "lib/__init__.py": "F = 2\n"})
    assert {name for name in code(stage) if "lib" in name} == {"rules/toy/lib/__init__.py"}


@pytest.mark.parametrize("layout", ["", "src"], ids=["flat", "src"])
def test_packages_of_the_project_are_seen_on_the_search_path(stage, layout, monkeypatch):
    path = stage.parents[1] / layout
    name = f"own_package_{layout}"
    write(path, {f"{name}/__init__.py": "", f"{name}/inner/deep.py": "F = 1\n", f"{name}_beside.py": "F = 2\n"})
    write(stage, {"mesh.py": f"import {name}.inner.deep\nimport {name}_beside\nimport numpy\nimport json\n"})
    monkeypatch.syspath_prepend(str(path))
    found = {place for place in code(stage) if not place.startswith("dextera_build/")}
    assert found == {
        "rules/toy/mesh.py",
        f"{name}/__init__.py",
        f"{name}/inner/deep.py",
        f"{name}_beside.py",
    }


def test_a_project_below_a_folder_called_site_packages_is_first_party(stage, monkeypatch):
    path = stage.parents[1] / "site-packages" / "project" / "src"
    write(path, {"own_below/__init__.py": "F = 1\n"})
    write(stage, {"mesh.py": "import own_below\n"})
    monkeypatch.syspath_prepend(str(path))
    assert "own_below/__init__.py" in code(stage)


def test_a_package_in_an_archive_is_seen(stage, monkeypatch):
    archive, seen = stage.parents[1] / "lib.zip", []
    write(stage, {"mesh.py": "import packed_own.inner\n"})
    monkeypatch.syspath_prepend(str(archive))
    for number in "12":
        with ZipFile(archive, "w") as opened:
            opened.writestr("packed_own/__init__.py", "")
            opened.writestr("packed_own/inner.py", f"F = {number}\n")
        importlib.invalidate_caches()
        library = Library(stage.parents[1])
        seen.append(library.code.of(stage / "mesh.py").definitions["packed_own/inner.py"])
        assert str(archive) in library.looked_at()
    assert seen[0] != seen[1]


def test_a_package_that_an_editable_install_finds_is_seen(stage, monkeypatch):
    write(stage.parents[1], {"elsewhere/mapped_package/__init__.py": "F = 1\n"})
    write(stage, {"mesh.py": "import mapped_package\n"})

    class Finder:
        def find_spec(self, name, path=None, target=None):
            file = stage.parents[1] / "elsewhere" / "mapped_package" / "__init__.py"
            return spec_from_file_location(name, file) if name == "mapped_package" else None

    monkeypatch.setattr(sys, "meta_path", [*sys.meta_path, Finder()])
    assert "mapped_package/__init__.py" in code(stage)


def packages(stage: Path, *declared: str) -> tuple[dict[str, str | None], dict[str, str]]:
    """The packages of `mesh.py`, and the warnings."""
    library = Library(stage.parents[1])
    found, code = RuleFile("toy.mesh", stage / "mesh.py", library.roots[0]), library.code.of(stage / "mesh.py")
    return library.packages(found, code, declared), library.warnings


def test_packages_are_those_that_the_code_imports(stage):
    write(stage, {"mesh.py": "import json, yaml, cv2.aruco\nfrom .helper import f\n"})
    write(stage, {"helper.py": "def f():\n    import PIL.Image, own_missing\n    from . import deeper\n"})
    found, warnings = packages(stage)
    assert set(found) == {"opencv-python-headless", "pillow", "platform", "python", "pyyaml"}
    assert found == {name: version_of(name) for name in found}
    assert warnings == {}


def test_packages_that_dxb_imports_for_a_rule_are_its_packages(stage):
    write(stage, {"mesh.py": "from dextera_build.geometry import boxes\n"})
    assert {"numpy", "scipy"} <= set(packages(stage)[0])


def test_declared_packages_count_once_however_they_are_spelled(stage):
    write(stage, {"mesh.py": "import PIL\n"})
    found, _ = packages(stage, "Pillow", "OpenCV_Python.headless", "own-missing")
    assert set(found) == {"opencv-python-headless", "own-missing", "pillow", "platform", "python"}
    assert found["own-missing"] is None


def test_a_module_of_no_distribution_is_named(stage, monkeypatch):
    folder = stage.parents[1] / "lib" / "site-packages"
    write(folder, {"unpacked/__init__.py": "", "claimed.py": "", "Claim-1.0.dist-info/METADATA": "Version: 1.0\n"})
    write(folder, {"Claim-1.0.dist-info/RECORD": "claimed.py,,\n"})
    write(stage, {"mesh.py": "import unpacked, claimed\n"})
    monkeypatch.syspath_prepend(str(folder))
    found, warnings = packages(stage)
    assert (set(warnings), found["claim"]) == ({"unpacked"}, "1.0")
    assert "toy.mesh imports `unpacked`, which is neither code of the project nor of an" in warnings["unpacked"]
    assert packages(stage, "unpacked")[1] == {}


def test_a_definition_is_found_again(stage):
    index = Library(stage.parents[1]).code
    index.of(stage / "mesh.py")
    assert index.find("rules/toy/mesh.py", "mesh", [stage.parent]) == (stage / "mesh.py", 11)
    assert index.find("rules/toy/gone.py", "mesh", [stage.parent]) is None
