"""dxb from Python: the example in the page, and what the command line's flags do."""

from __future__ import annotations

import importlib
import re
import subprocess
import sys
import threading
from pathlib import Path

import pytest

import dextera_build
from dextera_build import Project
from dextera_build.errors import RuleError, StaleError, UsageError
from dextera_build.project import lockfile
from tests.e2e.conftest import space  # noqa: F401 - a fixture

PAGE = Path(__file__).parent.parent / "dextera_build" / "docs" / "python_api.md"


@pytest.fixture
def project(space):  # noqa: F811 - the fixture above
    return Project.find(space.root)


@pytest.mark.medium
def test_the_page_runs(tmp_path, monkeypatch, capsys):
    (tmp_path / "dxb.toml").write_text("")
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for block in re.findall(r"^```python\n(.*?)^```", PAGE.read_text(), re.DOTALL | re.MULTILINE):
        exec(block, names)
    printed = capsys.readouterr()
    assert printed.out.splitlines()[0].startswith("23 ran kuka_leap: 23 joints")
    assert "DXB-U108 no recipe is called `robot/kuka_leaf` did you mean" in printed.out
    assert printed.err == ""


def test_a_build_returns_what_became_of_every_node(project):
    built = project.build("say/words")
    assert built.ok
    assert built.targets == ("all",)
    assert repr(built) == f"Result(ok, run {built.run}, {len(built.nodes)} nodes, 1 targets)"
    assert {record.status for record in built.nodes.values()} == {"ran"}
    assert built.artifact("all").data == b"ONE!!! TWO!!!"
    assert built.artifact("word[two].loud").data == b"TWO!"
    assert {r.status for r in project.build("say/words:words", "start").nodes.values()} == {"cached"}
    assert project.get("say/words:all").data == b"ONE!!! TWO!!!"


@pytest.mark.medium
def test_flags_have_the_same_power(project, tmp_path):
    quiet = project.build("say/words", settings={"start.text": "a b c", "word[a].loud.times": 3}, jobs=1)
    assert quiet.artifact("all").data == b"A!!!!! B!!! C!!!"
    forced = project.build("say/words", "word.loud", settings={"start.text": "a"}, force=["word[a].loud"])
    assert forced.nodes["word[a].loud"].status == "ran"
    assert forced.nodes["start"].status == "ran"
    assert project.build("say/words", profile="stub").ok
    with pytest.raises(UsageError, match="`profile` cannot be `fast`"):
        project.build("say/words", profile="fast")


def test_inputs_are_bound(project):
    (project.root / "recipes/say/note.yaml").write_text(
        "inputs: {note: {}}\nnodes: {w: {rule: toy.split, text: $note}}\n"
    )
    note = project.root / "note.txt"
    note.write_text("x y")
    assert set(project.build("say/note", inputs={"note": note}).artifact("w").items) == {"x", "y"}


def test_a_failed_node_is_told_not_raised(project, capfd):
    (project.root / "recipes/say/bad.yaml").write_text(
        "nodes:\n  a: {rule: toy.start}\n  b: {rule: toy.slow, text: $a, do: fail}\n  c: {rule: toy.split, text: $b}\n"
    )
    built = project.build("say/bad", keep_going=True)
    assert not built.ok
    assert set(built.errors) == {"b"}
    assert isinstance(built.errors["b"], RuleError)
    assert built.nodes["c"].status == "waits"
    with pytest.raises(UsageError, match="`c` returned nothing: waits"):
        built.artifact("c")
    with pytest.raises(UsageError, match="`aa` is not a node of this build") as caught:
        built.artifact("aa")
    assert caught.value.hint == "did you mean `a`?"
    assert capfd.readouterr() == ("", "")


def test_wrong_names_and_values_are_raised(project):
    with pytest.raises(UsageError, match="no recipe is called"):
        project.build("say/word")
    with pytest.raises(UsageError, match="has no node `ell`"):
        project.build("say/words", "ell")
    with pytest.raises(UsageError, match="has no node `nothing`"):
        project.build("say/words", force=["nothing"])
    for value in (float("nan"), object()):
        with pytest.raises(UsageError, match=r"the value of `start\.text` is not plain data"):
            project.build("say/words", settings={"start.text": value})

    for verb in (project.build, project.plan, project.why, project.get):
        with pytest.raises(UsageError, match="no argument is called `setting`"):
            verb("say/words:start", setting={"start.text": "x"})


def test_plan_and_why(project):
    assert {node.status for node in project.plan("say/words")} == {"stale", "unknown"}
    assert project.why("say/words:start").answer == "never built"
    project.build("say/words")
    assert {node.status for node in project.plan("say/words", "words")} == {"cached"}
    why = project.why("say/words:start", settings={"start.text": "three"})
    assert why.answer.startswith("stale: 1 thing")
    assert [(cause.kind, cause.name, cause.change) for cause in why.causes] == [("option", "text", "one two -> three")]


def test_locking(project, capfd):
    project.build("say/words", lock=True)
    assert len(lockfile.read(project.root / "dxb.lock").pins) == 1
    assert project.build("say/words", locked=True).ok
    recipe = project.root / "recipes/say/words.yaml"
    recipe.write_text(recipe.read_text().replace("one two", "three"))
    with pytest.raises(StaleError):
        project.build("say/words", locked=True)
    assert capfd.readouterr() == ("", "")


def test_builds_from_threads(project):
    results = {}

    def build(text):
        results[text] = project.build("say/words", settings={"start.text": text}).artifact("all").data

    threads = [threading.Thread(target=build, args=(text,)) for text in ("a b", "b c")]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert results == {"a b": b"A!!! B!!!", "b c": b"B!!! C!!!"}


def test_events_come_to_the_listener(project):
    seen = []
    project.build("say/words", listen=seen.append)
    assert seen[0].kind == "run_started"
    assert seen[-1].kind == "run_finished"
    assert sum(event.kind == "node_finished" for event in seen) == 7


def test_the_import_is_light():
    code = "import sys, dextera_build; assert not {'dextera_build.api', 'numpy', 'pydantic', 'yaml'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_an_unknown_name_of_the_package_is_an_attribute_error():
    import dextera_build

    with pytest.raises(AttributeError, match="no attribute `Projekt`"):
        dextera_build.Projekt  # noqa: B018


def test_every_public_name_is_listed_and_paths_may_be_texts(space, tmp_path):  # noqa: F811
    assert {"Project", "Result", "__version__"} <= set(dir(dextera_build))
    assert all(hasattr(dextera_build, name) for name in dir(dextera_build))
    assert Project(str(space.root)).root == space.root
    built = Project.find(str(space.root)).build("say/words")
    (file,) = built.artifact("all").export(str(tmp_path), "words.txt")
    assert file.read_bytes() == built.artifact("all").data


@pytest.mark.parametrize(
    ("address", "names"),
    [
        ("dextera_build.rule", ("Context", "Options", "rule")),
        ("dextera_build.artifacts.base", ("Array", "Artifact", "Collection", "File", "Folder", "Value")),
        ("dextera_build.testing", ("RuleRunner",)),
        ("dextera_build.errors", ("DxbError", "RuleError")),
    ],
)
def test_modules_that_rules_of_projects_import_keep_their_addresses(address, names):
    module = importlib.import_module(address)
    assert not [name for name in names if not hasattr(module, name)]
