"""Files that somebody planted, swapped or altered: entries under other keys, files in `out/`, byte code, local rows.

A build gives what plain Python gives, and then everything is up to date.
"""

from __future__ import annotations

import os
import random
import shutil
import sqlite3
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.oracle.plain import build, expected, placed
from tests.oracle.projects import RandomProject, poison

RIGHT: dict[tuple[tuple[str, str], ...], dict[str, str]] = {}
"""The files of a project -> what its nodes return; all attacks on a project of one seed begin with the same states."""
SETTINGS = 'cache = "cache"\n[remotes]\nshare = {address = "share", mode = "rw"}\n'


class Planted:
    """A project that was built in a few states.

    Args:
        seed: Of the project, and of what is done to it.
        folder: Where it lies.
    """

    def __init__(self, seed: int, folder: Path) -> None:
        self.chance = random.Random(seed)
        self.folder = folder
        self.project = RandomProject(seed, folder / "project")
        self.root = self.project.root
        self.project.put("dxb.toml", SETTINGS)
        self.states: list[dict[str, str]] = []
        for _ in range(2):
            self.build_and_edit()

    def build_and_edit(self) -> None:
        """Go on to another state."""
        placed(self.project, build(self.project))
        self.states.append(self.project.files())
        self.project.edit()

    def entries(self) -> None:
        """Results under keys of other nodes, here or in a remote."""
        place = self.chance.choice(("cache", "share"))
        found = sorted((self.root / place / "ac").glob("??/*"))
        for one in self.chance.sample(found, self.chance.randint(1, len(found))):
            swap(one, self.chance.choice(found), both=self.chance.random() < 0.5)
        self.forget(place)

    def blobs(self) -> None:
        """Blobs under other digests, here or in a remote."""
        place = self.chance.choice(("cache", "share"))
        found = sorted((self.root / place / "cas").glob("??/*"))
        for one in self.chance.sample(found, self.chance.randint(1, len(found))):
            swap(one, self.chance.choice(found), both=True)
        self.forget(place)

    def forget(self, place: str) -> None:
        """Let the next build look at what was planted: in a remote, or behind `out/` and the local state."""
        gone = ["cache"] if place == "share" else self.chance.choice((["cache/out"], ["cache/out", "cache/local"]))
        for each in gone:
            shutil.rmtree(self.root / each)

    def outputs(self) -> None:
        """Files in `out/` with as many bytes as before, and the time that they had."""
        placed(self.project, build(self.project))
        found = [path for path in (self.root / "cache/out").rglob("n*") if path.is_file()]
        for path in self.chance.sample(found, self.chance.randint(1, len(found))):
            alter(path, path.read_bytes().translate(bytes.maketrans(b"0123456789", b"1234567890")))

    def outputs_swapped(self) -> None:
        """Files in `out/` that lie in the places of others."""
        placed(self.project, build(self.project))
        one, other = self.chance.sample(sorted((self.root / "cache/out").rglob("n*/n*")), 2)
        swap(one, other, both=True)

    def byte_code(self) -> None:
        """Byte code of other numbers beside every source, which Python would run."""
        for path in self.project.sources():
            poison(self.root / path, None if self.chance.random() < 0.8 else b"no byte code")
        if self.chance.random() < 0.5:
            shutil.rmtree(self.root / "cache")

    def rows(self) -> None:
        """Rows of the local state under names of other rows."""
        with sqlite3.connect(self.root / "cache/local/state.db") as base:
            rows = base.execute("SELECT kind, name, value, sum FROM rows").fetchall()
            others = self.chance.sample(rows, len(rows))
            moved = [(row[2], row[3], *other[:2]) for row, other in zip(rows, others, strict=True)]
            base.executemany("UPDATE rows SET value=?, sum=? WHERE kind=? AND name=?", moved)
        base.close()

    def check(self) -> None:
        """The present state and all earlier ones build as plain Python builds them."""
        for number, files in enumerate([self.project.files(), *self.states]):
            self.project.restore(files)
            state = tuple(sorted(files.items()))
            if state not in RIGHT:
                RIGHT[state] = expected(files, self.folder / f"clean{number}")
            right = RIGHT[state]
            assert placed(self.project, build(self.project)) == right, self.project.edits
            again = build(self.project, "--console", "plain")
            assert placed(self.project, again) == right
            assert "up to date" in again.text


def swap(one: Path, other: Path, *, both: bool) -> None:
    """Let a file hold what another one holds, and the other way round."""
    first, second = one.read_bytes(), other.read_bytes()
    alter(one, second)
    if both:
        alter(other, first)


def alter(path: Path, data: bytes) -> None:
    """Write into a file in place; it keeps its time."""
    state = path.stat()
    path.chmod(0o644)
    path.write_bytes(data)
    os.utime(path, ns=(state.st_atime_ns, state.st_mtime_ns))


ATTACKS: dict[str, Callable[[Planted], None]] = {
    "entries under other keys": Planted.entries,
    "blobs under other digests": Planted.blobs,
    "altered outputs": Planted.outputs,
    "swapped outputs": Planted.outputs_swapped,
    "byte code": Planted.byte_code,
    "swapped rows": Planted.rows,
}


IN_CI = ("entries under other keys", "altered outputs", "byte code")
"""One attack on the store, one on files beside it, one on code; the slow tests draw from all."""


@pytest.mark.medium
@pytest.mark.parametrize(
    "attack", [pytest.param(each, marks=[] if each in IN_CI else pytest.mark.slow) for each in ATTACKS]
)
@pytest.mark.parametrize("seed", range(1))
def test_what_was_planted_is_in_no_result(attack: str, seed: int, tmp_path: Path) -> None:
    planted = Planted(seed, tmp_path)
    ATTACKS[attack](planted)
    planted.check()


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(100, 130))
def test_many_plants_at_once_are_in_no_result(seed: int, tmp_path: Path) -> None:
    planted = Planted(seed, tmp_path)
    for _ in range(4):
        planted.build_and_edit()
        ATTACKS[planted.chance.choice(list(ATTACKS))](planted)
        right = expected(planted.project.files(), tmp_path / f"now{len(planted.states)}")
        assert placed(planted.project, build(planted.project)) == right, planted.project.edits
    planted.check()
