"""Code, recipes and inputs that are edited at random moments of a build, which may be killed, too.

No result is published under a key whose code or inputs were not those that ran: every state that the project ever had
builds as plain Python builds it, from the store that the disturbed builds left.
"""

from __future__ import annotations

import random
import time
from functools import partial
from pathlib import Path

import pytest

from tests.chaos.children import Said
from tests.chaos.moments import Past, any_moment, at_moments, die
from tests.oracle.plain import build, expected, placed, started
from tests.oracle.projects import RandomProject

_ROUNDS = 3
_AT_ONCE = 4


class Disturbed:
    """A project that is edited while it is built.

    Args:
        seed: Seed of the project, its edits and the kills.
        folder: Where it lies.
    """

    def __init__(self, seed: int, folder: Path) -> None:
        self.chance = random.Random(seed)
        self.folder = folder
        self.project = RandomProject(seed, folder / "project")
        self.past = Past(self.project, folder / "notes")
        self._count = 0

    def clean(self, files: dict[str, str], added: int = 0) -> dict[str, str]:
        """What a clean build returns."""
        self._count += 1
        return expected(files, self.folder / f"clean{self._count}", {"n0": added} if added else {})

    def round(self, *, workers: bool) -> None:
        """One build with an edit or two, or a kill; it ends as one of the states says, or with a clear error."""
        wishes = {any_moment(self.chance): self.past.edit for _ in range(self.chance.randint(1, 2))}
        if self.chance.random() < 0.3:
            wishes[any_moment(self.chance)] = die
        self.project.random.seed(self.chance.random())
        said = build(self.project, begin=partial(at_moments, wishes), workers=workers)
        states = self.past.learn()
        assert is_clear(said), (self.project.edits, said.text)
        if said.code == 0 and len(states) == 2:
            assert placed(self.project, said) in [self.clean(files) for files in states], self.project.edits

    def at_once(self) -> None:
        """Four builds with other settings, while the project is edited."""
        running = [started(self.project, *_settings(number)) for number in range(_AT_ONCE)]
        for _ in range(self.chance.randint(0, 3)):
            time.sleep(self.chance.uniform(0, 0.15))
            self.past.edit()
        for wait in running:
            assert is_clear(said := wait()), (self.project.edits, said.text)
        self.past.learn()
        for number in range(_AT_ONCE):
            said = build(self.project, *_settings(number))
            assert placed(self.project, said) == self.clean(self.past.states[-1], number), self.project.edits

    def check(self) -> None:
        """Every state builds as it should, the present one first."""
        for files in self.past.states[::-1]:
            self.project.restore(files)
            assert placed(self.project, build(self.project)) == self.clean(files), self.project.edits


def is_clear(said: Said) -> bool:
    """Whether a disturbed build ended well, or with errors that say what was edited, or was killed."""
    return said.code in (0, -9) or (
        "Traceback" not in said.text and "error[DXB-" in said.text and "X001" not in said.text
    )


def _settings(number: int) -> list[str]:
    return ["--set", f"n0.add={number}"] if number else []


def play(seed: int, folder: Path, *, workers: bool = False) -> None:
    """Disturb a few builds, one after the other."""
    disturbed = Disturbed(seed, folder)
    for _ in range(_ROUNDS):
        disturbed.round(workers=workers)
    disturbed.check()


def play_at_once(seed: int, folder: Path) -> None:
    """Disturb builds that run at once."""
    disturbed = Disturbed(seed, folder)
    for _ in range(2):
        disturbed.at_once()
    disturbed.check()


@pytest.mark.medium
@pytest.mark.parametrize("seed", range(1))
def test_no_edit_during_a_build_is_published_under_another_key(seed: int, tmp_path: Path) -> None:
    """Promise: whatever is edited at any moment, a result is that of the code and the inputs in its key."""
    play(seed, tmp_path)


@pytest.mark.parametrize("seed", range(100, 101))
@pytest.mark.medium
def test_no_edit_during_a_build_by_workers_is_published_under_another_key(seed: int, tmp_path: Path) -> None:
    """Promise: the same where workers run nodes."""
    play(seed, tmp_path, workers=True)


@pytest.mark.parametrize("seed", range(200, 201))
@pytest.mark.medium
def test_builds_at_once_agree_with_clean_ones_whatever_is_edited(seed: int, tmp_path: Path) -> None:
    """Promise: builds at once with other settings end as clean ones do, though files are edited meanwhile."""
    play_at_once(seed, tmp_path)


@pytest.mark.slow
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("part", range(4))
def test_no_edit_during_more_builds_is_published_under_another_key(part: int, tmp_path: Path) -> None:
    """Promise: the same, 30 projects in each of four parts."""
    for seed in range(1000 + part, 1120, 4):
        play(seed, tmp_path / str(seed), workers=seed % 6 == 0)
        if seed % 5 == 0:
            play_at_once(seed, tmp_path / f"{seed} at once")
