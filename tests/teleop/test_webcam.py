"""Hands from a camera: what is refused, and a film of a rendered hand through MediaPipe; no human hand was filmed."""

from __future__ import annotations

import sys
import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from dextera_build.artifacts.robots.hand_stream import LOST
from dextera_build.errors import DxbError
from dextera_build.geometry import human_hand
from dextera_build.sim.experts.live_operator import Message
from dextera_build.teleop import landmark_program, posture, webcam
from dextera_build.teleop.measure import Measure
from dextera_build.teleop.webcam import Webcam
from tests import readers
from tests.teleop import rendered_hands
from tests.teleop.test_landmarks import UPRIGHT

VIEW_DEG, LENGTH_M = 60.0, 0.19


@pytest.fixture
def film(tmp_path: Path) -> Path:
    """A file that is no film."""
    path = tmp_path / "hand.mp4"
    path.write_text("no film")
    return path


def refused(source: str | Path, folder: Path, view_deg: float = VIEW_DEG, length_m: float = LENGTH_M) -> DxbError:
    with pytest.raises(DxbError) as caught:
        Webcam(str(source), folder, view_deg, length_m)
    return caught.value


def test_a_camera_that_is_not_there_is_told_with_those_that_are(tmp_path: Path):
    error = refused("97", tmp_path)
    assert error.code == "DXB-U337"
    assert error.message == "there is no camera 97"
    assert refused(tmp_path / "none.mp4", tmp_path).code == "DXB-U337"


@pytest.mark.parametrize(("view_deg", "length_m"), [(0.0, 0.19), (200.0, 0.19), (60.0, 19.0), (float("nan"), 0.19)])
def test_numbers_that_no_lens_or_hand_has_are_refused(film: Path, view_deg: float, length_m: float):
    assert refused(film, film.parent, view_deg, length_m).code == "DXB-U339"


def test_without_mediapipe_the_command_that_installs_it_is_told(film: Path, monkeypatch: pytest.MonkeyPatch):
    folder = film.parent / "mediapipe"
    monkeypatch.setattr(webcam.importlib.util, "find_spec", lambda name: None)
    error = refused(film, folder)
    assert error.code == "DXB-E323"
    assert f"{folder}/bin/pip install mediapipe==0.10.14" in (error.hint or "")
    # An environment that lost it says the same.
    own = folder / "bin" / "python"
    own.parent.mkdir(parents=True)
    own.write_text(f'#!/bin/sh\nexec {sys.executable} -S "$@"\n')
    own.chmod(0o755)
    error = refused(film, folder)
    assert error.code == "DXB-E323"
    assert "No module named" in str(error.facts["system"])


def test_a_camera_that_another_program_uses_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    busy = tmp_path / "busy.py"
    busy.write_text('print(\'{"fault": "camera"}\')')
    monkeypatch.setattr(landmark_program, "__file__", str(busy))
    monkeypatch.setattr(webcam, "_check", lambda *words: None)
    monkeypatch.setattr(webcam, "_python", lambda folder: Path(sys.executable))
    error = refused("0", tmp_path)
    assert error.code == "DXB-E327"
    assert "fuser /dev/video0" in (error.hint or "")


class Session(SimpleNamespace):
    """Stands in for a simulation: it keeps all messages."""

    def __init__(self) -> None:
        super().__init__(takes=SimpleNamespace(device=""), measure=Measure(), heading_rad=0.0, camera=False)
        self.messages: list[Message] = []
        self.ended = False
        self.inbox = SimpleNamespace(put=lambda read: self.messages.append(read()))


@pytest.mark.slow
@pytest.mark.timeout(1800)  # MediaPipe takes long to load beside other work
def test_a_rendered_hand_is_found_where_it_moves(tmp_path: Path, capfd: pytest.CaptureFixture[str]):
    folder = readers.ENVIRONMENTS / "mediapipe"
    if not (folder / ".installed").exists():
        pytest.skip("needs .venv/readers/mediapipe; `make readers` makes it")
    (tmp_path / "none.mp4").write_text("no film")
    assert refused(tmp_path / "none.mp4", folder).code == "DXB-U338"
    way = np.concatenate([np.zeros(6), np.linspace(0, 1, 10), np.ones(10)])
    places = np.array([-0.05, 0.07, 0.5]) + way[:, None] * [0.10, -0.03, 0.0]
    angles = human_hand.open_angles() * 0.5 + 0.5 * np.deg2rad(posture.CLOSED_DEG)
    points, _ = human_hand.Hand(LENGTH_M).joints(angles, "right")
    frames = [points @ UPRIGHT.T + place for place in places]
    rendered_hands.film(tmp_path / "hand.mp4", frames, VIEW_DEG, 10.0)
    camera, session = Webcam(str(tmp_path / "hand.mp4"), folder, VIEW_DEG, LENGTH_M), Session()
    try:
        camera.feed(session)  # type: ignore[arg-type]
        next(each for each in threading.enumerate() if each.name == "webcam").join(120)
    finally:
        camera.close()
    assert session.camera
    assert session.takes.device == "MediaPipe's landmarks of film hand.mp4"
    assert "film hand.mp4 has ended" in capfd.readouterr().err
    assert len(session.messages) == len(frames)
    tracked = np.array([message.tracking > LOST for message in session.messages])
    side = int(tracked.sum(axis=0).argmax())
    assert tracked[:, side].mean() > 0.9
    moved: Any = np.array([message.positions[side, 0] for message in session.messages])
    begin, end = (np.nanmedian(moved[rows], axis=0) for rows in (slice(2, 6), slice(-4, None)))
    # The picture's right is the base's +y, and its top the base's z; the distance is the least exact.
    np.testing.assert_allclose((end - begin)[1:], [0.10, 0.03], atol=0.02)
    assert abs((end - begin)[0]) < 0.06
    assert abs(begin[0] + 0.5) < 0.1
    assert len(camera.delay) == len(frames)
