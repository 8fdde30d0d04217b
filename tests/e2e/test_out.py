"""What lies in `out/`: one folder per request, whole, and what was built last."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.e2e.space import Space

MUL = '''
"""toy.mul: counts."""
from dextera_build.artifacts.base import File
from dextera_build.rule import Context, Options, rule

class MulOptions(Options):
    """Options."""
    add: int = 0
    """What to add."""

@rule(version=1)
def mul(ctx: Context, text: File, *, options: MulOptions) -> File:
    """Multiply by three."""
    return File(data=b"%d" % (int(text.data) * 3 + options.add))
'''
NODES = 12
RECIPE = """
inputs: {l: data}
nodes:
"""
ROUNDS = int(os.environ.get("ROUNDS", "25"))


@pytest.fixture
def counts(space: Space) -> Space:
    space.write("rules/toy/mul.py", MUL.lstrip())
    space.write("data", "1")
    nodes = "".join(f"  a{number}: {{rule: toy.mul, text: $l}}\n" for number in range(NODES))
    names = ", ".join(f"a{number}" for number in range(NODES))
    space.write("recipes/g.yaml", f"inputs: {{l: data}}\nnodes:\n{nodes}targets: {{default: [{names}]}}\n")
    return space


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


def test_builds_at_once_of_other_targets_both_stay_in_the_history(counts: Space) -> None:
    running = [counts.start("build", f"g:a{number}", "--console", "none") for number in range(4)]
    for process in running:
        assert process.wait(timeout=300) == 0
        process.communicate()
    for number in range(4):
        assert counts.dxb("get", f"g:a{number}", "-o", "got").code == 0


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


@pytest.mark.slow
def test_get_show_and_report_answer_for_the_request_that_was_built_last(counts: Space) -> None:
    def got(*words: str) -> bytes:
        answer = counts.dxb("get", "g:a0", "-o", "got", *words)
        assert answer.code == 0, answer.err
        return (counts.root / answer.out.strip()).read_bytes()

    def shown(*words: str) -> str:
        return counts.dxb("show", "g:a0", *words).out

    def reported(*words: str) -> str:
        answer = counts.dxb("report", "g", *words)
        assert answer.code == 0, answer.err
        return (counts.root / answer.out.strip()).read_text()

    five = ("--set", "a0.add=5")
    assert counts.dxb("build", "g:a0").code == 0
    assert got() == b"3"
    assert counts.dxb("build", "g:a0", *five).code == 0
    assert (got(), got(*five), got("--profile", "cpu")) == (b"8", b"8", b"3")
    assert "option add\t5" in shown()
    assert "add=5" in reported()
    for _ in range(2):  # by the snapshot
        again = counts.dxb("build", "g:a0")
        assert "up to date" in again.err
        assert (got(), got(*five)) == (b"3", b"8")
        assert "option add\t0" in shown()
        assert "option add\t5" in shown(*five)
        assert "add=5" not in reported()
        assert "add=5" in reported(*five)
        assert "up to date" in counts.dxb("build", "g:a0", *five).err
        assert got() == b"8"
    counts.write("data", "2")
    assert counts.dxb("build", "g:a0").code == 0
    assert got() == b"6"
    counts.write("data", "1")
    assert counts.build("g:a0").nodes("cached") == {"a0"}
    assert got() == b"3"
    never = counts.dxb("get", "g:a0", "--set", "a0.add=7")
    assert never.code == 2
    assert "was never built" in never.err
    assert "request   a0.add=7-" in never.err


def test_a_profile_of_the_environment_does_not_hide_what_was_built_with_it(counts: Space) -> None:
    env = {"DXB_PROFILE": "stub"}
    assert counts.dxb("build", "g:a0", "--set", "a0.add=5", env=env).code == 0
    there = counts.dxb("get", "g:a0", "-o", "got", "--json", env=env)
    assert there.code == 0, there.err
    assert counts.dxb("get", "g:a0", "-o", "got", env={"DXB_PROFILE": "gpu"}).code == 2


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


def test_copies_of_an_earlier_capture_do_not_stay(space: Space) -> None:
    assert space.dxb("build", "say/words:word.loud").code == 0
    out = space.root / "cache/out/say/words"
    assert sorted(os.listdir(out)) == [".placed", "word[one].loud", "word[two].loud"]
    space.edit("recipes/say/words.yaml", "text: one two", "text: one four")
    answer = space.dxb("build", "say/words:word.loud")
    assert sorted(os.listdir(out)) == [".placed", "word[four].loud", "word[one].loud"]
    assert "out of date and removed from out/: word[two].loud" in answer.err
    # `all` is asked for; what lies of `word.loud` is current or goes.
    space.edit("recipes/say/words.yaml", "text: one four", "text: one five")
    assert space.dxb("build", "say/words").code == 0
    assert sorted(os.listdir(out)) == [".placed", "all", "word[one].loud"]
    # Somebody's own work is never removed.
    (out / "word[one].loud" / "notes").write_text("mine")
    space.edit("recipes/say/words.yaml", "text: one five", "text: six")
    answer = space.dxb("build", "say/words")
    assert sorted(os.listdir(out)) == [".placed", "all", "word[one].loud~"]
    assert "word[one].loud~" in answer.err


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
