"""What lies in `out/`: one folder per request, whole, and what was built last."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from dextera_build.cli.main import main
from tests.e2e.conftest import NODES
from tests.e2e.space import Space

ROUNDS = int(os.environ.get("ROUNDS", "25"))


def settings(kind: int) -> list[str]:
    """Flags that add another number to every node; none for the recipe's own."""
    return [word for number in range(NODES if kind else 0) for word in ("--set", f"a{number}.add={kind}{number + 10}")]


def expected(kind: int) -> list[int]:
    return [3 + (int(f"{kind}{number + 10}") if kind else 0) for number in range(NODES)]


def placed(space: Space, out: str) -> list[int]:
    return [int((space.root / line.partition("\t")[2]).read_bytes()) for line in out.splitlines()]


@pytest.mark.slow
def test_builds_at_once_with_other_settings_never_mix_files(counts: Space) -> None:
    for kind in range(4):
        assert counts.dxb("build", "g", *settings(kind)).code == 0
    for turn in range(ROUNDS):
        twice = turn % 4
        running = [counts.start("build", "g", "--console", "none", *settings(kind)) for kind in (0, 1, 2, twice)]
        for process in running:
            _, said = process.communicate(timeout=300)
            assert process.returncode == 0, said
            assert "were changed" not in said
        last = counts.dxb("build", "g", "--console", "none", *settings(twice))
        assert last.code == 0, last.err
        assert placed(counts, last.out) == expected(twice)
    assert not list(counts.root.glob("cache/out/**/*~*"))


