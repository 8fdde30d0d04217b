"""Parts of results by the names of their fields, plans in the order of a build, and names that are nearly right."""

from __future__ import annotations

import signal

import pytest

from tests import documents
from tests.e2e.conftest import small_project

SOLIDS = """
'''toy.solids: a solid for every word.'''
import numpy as np
from dextera_build.artifacts.base import Collection, File
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.rule import Context, rule

def corner(size):
    vertices = np.array([[0, 0, 0], [size, 0, 0], [0, size, 0], [0, 0, size]], np.float32)
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], np.int32)
    return Mesh(vertices=vertices, faces=faces)

@rule(version=1)
def solids(ctx: Context, text: File) -> Collection[Mesh]:
    '''Return one solid a word.'''
    words = text.data.decode().split()
    return Collection[Mesh](items={word: corner(number + 1.0) for number, word in enumerate(words)})
"""
SIZES = """
'''toy.sizes: a table of solids.'''
from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.artifacts.table import Column, Table
from dextera_build.rule import Context, rule

@rule(version=1)
def sizes(ctx: Context, solids: Collection[Mesh]) -> Table:
    '''Return one row a solid.'''
    columns = (Column(name="solid"), Column(name="edge", unit="m", digits=1), Column(name="why"))
    rows = tuple((name, float(mesh.vertices.max()) / 3, None) for name, mesh in solids.items.items())
    return Table(title="Sizes", columns=columns, rows=rows)
"""
RECIPE = """nodes:
  start: {rule: toy.start, text: one two}
  solids: {rule: toy.solids, text: $start}
  sizes: {rule: toy.sizes, solids: $solids}
"""
BACKWARD = """nodes:
  end: {rule: toy.shout, text: $middle}
  middle: {rule: toy.shout, text: $start}
  start: {rule: toy.start, text: one two}
targets: {default: [end]}
"""


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """A built project, which tests only ask."""
    space = small_project(tmp_path_factory.mktemp("solids"))
    space.write("rules/toy/solids.py", SOLIDS.lstrip())
    space.write("rules/toy/sizes.py", SIZES.lstrip())
    space.write("recipes/say/solids.yaml", RECIPE)
    assert space.build("say/solids").code == 0
    return space


@pytest.mark.medium
@pytest.mark.parametrize("suffix", [".glb", ".obj", ".ply", ".stl"])
def test_a_part_is_written_in_the_format_of_the_suffix(built, suffix):
    trimesh = pytest.importorskip("trimesh")
    answer = built.dxb("get", "say/solids:solids.items.two", "-o", f"two{suffix}")
    assert (answer.code, answer.err) == (0, "")
    assert answer.out.splitlines()[0] == f"two{suffix}"
    found = trimesh.load(built.root / f"two{suffix}", force="mesh")
    assert found.volume == pytest.approx(2**3 / 6, rel=1e-4)


def test_a_part_in_a_folder_has_the_name_of_its_field(built):
    answer = built.dxb("get", "say/solids:solids.items.one", "-o", "parts/")
    assert answer.code == 0
    assert answer.out.startswith("parts/one.")


def test_a_suffix_that_is_no_format_is_refused(built):
    answer = built.dxb("get", "say/solids:solids.items.two", "-o", "two.step")
    assert answer.code == 2
    assert "error[DXB-U220]" in answer.err
    assert not (built.root / "two.step").exists()


def test_a_part_is_shown_with_its_facts_and_fields(built):
    rows = built.dxb("show", "say/solids:solids.items.two", "--json").document
    assert rows["part"] == "say/solids:solids.items.two"
    assert rows["of"] == "say/solids:solids"
    assert rows["result"].startswith("4 vertices")
    assert rows["fields"]["faces"] == {"told": "int32 (4, 3)", "value": None, "dtype": "int32", "shape": [4, 3]}


def test_a_table_is_shown_as_rows_with_its_digits(built):
    told = dict(line.split("\t") for line in built.dxb("show", "say/solids:sizes").out.splitlines())
    assert told["columns"] == "solid, edge [m], why"
    assert (told["row 1"], told["row 2"]) == ("one, 0.3, -", "two, 0.7, -")
    assert built.dxb("show", "say/solids:sizes", "--json").document["fields"]["rows"]["value"][0][0] == "one"


@pytest.mark.slow
def test_a_viewer_prints_its_document_alone(built):
    pytest.importorskip("viser", reason="needs viser (extra `view`)")
    saved = built.run("view", "say/solids:solids.items.two", "--save", "two.viser", "--json")
    assert saved.document["bytes"] == (built.root / "two.viser").stat().st_size
    assert (saved.code, saved.err) == (0, "")
    viewer = built.start("view", "say/solids:solids.items.two", "--no-open", "--port", "0", "--json")
    assert viewer.stdout is not None
    assert documents.read(viewer.stdout.readline())["url"].startswith("http://127.0.0.1:")
    viewer.send_signal(signal.SIGINT)
    out, err = viewer.communicate(timeout=60)
    assert (viewer.returncode, out, err) == (0, "", "press Ctrl-C to stop\n")


@pytest.mark.medium
def test_a_page_that_cannot_be_saved_is_one_error(built):
    built.write("taken", "")
    answer = built.run("view", "say/solids:solids.items.two", "--save", "taken/two.html")
    assert (answer.code, answer.out, "error[DXB-U177]" in answer.err) == (2, "", True)
    assert "Server stopped" not in answer.err


@pytest.mark.medium
def test_a_field_that_is_not_there_is_told_with_the_nearest(built):
    answer = built.dxb("get", "say/solids:solids.items.tow", "-o", "two.glb")
    assert answer.code == 1
    assert "`tow` is not in `items`" in answer.err
    assert "did you mean `two`?" in answer.err
    assert "is not an artifact" in built.dxb("show", "say/solids:solids.items.two.faces").err


@pytest.mark.medium
def test_a_plan_is_in_the_order_of_the_build_and_its_numbers_are_numbers(space):
    space.write("recipes/say/backward.yaml", BACKWARD)
    plan = space.dxb("plan", "say/backward", "--json").rows
    assert [row["node"] for row in plan] == ["start", "middle", "end"]
    assert [row["last_seconds"] for row in plan] == [None] * 3
    assert space.build("say/backward").code == 0
    for words in (("plan", "say/backward"), ("ls", "say/backward")):
        assert all(isinstance(row["last_seconds"], float) for row in space.dxb(*words, "--json").rows)
    assert all(isinstance(row["seconds"], float) for row in space.dxb("ls", "runs", "--json").rows)


def test_names_that_are_nearly_right_are_told(space):
    err = space.dxb("build", "words").err
    assert "did you mean `say/words`?" in err
    assert "the nearest   say/words" in err
    assert "did you mean `dxb help toy.shout`?" in space.dxb("help", "shout").err
    assert "`dxb build --console jsonl`" in space.dxb("build", "say/words", "--json").err
