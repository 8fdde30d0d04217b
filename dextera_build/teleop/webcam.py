"""Hands from a camera: MediaPipe runs as a program of another environment, because its packages exclude dxb's."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from dextera_build.errors import MachineError, UsageError
from dextera_build.sim.experts.live_operator import Message, Refused
from dextera_build.teleop import landmark_program
from dextera_build.teleop.delay import Delays
from dextera_build.teleop.landmarks import Landmarks
from dextera_build.teleop.session import Session

MEDIAPIPE = "mediapipe==0.10.14"
"""The version whose wheel holds its models, so that nothing is fetched."""
PATIENT_S = 120.0
"""Longest time until the first picture: MediaPipe takes some to load [s]."""


class Webcam:
    """Reads hands from a camera or a film, and gives them to a session.

    Args:
        source: Number of a camera, or path of a film.
        folder: An environment with MediaPipe, if there is one.
        view_deg: Angle of view across the picture [deg].
        length_m: Of the operator's hand, from the wrist's crease to the tip of the middle finger [m].

    Raises:
        UsageError: There is no such camera or film, or a number is none of a hand or a lens.
        MachineError: MediaPipe is not installed, or the camera cannot be read.
    """

    def __init__(self, source: str, folder: Path, view_deg: float, length_m: float) -> None:
        _check(source, view_deg, length_m)
        self.delay = Delays()
        """From a picture to the message of its hands [ms]."""
        self.name = f"camera {source}" if source.isdigit() else f"film {Path(source).name}"
        self._source = source
        command = [str(_python(folder)), "-I", landmark_program.__file__, source]
        quiet = os.environ | {"GLOG_minloglevel": "2", "TF_CPP_MIN_LOG_LEVEL": "2", "OPENCV_LOG_LEVEL": "OFF"}
        # Ctrl-C ends the session, which ends the program.
        self._program = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            env=quiet,
            start_new_session=True,
        )
        try:
            size = self._first(folder)
        except BaseException:
            self.close()
            raise
        self._landmarks = Landmarks(size["width"], size["height"], float(np.radians(view_deg)), length_m)

    def feed(self, session: Session) -> None:
        """Give hands to a session from now on, in a thread."""
        session.camera = True
        session.takes.device = f"MediaPipe's landmarks of {self.name}"
        session.measure.of(measured=True)
        threading.Thread(target=self._read, args=(session,), name="webcam", daemon=True).start()

    def close(self) -> None:
        """End the program."""
        self._program.terminate()
        try:
            self._program.wait(5)
        except subprocess.TimeoutExpired:
            self._program.kill()
            self._program.wait()

    def _first(self, folder: Path) -> Mapping[str, Any]:
        """The first line of the program: the size of the pictures."""
        assert self._program.stdout
        timer = threading.Timer(PATIENT_S, self._program.kill)
        timer.start()
        line = self._program.stdout.readline()
        timer.cancel()
        facts = json.loads(line) if line else {"fault": "ended"}
        if "fault" not in facts:
            return dict(facts)
        if facts["fault"] == "mediapipe":
            raise _missing(folder, facts["said"])
        if facts["fault"] == "film":
            raise UsageError(f"`{self._source}` is no film that can be read", code="DXB-U338")
        raise MachineError(
            f"{self.name} gives no picture",
            code="DXB-E327",
            hint=f"end the program that uses it: `fuser /dev/video{self._source}` names it",
        )

    def _read(self, session: Session) -> None:
        assert self._program.stdout
        for line in self._program.stdout:
            arrived = time.perf_counter()
            session.inbox.put(partial(self._message, line, arrived, session))
        if not session.ended:
            print(f"{self.name} has ended: no more hands arrive", file=sys.stderr)

    def _message(self, line: str, arrived: float, session: Session) -> Message:
        """Read a line of the program, in the session's thread."""
        facts = json.loads(line)
        self.delay.add([1000 * (arrived - facts["seen"])])
        try:
            return self._landmarks.message(facts["hands"], facts["seen"], arrived, session.heading_rad)
        except (np.linalg.LinAlgError, ValueError) as error:
            raise Refused(f"landmarks that are no hand: {error}") from None


def _check(source: str, view_deg: float, length_m: float) -> None:
    if not (10 < view_deg < 150 and 0.1 < length_m < 0.3):
        raise UsageError(
            "a lens sees 10 to 150 deg, and a hand is 0.1 to 0.3 m long",
            code="DXB-U339",
            facts={"--webcam-view": f"{view_deg:g} deg", "--hand-length": f"{length_m:g} m"},
        )
    if not source.isdigit():
        if not Path(source).is_file():
            raise UsageError(f"`{source}` is neither the number of a camera nor a film", code="DXB-U337")
        return
    device = Path(f"/dev/video{source}")
    if not sys.platform.startswith("linux"):
        return
    if not device.exists():
        there = sorted(each.name.removeprefix("video") for each in Path("/dev").glob("video*"))
        raise UsageError(
            f"there is no camera {source}",
            code="DXB-U337",
            facts={"cameras": ", ".join(there) or "none"},
            hint="connect one; `--webcam FILE` reads a film in its place",
        )
    if not os.access(device, os.R_OK | os.W_OK):
        raise MachineError(
            f"camera {source} may not be read", code="DXB-E324", hint="`sudo usermod -aG video $USER`, and log in again"
        )


def _python(folder: Path) -> Path:
    """A Python that has MediaPipe: that of its own environment, or this one."""
    own = folder / "bin" / "python"
    if own.exists():
        return own
    if importlib.util.find_spec("mediapipe") is not None:
        return Path(sys.executable)
    raise _missing(folder, f"there is no {own}")


def _missing(folder: Path, said: str) -> MachineError:
    return MachineError(
        "a camera's hands need MediaPipe, in an environment of its own",
        code="DXB-E323",
        facts={"system": said},
        hint=f"`{sys.executable} -m venv {folder} && {folder}/bin/pip install {MEDIAPIPE}`",
    )
