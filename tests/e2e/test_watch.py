"""`dxb watch` as a process: what wakes it, what does not, and how it ends."""

from __future__ import annotations

import os
import queue
import signal
import threading
import time

import pytest

from tests.e2e.space import Space

NOTES = """inputs: {notes: notes}
nodes:
  text: {rule: toy.read, notes: $notes}
  slow: {rule: toy.slow, text: $text, seconds: 0.0}
targets: {default: [slow]}
"""
READ = '''
"""toy.read: a folder as one file."""
from dextera_build.artifacts.base import File, Folder
from dextera_build.rule import Context, rule

@rule(version=1)
def read(ctx: Context, notes: Folder) -> File:
    """Return all files, one after another."""
    return File(data=b" ".join(data for _, data in sorted(notes.files.items())))
'''
FOUND = '''
"""toy.found: the parts that there are, and whether the last one came."""
from dextera_build.artifacts.base import File
from dextera_build.rule import Context, rule

@rule(version=1, discovers=True)
def found(ctx: Context) -> File:
    """Return them."""
    parts = [ctx.read(name) for name in ctx.glob("parts/*.txt")]
    return File(data=b" ".join([*parts, b"complete" if ctx.exists("parts/end") else b"open"]))
'''


class Watching:
    """A `dxb watch` whose lines are read as they come."""

    def __init__(self, space, *words):
        self.process = space.start("watch", *words)
        self._lines = queue.Queue()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self):
        for line in self.process.stderr:
            self._lines.put(line.rstrip("\n"))

    def until(self, text, seconds=150.0):
        """All lines up to the first that has `text`."""
        lines, deadline = [], time.monotonic() + seconds
        while True:
            try:
                lines.append(self._lines.get(timeout=max(0.01, deadline - time.monotonic())))
            except queue.Empty:
                raise AssertionError(f"no line with {text!r} in {lines}") from None
            if text in lines[-1]:
                return lines

    def round(self):
        """The line of the next round."""
        return self.until(")")[-1]

    def is_silent(self, seconds):
        time.sleep(seconds)
        return self._lines.empty()

    def interrupt(self):
        self.process.send_signal(signal.SIGINT)
        return self.process.wait(60)


class Notes(Space):
    """A project whose files change in one step: a watch may look between any two steps of a test."""

    def write(self, name, text):
        path = self.root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        os.replace(super().write("aside", text), path)
        return path


@pytest.fixture
def notes(space):
    space = Notes(space.root)
    space.write("rules/toy/read.py", READ.lstrip())
    space.write("recipes/say/notes.yaml", NOTES)
    space.write("notes/a.txt", "one")
    space.write("notes/b.txt", "two")
    return space


@pytest.fixture
def watch(notes):
    started = []

    def start(*words):
        started.append(Watching(notes, *words))
        return started[-1]

    yield start
    for watching in started:
        watching.process.kill()
        watching.process.wait()


def output(space):
    return (space.root / "cache/out/say/notes/slow/slow").read_bytes()


@pytest.mark.slow
def test_it_builds_again_for_what_was_read_and_for_nothing_else(notes, watch):
    watching = watch("say/notes")
    assert watching.round().endswith("(first build)")
    assert output(notes) == b"one two"

    notes.write("notes/b.txt", "three")  # a file
    line = watching.round()
    assert "say/notes  2 ran" in line
    assert line.endswith("(notes/b.txt changed)")
    assert output(notes) == b"one three"

    notes.write("notes/c.txt", "four")  # a name in a folder
    assert watching.round().endswith("(notes changed)")
    assert output(notes) == b"one three four"

    notes.edit("rules/toy/slow.py", "return text", "return File(data=text.data.upper())")  # code
    assert watching.round().endswith("(rules/toy/slow.py changed)")
    assert output(notes) == b"ONE THREE FOUR"

    notes.edit("rules/toy/read.py", 'b" ".join', 'b"-".join')
    assert "2 ran" in watching.round()
    assert output(notes) == b"ONE-THREE-FOUR"

    notes.write("other.txt", "x")
    notes.write("recipes/say/unrelated.yaml", "nodes: {a: {rule: toy.start}}\n")
    assert watching.is_silent(1.5)
    assert watching.interrupt() == 0


@pytest.mark.slow
def test_an_error_is_shown_and_its_mend_awaited(notes, watch):
    watching = watch("say/notes")
    watching.round()
    notes.edit("recipes/say/notes.yaml", "rule: toy.slow", "rule: toy.slwo")
    lines = watching.until("error DXB-R201")
    assert any("no rule is called `toy.slwo`" in line for line in lines)
    notes.write("rules/toy/slwo.py", (notes.root / "rules/toy/slow.py").read_text().replace("def slow", "def slwo"))
    assert "ran" in watching.round()
    notes.edit("rules/toy/slwo.py", "return text", "return (")
    watching.until("error DXB-R206")
    notes.edit("rules/toy/slwo.py", "return (", 'return File(data=b"mended")')
    assert "ran" in watching.round()
    assert output(notes) == b"mended"


