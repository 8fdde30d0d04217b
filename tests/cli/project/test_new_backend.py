"""`dxb new backend`: what it writes works at once, together with its test, for any rule of dxb."""

from __future__ import annotations

import ast
import importlib.util
import inspect
import json
import os
import re
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import get_type_hints

import numpy as np
import pytest

from dextera_build.cli.project import new_backend
from dextera_build.code.loader import Library, RuleFile
from dextera_build.errors import RuleError, UsageError
from dextera_build.formats.exchange import has_form
from dextera_build.testing import RuleRunner
from tests.e2e.space import Space

RECIPES = Path(__file__).parents[3] / "recipes"
OF_OWN_FILES = {
    "align.camera_motion",
    "align.track",
    "align.follow",
    "align.matches",
    "reference.draw",
    "reference.background_views",
    "reference.postures",
    "reference.place_robot_in_view",
    "evaluate.views",
    "simulate.perturbed",
    "demonstrate.recorded",
    "demonstrate.takes_film",
    "evaluate.attempted",
}
RULES = [found.path for found in Library().rules() if found.backends]
"""They are not imported here: that takes longer than to collect all tests."""


def with_protocols() -> list[RuleFile]:
    """Rules with backends, imported anew if another test had their modules forgotten."""
    found = [found for found in Library().rules() if found.backends and found.rule.protocol is not None]
    assert len(found) > 20
    return found


@pytest.fixture
def found(request: pytest.FixtureRequest) -> RuleFile:
    """A rule, imported anew if another test had its modules forgotten."""
    return Library().find(request.param)


@pytest.fixture
def space(tmp_path):
    made = Space(tmp_path / "project")
    made.write("dxb.toml", 'cache = "cache"\n')
    return made


def written(space: Space, rule: str, kind: str) -> list[Path]:
    answer = space.dxb("new", "backend", f"{rule}=mine", "--kind", kind)
    assert answer.code == 0, answer.err
    return [space.root / line for line in answer.out.splitlines()]


