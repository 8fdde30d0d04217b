"""The code that runs is the code that was digested, whatever byte code lies about and whoever edits it meanwhile."""

from __future__ import annotations

import json
import os
import py_compile
import subprocess
import sys
from pathlib import Path

import numpy
import pytest

from dextera_build.code.importer import IMPORTER
from dextera_build.code.loader import Library
from dextera_build.code.modules import PACKAGE, read, shared
from dextera_build.errors import MachineError, Place, RecipeError, RuleError
from dextera_build.testing import RuleRunner
from tests.e2e.space import Space

RULE = '''
"""toy.mul: a rule."""
from dextera_build.artifacts.base import File
from dextera_build.rule import Context, rule
from .deep import F

@rule(version=1)
def mul(ctx: Context) -> File:
    """Say a number."""
    {body}
    return File(data=b"%d" % F)
'''


@pytest.fixture
def project(tmp_path: Path) -> Path:
    stage = tmp_path / "rules" / "toy"
    stage.mkdir(parents=True)
    (stage / "mul.py").write_text(RULE.format(body=""))
    (stage / "deep.py").write_text("F = 3\n")
    return tmp_path


@pytest.fixture(autouse=True)
def _writes_byte_code(monkeypatch):
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    monkeypatch.delenv("PYTHONDONTWRITEBYTECODE", raising=False)


def said(project: Path) -> bytes:
    return RuleRunner(project / "scratch", project=project).run("toy.mul").data


def test_byte_code_of_the_same_size_and_time_is_not_read(project):
    deep = project / "rules" / "toy" / "deep.py"
    py_compile.compile(str(deep))
    time = deep.stat().st_mtime_ns
    deep.write_text("F = 5\n")
    os.utime(deep, ns=(time, time))
    assert said(project) == b"5"


def test_byte_code_is_not_written(project):
    assert said(project) == b"3"
    assert list(project.rglob("*.pyc")) == []


def test_a_package_on_the_search_path_runs_from_source(project, monkeypatch):
    package = project / "src" / "own_for_importer"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("F = 7\n")
    py_compile.compile(str(package / "__init__.py"))
    time = (package / "__init__.py").stat().st_mtime_ns
    (package / "__init__.py").write_text("F = 8\n")
    os.utime(package / "__init__.py", ns=(time, time))
    (project / "rules/toy/deep.py").write_text("from own_for_importer import F\n")
    monkeypatch.syspath_prepend(str(project / "src"))
    assert said(project) == b"8"


def run(project: Path, sources: dict[str, str], variables: dict[str, str] | None = None, **more: object) -> str:
    """What a worker answers, in a process of its own."""
    task = {
        "rule": "toy.mul",
        "backend": None,
        "options": {},
        "inputs": {},
        "store": str(project / "store"),
        "project": str(project),
        "sources": sources,
        **more,
    }
    program = (
        "import json, sys\nfrom dextera_build.running.worker_entry import run_task\n"
        "from dextera_build.errors import DxbError\nfrom dextera_build.store.store import opened\n"
        "task = json.loads(sys.argv[1])\n"
        "try:\n    print(opened(task['store']).blobs.get(run_task(task, lambda *said: None)['output']).decode())\n"
        "except DxbError as error:\n    print(error.code, error.where.file if error.where else '')\n"
    )
    words = [sys.executable, "-c", program, json.dumps(task)]
    done = subprocess.run(
        words, capture_output=True, text=True, cwd=project, check=False, env={**os.environ, **(variables or {})}
    )
    assert not done.returncode, done.stderr
    return done.stdout.strip()


def sources(project: Path) -> dict[str, str]:
    library = Library(project)
    return dict(library.code.of(library.find("toy.mul").file).sources)


def test_a_worker_runs_what_was_digested(project):
    assert "DXB" not in run(project, sources(project))


@pytest.mark.medium
def test_a_worker_refuses_a_package_of_another_version(project):
    here = {"numpy": numpy.__version__}
    assert run(project, sources(project), packages=here) == run(project, sources(project))
    assert run(project, sources(project), packages={**here, "pydantic": "0.1"}).startswith("DXB-E353")


def test_a_worker_refuses_code_that_was_edited(project):
    known = sources(project)
    (project / "rules/toy/deep.py").write_text("F = 5\n")
    assert run(project, known) == f"DXB-B315 {project / 'rules/toy/deep.py'}"


@pytest.mark.medium
def test_a_worker_runs_what_was_digested_although_it_was_edited(project):
    known, before = sources(project), run(project, sources(project))
    with shared() as (variables, share):
        share([project / "rules/toy/mul.py", project / "rules/toy/deep.py"])
        (project / "rules/toy/deep.py").write_text("F = 5\n")
        assert run(project, known, variables) == before
    assert run(project, known, variables).startswith("DXB-B315")


