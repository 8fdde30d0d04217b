"""Measures runs on a simulated robot over DDS in one process: `python -m tests.benchmarks.deploying`.

Prints two tables: how each fault ends, and how regularly commands come from a policy whose every answer takes longer
than a control period.
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass

import numpy as np

from dextera_build.deploying.ahead import Ahead
from dextera_build.deploying.driving import drive
from dextera_build.deploying.faults import FAULTS, Fault
from dextera_build.formats.ros.reading import SECOND
from dextera_build.policy.observation import DeployableObservation
from tests.deploying.real_time import running
from tests.deploying.robots import Line

FAULT_HZ, STEADY_HZ = 5.0, 20.0
FAR = np.array([0.5, 0.4, 0.2, 0.04, 0.04])
STEPS = 20
"""Steps of an answer."""
TAKES_S = 0.08
"""Time of an answer [s]."""
RUN_S = 10.0
"""Duration of a run without faults [s]."""


@dataclass
class Slow:
    """Takes longer than a control period for each answer, and answers with `STEPS` steps."""

    every: int = 1
    left: int = 0

    def reset(self) -> None:
        self.left = 0

    def chunk(self, *observations: DeployableObservation) -> np.ndarray:
        time.sleep(TAKES_S)
        return np.tile(FAR, (STEPS, 1))

    def act(self, observation: DeployableObservation) -> np.ndarray:
        if not self.left:
            self.chunk(observation)
        self.left = (self.left or self.every) - 1
        return FAR


def faults() -> None:
    """How each fault ends."""
    print("| fault | last command after it [s] | commands after the stop | why it ended |")
    print("|---|---|---|---|")
    for kind in FAULTS:
        with running(FAULT_HZ, Fault(kind, at_s=1.0)) as (real, cell):
            ran = drive(cell, Line(FAR), np.zeros(1), rate_hz=FAULT_HZ, limit_s=12.0)
            time.sleep(1.0)
            heard = real.robot.heard
            after = (heard.last_ns - heard.faults[kind]) / SECOND
        why = ran.reason.removeprefix("the guard stopped the robot: ")
        print(f"| `{kind}` | {after:.2f} | {heard.after_stop} | {why} |", flush=True)


def regularity() -> None:
    """How regularly commands come, with the policy in the loop and in a thread of its own."""
    print("| policy | periods | late | without a step | delay p50, p99 [ms] | jitter p50, p99 [ms] | age p99 [ms] |")
    print("|---|---|---|---|---|---|---|")
    for name in ("asked in every period", "asked every fifth period", "asynchronous"):
        with running(STEADY_HZ) as (_, cell):
            slow = Slow(every=5 if "fifth" in name else 1)
            ahead = Ahead(
                slow,
                lambda cell=cell: cell.previous_action,  # type: ignore[misc]
                rate_hz=STEADY_HZ,
                every=5,
                answer_s=0.5,
                now=time.time_ns,
            )
            acting = ahead if name == "asynchronous" else slow
            ran = drive(cell, acting, np.zeros(1), rate_hz=STEADY_HZ, limit_s=RUN_S)
        told = ran.facts() | (ahead.facts() if acting is ahead else {})
        cells = [
            name,
            told["steps"],
            told["missed_periods"],
            told.get("periods_without_a_step", "-"),
            f"{told['delay_ms_p50']}, {told['delay_ms_p99']}",
            f"{told['jitter_ms_p50']}, {told['jitter_ms_p99']}",
            told.get("age_ms_p99", "-"),
        ]
        print("| " + " | ".join(map(str, cells)) + " |", ran.reason, flush=True)


if __name__ == "__main__":
    {"faults": faults, "regularity": regularity}[sys.argv[1]]()
