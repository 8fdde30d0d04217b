"""Questions about a project's folder: their answers, their limits, and the watching of changed answers."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from dextera_build.errors import DxbError
from dextera_build.store.questions import Look, Recording
from dextera_build.store.signature import Watch
from dextera_build.store.store import Store


@pytest.fixture
def root(tmp_path: Path) -> Path:
    folder = tmp_path / "project"
    for name in (
        "arm.xml",
        "meshes/a.stl",
        "meshes/b.stl",
        "meshes/old/a.stl",
        "meshes/.hidden.stl",
        "parts/x/y/z.stl",
    ):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(name)
    (folder / "cache" / "cas").mkdir(parents=True)
    (folder / "cache" / "cas" / "a.stl").write_text("not for rules")
    (tmp_path / "secret.stl").write_text("secret")
    return folder


@pytest.fixture
def look(root: Path) -> Look:
    return Look(root, Store(root / "cache").leaves, root / "cache")


@pytest.mark.parametrize(
    ("pattern", "found"),
    [
        ("meshes/*.stl", ["meshes/a.stl", "meshes/b.stl"]),
        ("meshes/[b-z].stl", ["meshes/b.stl"]),
        ("meshes/?.stl", ["meshes/a.stl", "meshes/b.stl"]),
        ("meshes/.*.stl", ["meshes/.hidden.stl"]),
        ("**/*.stl", ["meshes/a.stl", "meshes/b.stl", "meshes/old/a.stl", "parts/x/y/z.stl"]),
        ("meshes/**/a.stl", ["meshes/a.stl", "meshes/old/a.stl"]),
        ("*/*/a.stl", ["meshes/old/a.stl"]),
        ("**", ["arm.xml", "meshes/a.stl", "meshes/b.stl", "meshes/old/a.stl", "parts/x/y/z.stl"]),
        ("arm.xml", ["arm.xml"]),
        ("none/*.stl", []),
        ("arm.xml/*", []),
    ],
)
def test_patterns(look: Look, pattern: str, found: list[str]) -> None:
    assert [name for name in look.names(pattern) if "CACHEDIR" not in name] == found


@pytest.mark.parametrize(
    "name", ["../secret.stl", "/etc/passwd", "meshes/../../secret.stl", "", ".", "a//b", "a\0b", "a/"]
)
@pytest.mark.parametrize("kind", ["file", "there", "names"])
def test_what_is_not_below_the_project_is_refused(look: Look, kind: str, name: str) -> None:
    with pytest.raises(DxbError) as caught:
        look.answer(kind, name)
    assert caught.value.code == "DXB-B351"


def test_links_out_of_the_project_are_refused(look: Look, root: Path, tmp_path: Path) -> None:
    (root / "meshes" / "c.stl").symlink_to(tmp_path / "secret.stl")
    (root / "elsewhere").symlink_to(tmp_path)
    (root / "meshes" / "d.stl").symlink_to("a.stl")
    asked = [
        ("file", "meshes/c.stl"),
        ("there", "meshes/c.stl"),
        ("names", "meshes/*.stl"),
        ("file", "elsewhere/secret.stl"),
        ("there", "elsewhere/nothing/at/all"),
        ("names", "elsewhere/*.stl"),
        ("file", "cache/cas/a.stl"),
        ("there", "cache"),
    ]
    for kind, name in asked:
        with pytest.raises(DxbError) as caught:
            look.answer(kind, name)
        assert caught.value.code == "DXB-B351", name
    assert look.answer("file", "meshes/d.stl") == look.answer("file", "meshes/a.stl")


def test_each_change_of_an_answer_moves_something_that_is_watched(root: Path) -> None:
    """No-op builds and `dxb watch` rely on this: equal signatures mean equal answers."""
    store = Store(root / "cache")
    questions = [
        ("file", "arm.xml"),
        ("file", "gone.xml"),
        ("there", "extra/part.xml"),
        ("names", "meshes/**/*.stl"),
        ("names", "new/*.stl"),
    ]
    changes = [
        lambda: (root / "arm.xml").write_text("other"),
        lambda: (root / "gone.xml").write_text("here"),
        lambda: ((root / "extra").mkdir(), (root / "extra" / "part.xml").mkdir()),
        lambda: (root / "meshes" / "old" / "n.stl").write_text("n"),
        lambda: (root / "meshes" / "old" / "n.stl").unlink(),
        lambda: ((root / "meshes" / "a.stl").unlink(), (root / "meshes" / "a.stl").mkdir()),
        lambda: ((root / "new").mkdir(), (root / "new" / "x.stl").write_text("x")),
        lambda: (root / "arm.xml").unlink(),
    ]
    for change in changes:
        time.sleep(0.01)
        watch = store.leaves.watch = Watch()
        before = [Look(root, store.leaves, store.root).answer(*question) for question in questions]
        store.leaves.watch = None
        change()
        after = [Look(root, store.leaves, store.root).answer(*question) for question in questions]
        assert before != after
        assert not watch.settled()


def test_a_file_is_a_file_and_no_folder(look: Look) -> None:
    assert look.answer("file", "meshes") == "-"
    assert look.answer("there", "meshes") == "yes"
    assert look.answer("file", "nothing") == "-"


def test_a_recording_asks_once_and_keeps_the_order(look: Look, root: Path) -> None:
    asked = Recording(look)
    first = asked.digest_of("meshes/../arm.xml")
    (root / "arm.xml").write_text("edited while it runs")
    assert asked.digest_of("arm.xml") == first
    assert asked.exists("nothing") is False
    assert asked.glob("./meshes/*.stl") == ["meshes/a.stl", "meshes/b.stl"]
    assert [step[:2] for step in asked.steps] == [
        ["file", "arm.xml"],
        ["there", "nothing"],
        ["names", "meshes/*.stl"],
    ]


def test_a_question_without_an_answer_spoils_the_call(look: Look) -> None:
    asked = Recording(look)
    with pytest.raises(DxbError) as caught:
        asked.digest_of("nothing.xml")
    assert caught.value.code == "DXB-B352"
    assert asked.error is caught.value
    assert asked.steps == [["file", "nothing.xml", "-"]]


def test_what_progress_depends_on_is_read_before(look: Look) -> None:
    asked = Recording(look)
    asked.digest_of("arm.xml")
    asked.close()
    asked.digest_of("arm.xml")
    with pytest.raises(DxbError) as caught:
        asked.exists("other.xml")
    assert caught.value.code == "DXB-B353"


def test_a_pipe_is_no_file_that_can_be_read(look: Look, root: Path) -> None:
    os.mkfifo(root / "pipe")
    with pytest.raises(DxbError) as caught:
        look.answer("file", "pipe")
    assert caught.value.code == "DXB-R303"