def test_an_edit_counts_although_the_rule_catches_what_it_can(project):
    body = "try:\n        from . import late\n    except BaseException:\n        pass"
    (project / "rules/toy/mul.py").write_text(RULE.format(body=body))
    (project / "rules/toy/late.py").write_text("A = 1\n")
    known = sources(project)
    (project / "rules/toy/late.py").write_text("A = 2\n")
    assert run(project, known).startswith("DXB-B315")


@pytest.mark.medium
def test_a_module_that_appears_later_is_not_there(project):
    body = "try:\n        from .late import F\n    except ImportError:\n        F = 3"
    (project / "rules/toy/mul.py").write_text(RULE.format(body=body))
    known = sources(project)
    before = run(project, known)
    (project / "rules/toy/late.py").write_text("F = 2\n")
    assert run(project, known) == before


@pytest.mark.parametrize("later", ["late.py", "late/__init__.py", "deep/__init__.py"])
def test_a_module_that_appears_is_imported_by_the_next_build_of_a_process(project, later):
    (project / "rules/toy/deep.py").write_text("try:\n    from .late import F\nexcept ImportError:\n    F = 3\n")
    assert said(project) == b"3"
    (project / "rules/toy" / later).parent.mkdir(exist_ok=True)
    (project / "rules/toy" / later).write_text("F = 2\n")
    assert said(project) == b"2"


@pytest.mark.parametrize("later", ["late.py", "inner/__init__.py"])
def test_a_module_that_appears_after_the_import_but_before_the_digest_is_refused(project, later):
    (project / "rules/toy/inner").mkdir()
    (project / "rules/toy/inner/leaf.py").write_text("")
    imports = "from .inner import leaf\ntry:\n    from . import late\nexcept ImportError:\n    pass\nF = 3\n"
    (project / "rules/toy/deep.py").write_text(imports)
    library = Library(project)
    found = library.find("toy.mul")
    assert found.rule
    (project / "rules/toy" / later).write_text("")
    with pytest.raises(RuleError, match="it was edited while the build ran"):
        IMPORTER.want(library.code.of(found.file).sources, [found.root.name])


def test_code_of_each_root_has_names_of_its_own(project):
    """A rule that comes with dxb, and a file of the project that runs with it: one relative path may be in both."""
    library = Library(project)
    bundled, own = library.find("evaluate.rollouts"), library.find("toy.mul")
    assert own.rule
    sources = library.code.of(bundled.file, own.file).sources
    assert "rules/evaluate/rollouts.py" in sources
    assert "rules+2/toy/deep.py" in sources
    assert library.place_of("rules+2/toy/deep.py", "F") == (project / "rules/toy/deep.py", 1)
    roots = [bundled.root.name, own.root.name]
    IMPORTER.want({"rules+2/toy/deep.py": sources["rules+2/toy/deep.py"]}, roots)
    with pytest.raises(RuleError, match="it was edited while the build ran"):
        IMPORTER.want(sources, roots[:1])
    with pytest.raises(RuleError, match="it was edited while the build ran") as caught:
        IMPORTER.want({"rules+2/toy/deep.py": "0" * 32}, roots)
    assert str(caught.value.where) == str(project / "rules/toy/deep.py")


def test_a_namespace_package_below_one_that_failed_to_load_is_searched_again(project):
    broken = project / "rules/toy/broken"
    (broken / "inner").mkdir(parents=True)
    (broken / "inner/leaf.py").write_text("")
    (broken / "__init__.py").write_text("from .inner import leaf\nraise ImportError('not today')\n")
    deep = project / "rules/toy/deep.py"
    deep.write_text("try:\n    from .broken import F\nexcept ImportError:\n    F = 3\n")
    assert said(project) == b"3"
    (broken / "__init__.py").write_text("from .inner import leaf\nF = 2\n")
    assert said(project) == b"2"
    (broken / "__init__.py").write_text("from .inner import leaf\nraise ImportError('again')\n")
    assert said(project) == b"3"
    assert said(project) == b"3"


def test_a_package_that_comes_to_shadow_a_module_is_refused(project):
    known = sources(project)
    (project / "rules/toy/deep").mkdir()
    (project / "rules/toy/deep/__init__.py").write_text("F = 9\n")
    assert run(project, known).startswith("DXB-B315")


def test_a_file_that_makes_a_package_of_a_stage_is_refused(project):
    known = sources(project)
    (project / "rules/toy/__init__.py").write_text("F = 9\n")
    assert run(project, known).startswith("DXB-B315")


