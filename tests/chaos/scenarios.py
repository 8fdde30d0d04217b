"""Small projects, each with the command in which some failpoints are reached."""

from __future__ import annotations

import json
import os
import re
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from dextera_build.gc import inventory
from dextera_build.store.store import Store
from tests.chaos.children import dxb
from tests.e2e.space import Space
from tests.recipe.conftest import RULES

KEEP = '''
"""toy.careful: saves its progress."""
from dextera_build.artifacts.base import File
from dextera_build.rule import Context, rule

@rule(version=1)
def careful(ctx: Context, text: File) -> File:
    """Return the text."""
    (ctx.keep / "saved").write_bytes(text.data)
    print("saved")
    return text
'''
LARGE = '''
"""toy.large: much of the same."""
from dextera_build.artifacts.base import File
from dextera_build.rule import Context, rule

@rule(version=1)
def large(ctx: Context, text: File) -> File:
    """Return the text many times."""
    return File(data=text.data * 300_000)
'''
DICE = '''
"""toy.dice: what lies in a file that nobody declared."""
from pathlib import Path
from dextera_build.artifacts.base import File
from dextera_build.rule import Context, rule

@rule(version=1)
def dice(ctx: Context) -> File:
    """Return it."""
    return File(data=(Path(__file__).parents[2] / "shake.txt").read_bytes())
'''
RECIPE = """inputs: {note: note.txt, other: other.txt}
nodes:
  words: {rule: toy.split, text: $note}
  word:
    each: $words
    as: word
    nodes:
      loud: {rule: toy.shout, text: $word}
      saved: {rule: toy.careful, text: $loud}
  all: {rule: toy.join, texts: $word.saved}
  large: {rule: toy.large, text: $all}
  aside: {rule: toy.shout, text: $other}
  dice: {rule: toy.dice}
targets: {default: [all, large, aside, dice]}
"""
BUILD = ("build", "say")
PLAIN = (*BUILD, "--cache", "local:rw")


def project(root: Path) -> Space:
    """A project that was not built; its files are at rest."""
    space = Space(root)
    space.write("dxb.toml", 'cache = "cache"\n[remotes]\nshare = {address = "share", mode = "rw"}\n')
    rules = {name: text for name, text in RULES.items() if "spoken" not in name}
    for name, text in {**rules, "toy/careful.py": KEEP, "toy/large.py": LARGE, "toy/dice.py": DICE}.items():
        space.write(f"rules/{name}", text.lstrip())
    space.write("recipes/say.yaml", RECIPE)
    for name, text in {"note.txt": "one two", "other.txt": "other", "shake.txt": "1"}.items():
        space.write(name, text)
    time.sleep(0.05)  # or no snapshot is made
    return space


@dataclass(frozen=True)
class Scenario:
    """What comes before, and the command in which a failpoint is reached."""

    words: tuple[str, ...]
    prepare: Callable[[Space], None]
    again: tuple[str, ...] = ()
    """What a person would say next, if not the same once more."""


def _nothing(space: Space) -> None:
    pass


def _built(space: Space) -> None:
    said = dxb(space.root, *PLAIN)
    assert said.code == 0, said.text


def _built_long_ago(space: Space) -> None:
    _built(space)


def _edited(space: Space) -> None:
    _built(space)
    space.write("other.txt", "another")
    time.sleep(0.05)


def _aged(space: Space) -> None:
    _built(space)
    age(space.root / "cache")
    space.write("note.txt", "one two three")


def age(folder: Path, seconds: float = 7200.0) -> None:
    """Let all files below a folder be older."""
    then = time.time() - seconds
    for path in folder.rglob("*"):
        os.utime(path, (then, then))


def _shared(space: Space) -> None:
    (space.root / "cache").mkdir()
    (space.root / "cache").chmod(0o2775)


def flip(path: Path) -> None:
    """Change one bit."""
    data = path.read_bytes()
    path.chmod(0o644)
    path.write_bytes(bytes([data[0] ^ 1]) + data[1:])


def entries(space: Space) -> Iterator[Path]:
    """Files of the action cache."""
    yield from sorted((space.root / "cache/ac").glob("??/*"))


def blobs(space: Space) -> Iterator[Path]:
    """Files of the blobs."""
    yield from sorted((space.root / "cache/cas").glob("??/*"))


def _damaged_entries(space: Space) -> None:
    _built(space)
    for path in entries(space):
        path.chmod(0o644)
        path.write_bytes(b"\xff" * 9)


def _damaged_blobs(space: Space) -> None:
    _built(space)
    for path in blobs(space):
        flip(path)
    space.write("note.txt", "one two three")


def _two_versions(space: Space) -> None:
    _built(space)
    space.write("note.txt", "four")
    _built(space)
    space.write("note.txt", "one two")
    _leave_an_announcement(space)
    age(space.root / "cache", 30 * 86400.0)


