"""Files and models that a plan needs, told at the user's flag or line before anything runs."""

from __future__ import annotations

import pytest

from dextera_build.errors import RecipeError
from tests.recipe.conftest import Space
from tests.recipe.test_plan import planned, refused

READ = '''
"""toy.read: a folder as one file."""
from dextera_build.artifacts.base import File, Folder
from dextera_build.rule import Context, rule

@rule(version=1)
def read(ctx: Context, notes: Folder) -> File:
    """Return all files, one after another."""
    return File(data=b" ".join(data for _, data in sorted(notes.files.items())))
'''
RECIPE = "inputs: {notes: {help: a folder}}\nnodes: {text: {rule: toy.read, notes: $notes}}\n"
ASKED = '''
"""Asks."""
from dextera_build.rule import Backend, Context, Options
BACKEND = Backend(summary="asks", profiles=("cloud",))

class AskedOptions(Options):
    """Options."""
    model: str
    """Name of the model."""

def speak(ctx: Context, text, options: AskedOptions):
    return text
'''


def test_a_file_for_a_folder_is_told_with_the_flag_that_gives_it(space: Space) -> None:
    space.write("rules/toy/read.py", READ)
    space.write("recipes/say/notes.yaml", RECIPE)
    file = space.write("notes/a.txt", "one")
    with pytest.raises(RecipeError) as caught:
        planned(space, "say/notes", inputs={"notes": str(file)})
    error = caught.value
    assert (error.code, error.message) == ("DXB-R107", "`a.txt` is a file, but `notes` takes Folder")
    assert str(error.where) == f"the command line: --input notes={file}"
    assert error.facts["read as"].endswith("recipes/say/notes.yaml:2:39")
    assert error.hint == f"name a folder; `{file.parent}` holds the file"
    planned(space, "say/notes", inputs={"notes": str(file.parent)})


def test_a_folder_for_a_file_is_told_with_the_line_that_names_it(space: Space) -> None:
    space.write("notes/a.txt", "one")
    error = refused(space, "inputs: {text: notes}\nnodes: {loud: {rule: toy.shout, text: $text}}")
    assert error.message == "`notes` is a folder, but `text` takes File"
    assert str(error.where).endswith("wrong.yaml:1:16")
    assert error.hint == "name a file in it"


def test_an_option_without_a_default_is_told_with_the_flag_that_sets_it(space: Space) -> None:
    space.write("rules/toy/spoken_asked.py", ASKED)
    error = refused(space, "nodes: {s: {rule: toy.start}, t: {rule: toy.spoken, text: $s, backend: asked}}")
    assert (error.code, error.message) == ("DXB-R117", "`toy.spoken` needs the option `asked.model`")
    assert str(error.where).endswith("wrong.yaml:1:41")
    assert error.facts == {"it is": "Name of the model."}
    assert error.hint == "`--set 't.asked.model=VALUE'`, or the option at the node in the recipe"


@pytest.mark.parametrize(
    ("written", "missing"),
    [
        ("def bare(ctx, text):", "ctx, text, return"),
        ("def bare(ctx: Context, text: File):", "return"),
        ("def bare(ctx: Context, text) -> File:", "text"),
    ],
)
def test_a_rule_without_types_is_told_at_its_line(space: Space, written: str, missing: str) -> None:
    lines = ["from dextera_build.artifacts.base import File", "from dextera_build.rule import Context, rule"]
    lines += ["@rule(version=1)", written, "    return text", ""]
    space.write("rules/toy/bare.py", "\n".join(lines))
    error = refused(space, "nodes: {s: {rule: toy.start}, b: {rule: toy.bare, text: $s}}")
    assert (error.code, error.facts) == ("DXB-R219", {"without a type": missing})
    assert str(error.where).endswith("rules/toy/bare.py:4")
    assert error.exit_code == 2


def test_a_type_that_the_file_does_not_import_is_told(space: Space) -> None:
    lines = ["from __future__ import annotations", "from dextera_build.rule import Context, rule"]
    lines += ["@rule(version=1)", "def bare(ctx: Context, text: File) -> File:", "    return text", ""]
    space.write("rules/toy/bare.py", "\n".join(lines))
    error = refused(space, "nodes: {s: {rule: toy.start}, b: {rule: toy.bare, text: $s}}")
    assert error.code == "DXB-R219"
    assert "name 'File' is not defined" in error.message