def pytest_of(space: Space, count: int = 1) -> None:
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:dash", "tests"]
    done = subprocess.run(command, cwd=space.root, env=space.environment(), capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    assert f"{count} passed" in done.stdout


@pytest.mark.slow
@pytest.mark.parametrize("kind", new_backend.KINDS)
def test_the_backend_and_its_test_pass_at_once(space, kind):
    files = written(space, "factorize.segment", kind)
    assert len(files) == {"in-process": 2, "call": 2}.get(kind, 3)
    pytest_of(space)


@pytest.mark.slow
@pytest.mark.parametrize("found", RULES, indirect=True)
def test_a_server_of_any_rule_returns_what_it_was_sent(space, found):
    """Values of every type that a backend may take or return pass through the formats of the field."""
    if found.path == "simulate.mesh_robot" and importlib.util.find_spec("robosuite") is None:
        pytest.skip("needs robosuite's meshes")
    if found.rule.protocol is None:
        pytest.skip("its backends have no functions")
    if found.path in OF_OWN_FILES:
        pytest.skip("the only recipe that calls it needs files of the user's own")
    if not any(f"rule: {found.path}" in recipe.read_text() for recipe in RECIPES.rglob("*.yaml")):
        pytest.skip("no recipe calls it, so it has no example")
    written(space, found.path, "server")
    pytest_of(space)


@pytest.mark.slow
def test_what_is_written_is_short_python_that_lacks_nothing(tmp_path):
    for found in with_protocols():
        asked = [
            new_backend.Wanted(found, "mine", kind, tmp_path / "x_mine.py", "x_mine.py", False)
            for kind in new_backend.KINDS
        ]
        assert asked[0].other == "stub" or "stub" not in found.backends, found.path
        for text in (text for wanted in asked for text in new_backend.files(wanted, tmp_path / "tests").values()):
            ast.parse(text)
            assert len(text.splitlines()) <= 60, found.path
            assert max(map(len, text.splitlines())) <= 260, found.path
            assert "\n\n\n\n" not in text, found.path


def test_every_function_of_a_backend_returns_data():
    for found in with_protocols():
        for method in vars(found.rule.protocol).values():
            if inspect.isfunction(method) and method.__name__[0] != "_":
                returned = get_type_hints(method, localns={"np": np}, include_extras=True)["return"]
                assert has_form(returned), f"{found.path}.{method.__name__}"


def test_a_program_is_sent_data_only(tmp_path):
    found = Library().find("factorize.mesh")
    wanted = new_backend.Wanted(found, "mine", "server", tmp_path / "x_mine.py", "x_mine.py", False)
    text = new_backend.files(wanted, tmp_path)[wanted.file]
    assert 'ctx.outside("complete", example=example, view=view, common=common)' in text


def test_a_kind_belongs_to_a_backend(space):
    answer = space.dxb("new", "rule", "toy.thing", "--kind", "server")
    assert "error[DXB-U197]: a rule has no kind" in answer.err
    assert "dxb new rule toy.thing" in answer.err


def test_nothing_is_overwritten(space):
    space.write("rules/factorize/mesh_mine/program.py", "# my own\n")
    answer = space.dxb("new", "backend", "factorize.mesh=mine", "--kind", "command")
    assert "exists already" in answer.err
    assert not (space.root / "rules/factorize/mesh_mine.py").exists()


RULE = '''
"""toy.say: says a word."""
from typing import Any, Protocol

from dextera_build.artifacts.base import File
from dextera_build.rule import Context, rule

class SayBackend(Protocol):
    """A voice."""
    def say(self, ctx: Context, word: File, options: Any) -> File:
        """The word as said."""
        ...

@rule(version=1)
def say(ctx: Context[SayBackend], word: File) -> File:
    """Return the word as said."""
    return ctx.backend.say(ctx, word, ctx.backend_options)
'''
STUB = '''
"""Quiet."""
from dextera_build.artifacts.base import File
from dextera_build.rule import Backend, Context, Options

BACKEND = Backend(summary="quietly", profiles=("stub", "cpu"))

class StubOptions(Options):
    """Options."""
    end: str = "."
    """The last character."""

def say(ctx: Context, word: File, options: StubOptions) -> File:
    """The word."""
    return File(data=word.data + options.end.encode())
'''
WORD = '''
"""toy.word: a word."""
from dextera_build.artifacts.base import File
from dextera_build.rule import Context, Options, rule

class WordOptions(Options):
    """Options."""
    text: str = "hello"
    """The word."""

@rule(version=1)
def word(ctx: Context, *, options: WordOptions) -> File:
    """Return a word."""
    return File(data=options.text.encode())
'''


@pytest.fixture
def toy(space):
    space.write("rules/toy/say.py", RULE.lstrip())
    space.write("rules/toy/say_stub.py", STUB.lstrip())
    space.write("rules/toy/word.py", WORD.lstrip())
    space.write("recipes/say/word.yaml", "nodes: {a: {rule: toy.word}, b: {rule: toy.say, word: $a}}\n")
    return space


def runner(space: Space, tmp_path: Path) -> RuleRunner:
    scratch = tmp_path / "scratch"
    scratch.mkdir(exist_ok=True)
    return RuleRunner(scratch, space.root, calls=lambda *words, **manner: b"{}")


@pytest.mark.medium
@pytest.mark.parametrize("kind", new_backend.KINDS)
def test_a_backend_of_a_rule_of_the_project_answers_as_its_stub(toy, tmp_path, kind):
    written(toy, "toy.say", kind)
    made = runner(toy, tmp_path)
    inputs, options = made.example("toy.say")
    assert made.run("toy.say", backend="mine", options=options, **inputs).data == b"hello."


@pytest.mark.parametrize("kind", new_backend.KINDS)
def test_without_a_stub_there_is_a_skeleton_and_a_note(toy, kind):
    (toy.root / "rules/toy/say_stub.py").unlink()
    answer = toy.dxb("new", "backend", "toy.say=mine", "--kind", kind)
    assert answer.out == "rules/toy/say_mine.py\n"
    assert "note: backend `mine` has none to begin as" in answer.err
    assert "`dxb new backend toy.say=stub`" in answer.err
    refused = toy.dxb("build", "say/word", "--backend", "toy.say=mine")
    assert "`say` of backend `mine` is not written yet" in refused.err


def test_a_stub_uses_no_other_backend_and_is_one_of_its_profile(toy):
    toy.edit("rules/toy/say_stub.py", '("stub", "cpu")', '("cpu",)')
    (toy.root / "rules/toy/say_stub.py").rename(toy.root / "rules/toy/say_mine.py")
    answer = toy.dxb("new", "backend", "toy.say=stub")
    assert "fill in its functions" in answer.err
    text = (toy.root / "rules/toy/say_stub.py").read_text()
    assert "uses=" not in text
    assert 'profiles=("stub",)' in text


def test_a_rule_without_a_protocol_is_told(toy):
    answer = toy.dxb("new", "backend", "toy.word=mine", "--kind", "command")
    assert answer.out == "rules/toy/word_mine.py\n"
    assert "note: toy.word takes no `ctx: Context[PROTOCOL]`" in answer.err


@pytest.mark.medium
def test_doctor_tests_a_backend_by_name(toy):
    written(toy, "toy.say", "in-process")
    answer = toy.dxb("doctor", "--self-test", "toy.say=mine")
    assert re.search(r"^ok\ttoy.say=mine\t.*self-test", answer.out, re.MULTILINE)
    assert not re.search(r"^ok\ttoy.say=stub\t.*self-test", answer.out, re.MULTILINE)
    assert "error[DXB-R202]: `toy.say` has no backend `mime`" in toy.dxb("doctor", "--self-test", "toy.say=mime").err
    assert "error[DXB-R201]: no rule is called `toy.sya`" in toy.dxb("doctor", "--self-test", "toy.sya").err


def test_a_service_without_its_address_is_told(toy):
    written(toy, "toy.say", "call")
    answer = toy.dxb("build", "say/word", "--backend", "toy.say=mine")
    assert "hint: set the environment variable `MINE_URL`" in answer.err


def test_the_code_of_a_used_backend_enters_the_key(toy):
    written(toy, "toy.say", "in-process")
    words = ("say/word:b", "--backend", "toy.say=mine")
    assert toy.dxb("build", *words).code == 0
    toy.edit("rules/toy/say_stub.py", "+ options.end", "+ b'!' + options.end")
    planned = toy.dxb("plan", *words, "--json").rows
    assert "stale" in json.dumps(planned)


def test_a_backend_that_is_not_declared_is_not_used(toy, tmp_path):
    file = written(toy, "toy.say", "in-process")[0]
    file.write_text(file.read_text().replace('uses=("stub",)', "uses=()"))
    made = runner(toy, tmp_path)
    with pytest.raises(RuleError, match="does not declare that it uses `stub`") as caught:
        made.run("toy.say", backend="mine", **made.example("toy.say")[0])
    assert caught.value.code == "DXB-B381"
    file.write_text(file.read_text().replace("uses=()", 'uses=("loud",)'))
    answer = toy.dxb("build", "say/word", "--backend", "toy.say=mine")
    assert "`toy.say` has no backend `loud`" in answer.err


def test_an_answer_without_a_type_needs_a_function_of_the_rule(toy, tmp_path):
    file = written(toy, "toy.say", "command")[0]
    file.write_text(file.read_text().replace('ctx.outside("say"', 'ctx.outside("shout"'))
    made = runner(toy, tmp_path)
    with pytest.raises(RuleError, match=r"`shout` is no function of the backends of toy.say") as caught:
        made.run("toy.say", backend="mine", **made.example("toy.say")[0])
    assert caught.value.code == "DXB-B382"


@pytest.mark.slow
def test_a_rule_that_no_recipe_calls_has_no_example(toy, tmp_path):
    (toy.root / "recipes/say/word.yaml").unlink()
    with pytest.raises(UsageError, match=r"no recipe calls `toy.say`") as caught:
        runner(toy, tmp_path).example("toy.say")
    assert caught.value.code == "DXB-U198"


def test_an_example_leaves_the_projects_store_and_lock_file_alone(toy, tmp_path):
    assert toy.dxb("build", "--lock", "say/word").code == 0
    runs = os.listdir(toy.root / "cache" / "runs")
    before = (toy.root / "dxb.lock").read_text()
    runner(toy, tmp_path).example("toy.say")
    assert (toy.root / "dxb.lock").read_text() == before
    assert os.listdir(toy.root / "cache" / "runs") == runs


PAGE = Path(__file__).parents[3] / "dextera_build" / "docs" / "writing_rules.md"
SMOOTH_STUB = '''
"""Nothing moves."""
from typing import Any

from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.rule import Backend, Context, Options

BACKEND = Backend(summary="nothing moves", profiles=("stub", "cpu"))

def smooth(ctx: Context, mesh: Mesh, rounds: int, options: Options) -> Mesh:
    """The mesh."""
    return mesh
'''
CUBE = '''
"""toy.cube: a cube."""
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.rule import Context, rule

@rule(version=1, packages=("numpy",))
def cube(ctx: Context) -> Mesh:
    """Return a tetrahedron."""
    import numpy as np

    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]], np.int32)
    return Mesh(vertices=np.eye(4, 3, dtype=np.float32), faces=faces)
'''


@pytest.mark.slow
def test_the_page_shows_what_is_written(space):
    """The commands of the section, what they print, the pieces of code it shows, and the tests that they write."""
    page = PAGE.read_text()
    space.write("rules/factorize/smooth.py", re.findall(r"^```python\n(.*?)^```", page, re.DOTALL | re.MULTILINE)[0])
    space.write("rules/factorize/smooth_stub.py", SMOOTH_STUB.lstrip())
    space.write("rules/toy/cube.py", CUBE.lstrip())
    space.write("recipes/toy/a.yaml", "nodes: {a: {rule: toy.cube}, b: {rule: factorize.smooth, mesh: $a}}\n")
    section = page.partition("## Kinds of backends\n")[2].partition("\n## ")[0]
    parts = section.split("\n### ")[1:]
    assert len(parts) == len(new_backend.KINDS)
    for part in parts:
        command, printed = re.findall(r"```console\n\$ dxb (.*?)\n(.*?)```", part, re.DOTALL)[0]
        answer = space.dxb(*command.split())
        assert answer.out == printed, answer.err
        code = "\n".join((space.root / line).read_text() for line in printed.splitlines())
        for block in re.findall(r"```python\n(.*?)```", part, re.DOTALL):
            assert block in code or textwrap.indent(block, "    ") in code
    pytest_of(space, 4)
