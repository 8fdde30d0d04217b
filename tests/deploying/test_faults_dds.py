"""The table of faults over DDS, in real time: each ends held and explained, and nothing moves after the stop."""

from __future__ import annotations

import time

import numpy as np
import pytest

pytest.importorskip("cyclonedds", reason="needs cyclonedds (extra `ros`)")
pytest.importorskip("rosbags", reason="needs rosbags (extra `ros`)")

from dextera_build.deploying.driving import Drive, drive
from dextera_build.deploying.faults import FAULTS, Fault, FaultKind
from dextera_build.formats.ros.reading import SECOND
from tests.deploying.real_time import running
from tests.deploying.robots import Line

RATE_HZ = 5.0
"""Slow, because a silence of two periods must not come from a busy machine."""
PERIODS_S = 2.0 / RATE_HZ
SILENCE_S = 0.5
"""Silence of pictures and poses that is allowed [s]."""
SLACK_S = 0.1
"""Delay of a busy machine, within which a command that was sent in time may arrive [s]."""
FAR = np.array([0.5, 0.4, 0.2, 0.04, 0.04])
"""Targets that the robot is still on its way to when the fault comes."""
SILENT = ("no joint states arrived for more than 0.4 s", "pictures and joint states are")
"""How joint states that are missing are told: a picture that belongs to none may come first."""
ENDS: dict[FaultKind, tuple[float | None, tuple[str, ...]]] = {
    "joint_states_stop": (PERIODS_S, SILENT),
    "joint_states_late": (PERIODS_S, ("joint states",)),
    "joint_states_lost": (None, SILENT),
    "pictures_stop": (SILENCE_S + PERIODS_S, ("no frame arrived for more than 0.5 s",)),
    "pictures_freeze": (None, ("`workspace` shows the same picture while the robot moves",)),
    "poses_stop": (SILENCE_S + PERIODS_S, ("no frame arrived for more than 0.5 s",)),
    "stamps_jump": (PERIODS_S, ("jumped by +3.00 s",)),
    "stamps_back": (PERIODS_S, ("jumped by -3.00 s",)),
    "nan": (PERIODS_S, ("is not a finite number",)),
    "sign_flipped": (None, ("x moved away from the targets", "positions jumped")),
    "joint_missing": (PERIODS_S, ("it lacks x",)),
    "joint_renamed": (PERIODS_S, ("it lacks x",)),
    "cut": (PERIODS_S, SILENT),
}
"""Fault -> longest time until the last command [s], None: it depends on chance or motion; what the reason may say."""


@pytest.mark.slow
@pytest.mark.parametrize("kind", FAULTS)
def test_a_fault_over_dds_ends_held_and_explained(kind: FaultKind) -> None:
    longest, why = ENDS[kind]
    with running(RATE_HZ, Fault(kind, at_s=1.0)) as (real, cell):
        ran: Drive = drive(cell, Line(FAR), np.zeros(1), rate_hz=RATE_HZ, limit_s=12.0)
        time.sleep(0.5)  # a controller reaches its last target
        place, heard = real.places(), real.robot.heard
        commands = heard.commands
        time.sleep(1.0)
        after = real.places()
    assert ran.faulty
    assert any(each in ran.reason for each in why), ran.reason
    assert ran.steps >= 3
    assert after == pytest.approx(place, abs=2e-3)
    assert (heard.commands, heard.after_stop) == (commands, 0)
    assert np.abs(after - FAR).max() > 0.02  # it was stopped on its way
    if longest is not None:
        assert (heard.last_ns - heard.faults[kind]) / SECOND <= longest + SLACK_S
    if kind != "cut":
        assert heard.status[-1] == f"stopped: {ran.reason}"
