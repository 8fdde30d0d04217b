"""Errors, gaps, smoothness and time of a retargeted motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.geometry import hands
from dextera_build.sim.retarget.fingers import Fingers, measured
from dextera_build.sim.retarget.matching import Matched
from dextera_build.sim.retarget.options import Retargeting

HEAD = (
    "| method | tip error, open hand [mm] | tip error, moving [mm] | pinch: gap of surfaces [mm] | of tip frames [mm] "
    "| touches while open | jerk of joints [rad/s^3] | jerk of tips [m/s^3] | per message: mean, p99 [ms] |\n"
    "|---|---|---|---|---|---|---|---|---|"
)


@dataclass(frozen=True)
class Run:
    """A retargeted motion."""

    positions: np.ndarray
    """(N, H) motor positions [rad]."""
    seconds: np.ndarray
    """(N,) processor time of each message [s]."""
    scale: float
    """Metre of the robot's hand per metre of the operator's."""


def row(title: str, own: Matched, run: Run, truth: tuple[np.ndarray, list[str], float]) -> str:
    """A row of the table, against the motion without noise: joints (N, 25, 3), names of postures, rate [Hz]."""
    clean, names, rate = truth
    wanted = Fingers(own, measured(clean, np.ones(len(clean), bool)), Retargeting(scale=run.scale)).beside.robot_tips
    tips, missed, gaps, between, touches = [], [], [], [], []
    for points, posture, name in zip(clean, run.positions, names, strict=True):
        seen = own.hand.at(posture)
        tips.append(seen.tips)
        missed.append(np.linalg.norm(seen.tips - wanted(points), axis=1))
        if name == "open":
            touches.append(bool(own.hand.touching()))
        if name in hands.FINGERS and hands.FINGERS.index(name) in own.fingers:
            finger = own.fingers.index(hands.FINGERS.index(name))
            gaps.append(own.hand.gap(0, finger))
            between.append(float(np.linalg.norm(seen.tips[finger] - seen.tips[0])))
    rest, moves = np.array([name == "open" for name in names]), np.array([not name for name in names])
    jerk, leap = (np.sqrt(np.square(np.diff(each, 3, axis=0) * rate**3).mean()) for each in (run.positions, tips))
    off = np.abs(gaps) * 1e3
    cells = [
        title,
        f"{np.array(missed)[rest].mean() * 1e3:.1f}",
        f"{np.array(missed)[moves].mean() * 1e3:.1f}",
        f"{np.mean(off):.1f}, worst {np.max(off):.1f}{', inside' if np.min(gaps) < -1e-3 else ''}",
        f"{np.mean(between) * 1e3:.1f}",
        f"{100 * np.mean(touches):.0f} %",
        f"{jerk:.0f}",
        f"{leap:.0f}",
        f"{run.seconds.mean() * 1e3:.2f}, {np.quantile(run.seconds, 0.99) * 1e3:.2f}",
    ]
    return f"| {' | '.join(cells)} |"