@pytest.mark.medium
def test_a_failed_node_is_shown_and_its_mend_awaited(notes, watch):
    notes.edit("recipes/say/notes.yaml", "seconds: 0.0", "do: fail")
    watching = watch("say/notes")
    lines = watching.until("1 failed")
    assert any("slow failed its check: the text is wrong" in line for line in lines)
    notes.edit("recipes/say/notes.yaml", "do: fail", "do: work")
    assert "1 ran" in watching.round()


@pytest.mark.slow
def test_pins_are_kept_up_to_date(notes, watch):
    assert notes.dxb("build", "--lock", "say/notes").code == 0
    before = (notes.root / "dxb.lock").read_text()
    watching = watch("say/notes")
    watching.round()
    notes.write("notes/b.txt", "three")
    assert watching.round().endswith("(notes/b.txt changed)")
    assert (notes.root / "dxb.lock").read_text() != before
    assert watching.is_silent(1.0)
    assert notes.dxb("build", "--locked", "say/notes").code == 0


@pytest.mark.medium
def test_a_missing_file_is_awaited(notes, watch):
    (notes.root / "notes").rename(notes.root / "away")
    watching = watch("say/notes")
    watching.until("error DXB-R301")
    (notes.root / "away").rename(notes.root / "notes")
    assert "2 ran" in watching.round()


@pytest.mark.slow
def test_a_change_during_a_build_is_not_missed(notes, watch):
    notes.edit("recipes/say/notes.yaml", "seconds: 0.0", "seconds: 1.5")
    watching = watch("say/notes")
    # `text` has read the notes when the second node runs; nothing watches yet.
    deadline = time.monotonic() + 120
    while not list((notes.root / "cache/ac").rglob("??????*")) and time.monotonic() < deadline:
        time.sleep(0.02)
    notes.write("notes/b.txt", "late")
    assert watching.round().endswith("(first build)")
    assert watching.round().endswith("(notes/b.txt changed)")
    assert output(notes) == b"one late"
    assert watching.is_silent(1.0)


@pytest.mark.slow
def test_changes_in_quick_order_are_taken_together(notes, watch):
    watching = watch("say/notes")
    watching.round()
    path, pauses, before = notes.root / "notes/b.txt", 0, time.monotonic()
    for number in range(20):
        path.write_text(f"{number}")
        time.sleep(0.01)
        pauses += time.monotonic() - before > 0.08  # this test was kept waiting: the order was not that quick
        before = time.monotonic()
    rounds = [watching.round()]
    while output(notes) != b"one 19" or not watching.is_silent(1.5):
        rounds.append(watching.round())
    assert len(rounds) <= 2 + pauses
    assert output(notes) == b"one 19"


@pytest.mark.medium
def test_an_interrupt_during_a_build_ends_with_130(notes, watch):
    notes.edit("recipes/say/notes.yaml", "seconds: 0.0", "seconds: 60.0")
    watching = watch("say/notes")
    deadline = time.monotonic() + 120
    while not list((notes.root / "cache/ac").rglob("??????*")) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert watching.interrupt() == 130
    watching.until("interrupted; finished results are kept")


def test_a_name_that_does_not_exist_ends_it(notes, watch):
    watching = watch("say/nots")
    assert watching.process.wait(150) == 2
    watching.until("no recipe is called `say/nots`")


@pytest.mark.slow
def test_it_builds_again_for_what_a_node_found_by_itself(notes, watch):
    notes.write("rules/toy/found.py", FOUND.lstrip())
    notes.write("recipes/say/found.yaml", "nodes: {all: {rule: toy.found}}\n")
    notes.write("parts/a.txt", "one")
    time.sleep(0.1)  # stamps of files that were written before lie in the past

    def made():
        return (notes.root / "cache/out/say/found/all/all").read_bytes()

    watching = watch("say/found")
    assert watching.round().endswith("(first build)")
    assert made() == b"one open"
    for name, text, line in (
        ("parts/a.txt", "two", b"two open"),  # read
        ("parts/b.txt", "three", b"two three open"),  # a name that the pattern finds
        ("parts/end", "", b"two three complete"),  # a file that was asked for and was not there
    ):
        notes.write(name, text)
        assert "1 ran" in watching.round(), name
        assert made() == line
    notes.write("parts/c.md", "nobody asks for this")
    assert watching.is_silent(1.5) or "ran" not in watching.round()
    (notes.root / "parts/b.txt").unlink()
    watching.until("1 ran")
    assert made() == b"two complete"
