"""Clocks that are wrong, jump, or differ from those that stamp files: no edit is missed, and nothing runs twice."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from dextera_build.engine.run import build
from dextera_build.gc.choose import Limits
from dextera_build.gc.collect import collect
from dextera_build.store.store import Store
from tests.chaos.children import dxb
from tests.chaos.clocks import clock
from tests.chaos.scenarios import PLAIN, exported, project
from tests.engine.tiny import Record, call, graph, inline, leaf, out

YEAR = 365 * 86400


@pytest.mark.slow
@pytest.mark.parametrize("stamp_s", [1.0, -10 * YEAR, 10 * YEAR], ids=["1970", "long ago", "years from now"])
def test_an_edit_is_seen_whatever_time_its_file_has(stamp_s: float, tmp_path: Path) -> None:
    """Promise: a file of equal size and equal time, wrong as it may be, is read again when it was written again."""
    space = project(tmp_path / "project")
    stamp = stamp_s if stamp_s == 1.0 else time.time() + stamp_s
    for text in ("one two", "six ten"):
        path = space.write("note.txt", text)
        os.utime(path, (stamp, stamp))
        time.sleep(0.05)
        for _ in range(2):
            assert dxb(space.root, *PLAIN).code == 0
        assert exported(space)["say/all/all"] == " ".join(f"{word}!" for word in text.upper().split()).encode()


OFFSETS = [0.0, YEAR, -YEAR, 86400.0, -3601.0, 0.0]


def test_builds_whose_clock_jumps_find_what_they_made(tmp_path: Path) -> None:
    """Promise: a clock that jumps by hours or years between builds makes nothing stale and hides no edit."""
    photo, root = tmp_path / "photo", tmp_path / "store"
    plan = graph(call("a", "blob", x=leaf(photo)), call("b", "blob", x=out("a")))
    made: dict[str, str | None] = {}
    for number, offset_s in enumerate(OFFSETS):
        text = f"pixels {number % 2}"
        photo.write_text(text)
        time.sleep(0.02)
        for again in range(2):
            record = Record()
            with clock(offset_s):
                result = build(plan, [("b",)], store=Store(root), executor=inline(), listen=record)
            assert result.ok
            assert bool(record.with_status("ran")) == (text not in made and not again)
            assert made.setdefault(text, result.nodes["b"].output) == result.nodes["b"].output
    assert len(set(made.values())) == 2


@pytest.mark.parametrize("offset_s", [YEAR, -YEAR])
def test_a_collection_by_a_wrong_clock_takes_nothing_of_a_running_build(offset_s: float, tmp_path: Path) -> None:
    """Promise: ages are told by the clock that stamps the files, so a wrong one of this machine costs no result."""
    store = Store(tmp_path / "store")
    plan = graph(call("a", "blob"), call("b", "blob", a=out("a")))
    with store.running.announced():
        result = build(plan, [("b",)], store=store, executor=inline(), listen=Record())
        with clock(offset_s):
            collect(store, dict, Limits(size=0), dry=False)
        assert all(store.actions.get(node.key or "") for node in result.nodes.values())