@pytest.mark.slow
def test_equal_builds_at_once_after_an_edit_succeed(counts: Space) -> None:
    for turn in range(2, 2 + max(3, ROUNDS // 8)):
        counts.write("data", str(turn))
        running = [counts.start("build", "g", "--console", "none") for _ in range(4)]
        for process in running:
            out, said = process.communicate(timeout=300)
            assert process.returncode == 0, said
            assert said == ""
            assert placed(counts, out) == [3 * turn] * NODES
    assert not list(counts.root.glob("cache/out/**/*~*"))


@pytest.mark.slow
def test_builds_at_once_of_other_targets_both_stay_in_the_history(counts: Space) -> None:
    running = [counts.start("build", f"g:a{number}", "--console", "none") for number in range(4)]
    for process in running:
        assert process.wait(timeout=300) == 0
        process.communicate()
    for number in range(4):
        assert counts.dxb("get", f"g:a{number}", "-o", "got").code == 0


@pytest.mark.slow
def test_another_request_lies_beside_the_recipes_own(counts: Space) -> None:
    own = counts.dxb("build", "g:a0")
    other = counts.dxb("build", "g:a0", "--set", "a0.add=5")
    assert own.out == "a0\tcache/out/g/a0/a0\n"
    path = other.out.strip().partition("\t")[2]
    assert path.startswith("cache/out/g@a0.add=5-")
    assert (counts.root / path).read_bytes() == b"8"
    assert (counts.root / "cache/out/g/a0/a0").read_bytes() == b"3"
    again = counts.dxb("build", "g:a0", "--set", "a0.add=5")
    assert (again.out, "up to date" in again.err) == (other.out, True)
    stub = counts.dxb("build", "g:a0", "--profile", "stub").out
    assert stub.startswith("a0\tcache/out/g@stub-")
    counts.write("more", "2")
    bound = counts.dxb("build", "g:a0", "--input", "l=more").out
    assert bound.startswith("a0\tcache/out/g@l=more-")
    assert placed(counts, bound) == [6]
    assert counts.dxb("build", "g:a0", "--profile", "cpu").out == own.out


def test_a_profile_of_the_environment_does_not_hide_what_was_built_with_it(counts: Space) -> None:
    env = {"DXB_PROFILE": "stub"}
    assert counts.dxb("build", "g:a0", "--set", "a0.add=5", env=env).code == 0
    there = counts.dxb("get", "g:a0", "-o", "got", "--json", env=env)
    assert there.code == 0, there.err
    assert counts.dxb("get", "g:a0", "-o", "got", env={"DXB_PROFILE": "gpu"}).code == 2


@pytest.mark.medium
@pytest.mark.parametrize("name", ["a0", "more/x"])
def test_a_change_that_keeps_size_and_time_is_seen(counts: Space, name: str) -> None:
    counts.write("rules/toy/tree.py", TREE.lstrip())
    counts.edit("recipes/g.yaml", "a0: {rule: toy.mul", "a0: {rule: toy.tree" if "/" in name else "a0: {rule: toy.mul")
    out = counts.dxb("build", "g:a0").out
    path = counts.root / "cache/out/g/a0" / name
    before, state = path.read_bytes(), path.stat()
    path.write_bytes(b"z" * len(before))
    os.utime(path, ns=(state.st_atime_ns, state.st_mtime_ns))
    again = counts.dxb("build", "g:a0")
    assert again.out == out
    assert path.read_bytes() == before
    assert "the edited ones are kept in cache/out/g/a0~" in again.err
    assert (counts.root / "cache/out/g/a0~" / name).read_bytes() == b"z" * len(before)


TREE = '''
"""toy.tree: a folder."""
from dextera_build.artifacts.base import File, Folder
from dextera_build.rule import Context, rule

@rule(version=1)
def tree(ctx: Context, text: File) -> Folder:
    """Two files."""
    return Folder(files={"top": text.data, "more/x": b"below", ".digest": b"mine"})
'''


def test_a_folder_is_placed_as_it_is(counts: Space) -> None:
    counts.write("rules/toy/tree.py", TREE.lstrip())
    counts.edit("recipes/g.yaml", "a0: {rule: toy.mul", "a0: {rule: toy.tree")
    assert counts.dxb("build", "g:a0").code == 0
    folder = counts.root / "cache/out/g/a0"
    assert sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()) == [
        ".digest",
        "more/x",
        "top",
    ]
    assert (folder / ".digest").read_bytes() == b"mine"


@pytest.mark.medium
def test_copies_of_an_earlier_capture_do_not_stay(space: Space) -> None:
    assert space.dxb("build", "say/words:word.loud").code == 0
    out = space.root / "cache/out/say/words"
    assert sorted(os.listdir(out)) == [".placed", "word.one.loud", "word.two.loud"]
    space.edit("recipes/say/words.yaml", "text: one two", "text: one four")
    answer = space.dxb("build", "say/words:word.loud")
    assert sorted(os.listdir(out)) == [".placed", "word.four.loud", "word.one.loud"]
    assert "out of date and removed from out/: word[two].loud" in answer.err
    # `all` is asked for; what lies of `word.loud` is current or goes.
    space.edit("recipes/say/words.yaml", "text: one four", "text: one five")
    assert space.dxb("build", "say/words").code == 0
    assert sorted(os.listdir(out)) == [".placed", "all", "word.one.loud"]
    # Somebody's own work is never removed.
    (out / "word.one.loud" / "notes").write_text("mine")
    space.edit("recipes/say/words.yaml", "text: one five", "text: six")
    answer = space.dxb("build", "say/words")
    assert sorted(os.listdir(out)) == [".placed", "all", "word.one.loud~"]
    assert "word.one.loud~" in answer.err


@pytest.mark.medium
def test_python_places_like_the_command_line(counts: Space) -> None:
    program = (
        "from dextera_build import Project\n"
        "project = Project.find()\n"
        "print(project.build('g', 'a0', settings={'a0.add': 5}).paths['a0'])\n"
        "project.build('g', 'a0')\n"
        "assert project.get('g:a0').data == b'3'\n"
        "assert project.get('g:a0', settings={'a0.add': 5}).data == b'8'\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=counts.root, env=counts.environment(), capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert Path(done.stdout.strip()).read_bytes() == b"8"
    same = counts.dxb("build", "g:a0", "--set", "a0.add=5")
    assert (counts.root / same.out.strip().partition("\t")[2]).samefile(done.stdout.strip())
    assert "up to date" in same.err


def test_a_recipe_beside_a_node_of_its_name_has_files_of_its_own(counts: Space) -> None:
    nested = counts.root / "recipes/g/a0.yaml"
    nested.parent.mkdir()
    nested.write_text("inputs: {l: data}\nnodes:\n  a0: {rule: toy.mul, text: $l, add: 10}\ntargets: {default: [a0]}\n")
    for _ in range(2):
        for recipe, value in (("g/a0", 13), ("g:a0", 3)):
            assert placed(counts, counts.dxb("build", recipe).out) == [value]
    printed = [counts.dxb("build", recipe).out for recipe in ("g:a0", "g/a0")]
    assert [value for out in printed for value in placed(counts, out)] == [3, 13]
    assert not list(counts.root.glob("cache/out/**/*~*"))


def test_files_of_a_recipe_in_the_way_of_a_new_one_are_kept(counts: Space) -> None:
    counts.write("recipes/h/a0.yaml", (counts.root / "recipes/g.yaml").read_text())
    assert counts.dxb("build", "h/a0:a1").out == "a1\tcache/out/h/a0/a1/a1\n"
    counts.write("recipes/h.yaml", (counts.root / "recipes/g.yaml").read_text())
    answer = counts.dxb("build", "h:a0")
    assert "kept in cache/out/h/a0~" in answer.err
    assert (counts.root / "cache/out/h/a0~/a1/a1").read_bytes() == b"3"
    assert placed(counts, counts.dxb("build", "h/a0:a1").out) == [3]


GRP = '''
"""toy.grp: labels that file names once did not tell apart."""
from dextera_build.artifacts.base import Collection, File
from dextera_build.rule import Context, rule

@rule(version=1)
def grp(ctx: Context) -> Collection[File]:
    """Two numbers."""
    return Collection[File](items={"a:b": File(data=b"1"), "a.b": File(data=b"2")})
'''


def test_labels_of_one_group_never_share_a_folder(counts: Space) -> None:
    counts.write("rules/toy/grp.py", GRP.lstrip())
    counts.write(
        "recipes/s.yaml",
        "nodes:\n  s: {rule: toy.grp}\n  b:\n    each: $s\n    as: o\n    nodes:\n      c: {rule: toy.mul, text: $o}\n"
        "targets: {default: [b.c]}\n",
    )
    assert sorted(placed(counts, counts.dxb("build", "s").out)) == [3, 6]


def test_a_misspelt_label_of_an_override_is_told(counts: Space) -> None:
    counts.write("rules/toy/grp.py", GRP.lstrip())
    counts.write(
        "recipes/s.yaml",
        "nodes:\n  s: {rule: toy.grp}\n  b:\n    each: $s\n    as: o\n    nodes:\n      c: {rule: toy.mul, text: $o}\n"
        "    overrides: {ab: {c: {add: 1}}}\ntargets: {default: [b.c]}\n",
    )
    said = counts.dxb("build", "s")
    assert said.code == 0
    place = "recipes/s.yaml:3:3"
    assert f"warning: {place}: `overrides.ab` changes nothing: `b` has no `ab`; did you mean `a" in said.err


def test_a_folder_in_the_place_of_the_table_goes(counts: Space) -> None:
    assert counts.dxb("build", "g:a0").code == 0
    table = counts.root / "cache/out/g/.placed"
    table.unlink()
    (table / "inside").mkdir(parents=True)
    counts.write("data", "2")
    again = counts.dxb("build", "g:a0")
    assert (again.code, placed(counts, again.out)) == (0, [6]), again.err
    assert table.is_file()


@pytest.mark.medium
@pytest.mark.parametrize("copied", [True, False])
def test_a_cached_build_accepts_equal_files_that_it_may_not_write(
    counts: Space, copied: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert counts.dxb("build", "g:a0").code == 0
    file = counts.root / "cache/out/g/a0/a0"
    if copied:
        content = file.read_bytes()
        file.unlink()
        file.write_bytes(content)
    os.utime(file, (1, 1))
    monkeypatch.chdir(counts.root)
    monkeypatch.setattr(os, "access", lambda path, mode: not mode & os.W_OK)  # root may write anything
    assert main(["build", "g:a0", "--console", "none"]) == 0
    assert capsys.readouterr().out == "a0\tcache/out/g/a0/a0\n"
    assert file.stat().st_mtime == 1
    file.write_bytes(b"4")
    assert main(["build", "g:a0", "--console", "none"]) == 0  # in truth it may be written
    assert file.read_bytes() == b"3"
