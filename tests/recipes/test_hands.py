"""Hands from a file to a checked recording, and made hands of a task, as a user types it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.robots.hand_stream import HandStream
from tests.e2e.space import Space
from tests.hand_streams import stream, with_buttons

pytest.importorskip("av", reason="needs av (extra `learn`)")


@pytest.mark.slow
def test_a_recording_is_checked_and_filmed(tmp_path: Path) -> None:
    space = Space(tmp_path)
    made = with_buttons(72)
    (path,) = made.save(space.root / "mug.mcap")
    answer = space.build("capture/hands", "--input", f"operator={path.name}")
    assert answer.code == 0, answer.err[-3000:]
    written = {Path(line.split("\t")[1]).name: space.root / line.split("\t")[1] for line in answer.out.splitlines()}
    assert set(written) == {"hands.mcap", "film.mp4"}
    found = HandStream.load(written["hands.mcap"])
    np.testing.assert_array_equal(found.positions, made.positions)
    again = space.dxb("build", "capture/hands", "--input", f"operator={path.name}")
    assert "is up to date" in again.err
    # Another option of the check reads the same recording again.
    options = ("--set", "hands.slowest_hz=100")
    doubted = space.dxb("build", "capture/hands", "--input", f"operator={path.name}", *options)
    assert "hands come at 72.0 Hz" in doubted.err


@pytest.mark.slow
def test_a_recording_in_millimetres_is_refused_with_what_to_type(tmp_path: Path) -> None:
    space = Space(tmp_path)
    made = stream(20)
    HandStream(**dict(made) | {"positions": 1000 * made.positions}).save(space.root / "mm.mcap")
    answer = space.build("capture/hands", "--input", "operator=mm.mcap")
    assert answer.code == 1
    assert "looks like millimetres instead of metres" in answer.err
    assert "set `unit_m: 0.001`" in answer.err


@pytest.mark.slow
def test_hands_of_a_task_are_made_and_pass_the_check(tmp_path: Path) -> None:
    """With real backends: the bottle's twin, the scripted operator, and the hands that follow it."""
    space = Space(tmp_path)
    answer = space.build("reference/operator_hands")
    assert answer.code == 0, answer.err[-3000:]
    made = next(line.split("\t")[1] for line in answer.out.splitlines() if line.startswith("hands\t"))
    stream = HandStream.load(space.root / made)
    assert stream.synthetic
    assert len(stream.takes) == 2
    assert len({take.seed for take in stream.takes}) == 2
    assert stream.rate_hz == pytest.approx(72, rel=0.02)
    shown = space.dxb("show", "reference/operator_hands:hands", "--json").document
    assert "no person and no headset" in shown["result"]
    checked = space.build("capture/hands", "--input", f"operator={made}")
    assert checked.code == 0, checked.err[-3000:]


ERRORS = ("tremor_m", "tremor_deg", "jitter_m", "jitter_deg", "drift_m", "drift_deg", "losses_per_min", "clock_s")


@pytest.mark.slow
@pytest.mark.timeout(1500)
def test_a_task_follows_a_recording_in_place_of_its_script(tmp_path: Path) -> None:
    """With real backends; hands without errors of tracking, since a program does not correct what it sees."""
    space = Space(tmp_path)
    exact = [word for name in ERRORS for word in ("--set", f"hands.unsteady.{name}=0")]
    made = space.build("reference/operator_hands:hands", *exact)
    assert made.code == 0, made.err[-3000:]
    recording = next(line.split("\t")[1] for line in made.out.splitlines() if line.startswith("hands\t"))
    command = ("task/kl/lift_mustard_bottle:sources", "--input", f"operator={recording}")
    assert space.build(*command).code == 0
    shown = space.dxb("show", *command, "--json").document
    assert shown["backend"] == "hands"
    assert space.dxb("check", *command).code == 0, "bit for bit the same"
    filtered = space.dxb("plan", *command, "--set", "sources.hands.low_pass_hz=8")
    assert filtered.code == 0