def _leave_an_announcement(space: Space) -> None:
    assert dxb(space.root, *PLAIN, "--force", "aside", failpoint="running.announced").code == -9


def _many_runs(space: Space) -> None:
    for number in range(1, 22):
        space.write(f"cache/runs/{number:04d}/events.jsonl", "")
    _built(space)
    age(space.root / "cache", 30 * 86400.0)


def _shaken(space: Space) -> None:
    _built(space)
    space.write("shake.txt", "2")


def _pushed(space: Space) -> None:
    _built(space)
    assert dxb(space.root, "cache", "push", "say").code == 0
    (space.root / "cache").rename(space.root / "first")


def _bundled(space: Space) -> None:
    _built(space)
    assert dxb(space.root, "bundle", "create", "say", "-o", "bundled.tar").code == 0
    (space.root / "cache").rename(space.root / "first")


def _went_on(space: Space) -> None:
    _edited(space)
    assert dxb(space.root, *PLAIN).code == 0
    space.edit("recipes/say.yaml", "nodes:", "nodes: # more")


SCENARIOS = {
    "first": Scenario((*PLAIN, "--lock"), _nothing),
    "unpinned": Scenario(PLAIN, _nothing),
    "edited": Scenario(PLAIN, _edited),
    "again": Scenario(PLAIN, _built_long_ago),
    "went on": Scenario((*PLAIN, "--force", "aside"), _went_on, PLAIN),
    "aged": Scenario(PLAIN, _aged),
    "shared": Scenario(PLAIN, _shared),
    "damaged blobs": Scenario(PLAIN, _damaged_blobs),
    "damaged entries": Scenario((*PLAIN, "--force", "aside"), _damaged_entries, PLAIN),
    "shaken": Scenario((*PLAIN, "--force", "dice"), _shaken, PLAIN),
    "collection": Scenario(("cache", "gc", "--yes", "--max-size", "1B"), _two_versions),
    "old logs": Scenario(("cache", "gc", "--yes", "--max-age", "1d"), _many_runs),
    "repair": Scenario(("cache", "verify", "--repair"), _damaged_blobs),
    "push": Scenario(("cache", "push", "say"), _built),
    "fetch": Scenario(BUILD, _pushed),
    "import": Scenario(("bundle", "import", "bundled.tar"), _bundled),
}


def results(space: Space) -> dict[str, tuple[str, frozenset[str]]]:
    """Key -> (output, what it refers to) of all results in the store."""
    store = Store(space.root / "cache")
    found = [(key, store.actions.entry(key)) for key in store.actions.keys()]  # noqa: SIM118 - no mapping
    return {key: (entry.result.output, entry.refers) for key, entry in found if entry is not None}


def bare_results(space: Space) -> set[str]:
    """Keys whose results came from elsewhere without the bytes that nobody has to read."""
    actions = Store(space.root / "cache").actions
    entries = {key: actions.entry(key) for key in actions.keys()}  # noqa: SIM118 - no mapping
    return {key for key, entry in entries.items() if entry is not None and entry.is_bare}


def exported(space: Space) -> dict[str, bytes]:
    """What stands where people look for it, and what is noted of it but for signatures."""
    base = space.root / "cache" / "out"
    if (space.root / "cache").is_symlink():  # a store outside the project has a folder for each project
        (base,) = base.iterdir()
    found = {str(path.relative_to(base)): path.read_bytes() for path in sorted(base.rglob("*")) if path.is_file()}
    return {name: _unsigned(data) if name.endswith("/.placed") else data for name, data in found.items()}


def _unsigned(table: bytes) -> bytes:
    nodes = json.loads(table)["nodes"]
    return repr(sorted((node, *copy[:3], sorted(copy[3])) for node, copy in nodes.items())).encode()


def unfinished(space: Space) -> list[str]:
    """What a killed process left anywhere in the project that no later one took away."""
    return [
        str(path.relative_to(space.root))
        for path in space.root.rglob(".tmp?*")
        if path.name.startswith(".tmp-") or path.is_file()
    ] + [path for path, _, _ in inventory.leftovers(Store(space.root / "cache"))]


Clean = Callable[[Space], Space]
"""Gives a build of the same sources in another folder, which nothing disturbed."""


def assert_as_clean(space: Space, right: Space) -> None:
    """Keys, outputs and exported bytes are those of a clean build, and then nothing is left to run."""
    built = dxb(space.root, *PLAIN, "--lock")
    assert built.code == 0, built.text
    known, bare = results(space), bare_results(space)
    for key, (output, below) in results(right).items():
        assert known[key] == (output, known[key][1] if key in bare else below), key
    assert exported(space) == exported(right)
    assert (space.root / "dxb.lock").read_bytes() == (right.root / "dxb.lock").read_bytes()
    idle = dxb(space.root, *PLAIN)
    assert idle.code == 0, idle.text
    assert not re.search(r"\d ran", idle.text), idle.text