@pytest.mark.medium
def test_a_build_runs_the_code_that_it_began_with(project):
    space = Space(project)
    space.write("dxb.toml", 'cache = "cache"\n')
    # The rule itself is imported by the process that plans, its helper only by the worker, after the edit.
    edit = "import pathlib; here = pathlib.Path(__file__).with_name('late.py')"
    body = f"{edit}\n    if 'A = 1' in here.read_text(): here.write_text('A = 2\\n')\n    from .late import A as F"
    space.write("rules/toy/mul.py", RULE.format(body=body))
    space.write("rules/toy/late.py", "A = 1\n")
    space.write("recipes/g.yaml", "inputs: {}\nnodes:\n  a: {rule: toy.mul}\ntargets: {default: [a]}\n")
    for expected in (b"1", b"2"):
        done = space.dxb("build", "g", "--console", "none")
        assert not done.code, done.err
        assert (project / "cache/out/g/a/a").read_bytes() == expected
    space.write("rules/toy/late.py", "A = 1\n")
    (project / "rules/toy/mul.py").write_text(RULE.format(body=body.replace("'A = 1'", "'never'")))
    assert not space.dxb("build", "g", "--console", "none").code
    assert (project / "cache/out/g/a/a").read_bytes() == b"1"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("# -*- coding: latin-1 -*-\nF = len('\xe9') + 2\n".encode("latin-1"), b"3"),
        (b"\xef\xbb\xbfF = 3\n", b"3"),
        (b"F = 0" + b" + 1" * 20_000, "nested too deeply"),
        (b"class A: pass\na = A()\na.a = a\nF = a" + b".a" * 50_000, "nested too deeply"),
        (b"if 0: F = 1\n" + b"elif 0: F = 2\n" * 30_000 + b"else: F = 3\n", "nested too deeply"),
        (b"F = (\n", "not valid Python"),
        (b"F = '\xff'\n", "not valid Python"),
        (b"# coding: nonsense\nF = 3\n", "not valid Python"),
        (b"F = 3\0\n", "not valid Python"),
        (b"import os\nos._exit(0)\n", "ends the process"),
        (b"raise SystemExit(3)\n", "ends the process"),
        (b"F = 1 / 0\n", "ZeroDivisionError"),
    ],
    ids=range(12),
)
def test_odd_sources_give_a_right_answer_or_one_clear_error(project, text, says):
    (project / "rules/toy/deep.py").write_bytes(text)
    if isinstance(says, bytes):
        assert said(project) == says
        assert "rules/toy/deep.py" in sources(project)
    else:
        with pytest.raises((RecipeError, RuleError), match=says) as caught:
            said(project)
        assert caught.value.where
        assert caught.value.hint or "Python" in says or "Error" in says


def test_a_module_that_cannot_be_read_is_named(project):
    with pytest.raises(MachineError, match="cannot be read: Is a directory") as caught:
        read(project / "rules")
    assert caught.value.where == Place(str(project / "rules"))


def test_a_package_that_is_not_on_the_search_path_is_named_with_the_way_there(project):
    (project / "src/off_the_path").mkdir(parents=True)
    (project / "rules/toy/deep.py").write_text("from off_the_path import F\n")
    with pytest.raises(MachineError, match="needs the package `off_the_path`") as caught:
        said(project)
    assert "or its folder on PYTHONPATH" in caught.value.hint


@pytest.mark.medium
def test_a_worker_searches_where_the_build_does_and_not_in_the_current_folder(project):
    space = Space(project)
    space.write("dxb.toml", 'cache = "cache"\n')
    body = "import os, sys\n    assert os.getcwd() not in sys.path\n    import deep_and_own\n    if 0: import unclaimed"
    space.write("rules/toy/mul.py", RULE.format(body=body))
    space.write("recipes/g.yaml", "inputs: {}\nnodes:\n  a: {rule: toy.mul}\ntargets: {default: [a]}\n")
    space.write("path/deep_and_own.py", "")
    space.write("site-packages/unclaimed.py", "")
    space.write("json.py", "raise SystemExit('the wrong one')\n")
    path = os.pathsep.join(map(str, (PACKAGE.parent, project / "path", project / "site-packages")))
    words = [sys.executable, "-P", "-m", "dextera_build", "build", "g", "--console", "none"]
    done = subprocess.run(
        words, capture_output=True, text=True, cwd=project, env=space.environment(PYTHONPATH=path), check=False
    )
    assert not done.returncode, done.stderr
    assert done.stderr.count("warning: toy.mul imports `unclaimed`, which is neither code of the project nor of") == 1


def test_a_type_of_another_module_is_told_with_its_import(project):
    file = project / "rules" / "toy" / "mul.py"
    for module in ("geometry", "points"):
        file.write_text(f"from dextera_build.artifacts.{module} import PointCloud, Nothing\n" + RULE.format(body=""))
        with pytest.raises(RecipeError) as caught:
            Library(project).find("toy.mul").rule  # noqa: B018 - imports it
        assert caught.value.code == "DXB-R205"
        assert caught.value.hint == "`from dextera_build.artifacts.spatial.point_cloud import PointCloud`"
