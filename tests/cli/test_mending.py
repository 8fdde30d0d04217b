"""The panel of `dxb view` corrects a twin that was built, builds it again, and shows the new scene in its place."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from dextera_build.cli.look import mending, shown
from dextera_build.errors import UsageError
from dextera_build.project import project as projects
from dextera_build.project.planning import Added
from dextera_build.session import Session
from tests.e2e.space import Space
from tests.e2e.test_corrections import CAPTURE, write_capture
from tests.view.test_chosen import press
from tests.view.test_view import Recorder

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("twin_workers")]


class Viewer(Recorder):
    """A viewer that can be emptied."""

    def reset(self) -> None:
        self.nodes.clear()
        self.controls.clear()


@pytest.fixture
def space(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Space:
    monkeypatch.chdir(tmp_path)
    space = Space(tmp_path)
    space.write("dxb.toml", 'cache = "cache"\n')
    write_capture(tmp_path / "shot")
    answer = space.run("build", "twin/tabletop", *CAPTURE, "--profile", "stub")  # the words of a process are logged
    assert answer.code == 0, answer.err
    return space


def test_two_objects_are_merged_built_and_shown(space):
    session = Session(projects.find(), "twin/tabletop", last=True)
    viewer = Viewer()
    shown.of(session, "")(viewer)
    first, second = (name.split("/")[-1] for name in viewer.nodes if name.startswith("/labels/"))
    frames = [name for name in viewer.nodes if name.endswith("/visual")]
    assert len(frames) == 2
    for frame in frames:
        viewer.nodes[frame].clicked(None)
    other = viewer.controls["Merge with"].value
    (kept,) = {first, second} - {other}
    press(viewer, "Merge")
    words = viewer.nodes["Click an object for its mass, material and friction."].content
    assert words.startswith("Written to `scene.yaml`:\n\n* line "), words
    assert f"`{other}` is removed" in words
    command = "dxb build twin/tabletop --input capture=shot --input description=scene.yaml --profile stub"
    assert f"`{command}`" in words
    press(viewer, "Rebuild")
    assert [name.split("/")[-1] for name in viewer.nodes if name.startswith("/labels/")] == [kept]
    answer = space.dxb(*command.split()[1:], "--check")
    assert answer.code == 0, answer.err


def test_a_request_that_is_not_known_any_more_is_refused(space):
    os.rename("shot", "gone")
    session = Session(projects.find(), "twin/tabletop", last=True)
    assert mending.request_of(session).added == Added({"capture": "shot"})
    for log in (space.root / "cache" / "runs").glob("*/events.jsonl"):
        log.write_text(log.read_text().replace('"capture=shot"', '"capture=here"'))
    with pytest.raises(UsageError, match="a request whose inputs are not known here") as caught:
        mending.request_of(Session(projects.find(), "twin/tabletop", last=True))
    assert caught.value.code == "DXB-U225"
