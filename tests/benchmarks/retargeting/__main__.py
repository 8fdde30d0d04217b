"""Retargeting to the LEAP Hand and the Revo 1 beside dex-retargeting, on motions that a program made.

    make bench-retargeting

Both get the same joints, the same kinematics (the robot of the recipe, as URDF for the peer), the same place of the
wrist and, in the rows `same scale`, the same scale.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np

from dextera_build.api import Project
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.geometry import hands
from dextera_build.sim.retarget.fingers import Fingers, measured
from dextera_build.sim.retarget.matching import Matched, matched
from dextera_build.sim.retarget.options import Retargeting
from tests.benchmarks.retargeting import urdf
from tests.benchmarks.retargeting.measures import HEAD, Run, row
from tests.hand_motions import motion

NOISE_M = 5e-4
PEER = Path(__file__).with_name("peer.py")
LEAP_SCALE, ALPHA = 1.6, 0.2
"""Of dex-retargeting's own `configs/teleop/leap_hand_right*.yml`."""


def main() -> None:
    """Print the tables."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--peer", type=Path, help="Python of an environment with dex-retargeting")
    options.add_argument("--rate", type=float, default=72.0, help="messages per second")
    given = options.parse_args()
    project = Project.find()
    for name, limb in (("kuka_leap", "arm"), ("openarm_revo1", "right")):
        project.build(f"robot/{name}")
        robot = project.get(f"robot/{name}:robot")
        assert isinstance(robot, RobotModel)
        print(f"\n{name}, {limb}, {given.rate:g} Hz\n\n{HEAD}")
        for line in rows(robot, limb, given.rate, given.peer if name == "kuka_leap" else None):
            print(line)


def rows(robot: RobotModel, limb: str, rate_hz: float, peer: Path | None) -> list[str]:
    """Rows of one hand."""
    own = matched(robot, limb)
    _, clean, names = motion(rate_hz, own.side)
    _, noisy, _ = motion(rate_hz, own.side, NOISE_M)
    made = [
        ("dxb", ours(own, noisy, rate_hz, Retargeting())),
        ("dxb, no filter", ours(own, noisy, rate_hz, Retargeting(low_pass_hz=0.0))),
    ]
    if peer is not None:
        made.append((f"dxb, scale {LEAP_SCALE:g}", ours(own, noisy, rate_hz, Retargeting(scale=LEAP_SCALE))))
        same = made[0][1].scale
        for kind in ("DexPilot", "vector"):
            for scale, alpha, about in (
                (LEAP_SCALE, ALPHA, "as shipped"),
                (same, ALPHA, "same scale"),
                (same, 1.0, "same scale, no filter"),
            ):
                with tempfile.TemporaryDirectory() as folder:
                    run = theirs(own, noisy, (peer, kind, scale, alpha), Path(folder))
                made.append((f"dex-retargeting {kind}, {about}", run))
    return [row(title, own, run, (clean, names, rate_hz)) for title, run in made]


def ours(own: Matched, points: np.ndarray, rate_hz: float, options: Retargeting) -> Run:
    """The motion of the robot's hand by dxb."""
    follower = Fingers(own, measured(points, np.ones(len(points), bool)), options)
    found, seconds = [], []
    for hand in points:
        before = time.process_time()
        found.append(follower.next(hand, 1 / rate_hz))
        seconds.append(time.process_time() - before)
    return Run(np.array(found), np.array(seconds), follower.beside.scale)


def theirs(own: Matched, points: np.ndarray, how: tuple[Path, str, float, float], folder: Path) -> Run:
    """The motion by the peer: Python, kind, scale and share of its low pass in `how`."""
    python, kind, scale, alpha = how
    tips = {f"tip_{hands.FINGERS[each]}": place for place, each in enumerate(own.fingers)}
    (folder / "hand.urdf").write_text(urdf.written(own.hand, {"wrist": wrist(own, points, scale)}, tips))
    frame = hands.palm_frame(points, own.side)
    local = np.einsum("njc,nck->njk", points - points[:, hands.WRIST, None], frame) @ own.turn.T
    np.savez(folder / "points.npz", points=local[:, hands.MEDIAPIPE])
    setting = {"type": kind, "urdf_path": str(folder / "hand.urdf"), "scaling_factor": scale, "low_pass_alpha": alpha}
    if kind == "DexPilot":
        setting |= {"wrist_link_name": "wrist", "finger_tip_link_names": list(tips)}
    else:
        ends = [hands.MEDIAPIPE.index(hands.TIPS[each]) for each in own.fingers]
        setting |= {
            "target_origin_link_names": ["wrist"] * len(tips),
            "target_task_link_names": list(tips),
            "target_link_human_indices": [[0] * len(tips), ends],
        }
    (folder / "setting.json").write_text(json.dumps(setting))
    paths = [str(folder / name) for name in ("setting.json", "points.npz", "out.npz")]
    subprocess.run([str(python), str(PEER), *paths], check=True)
    out = np.load(folder / "out.npz")
    order = [out["names"].tolist().index(name) for name in own.hand.joints]
    return Run(out["positions"][:, order], out["seconds"], scale)


def wrist(own: Matched, points: np.ndarray, scale: float) -> np.ndarray:
    """T_palm_wrist (4, 4) of a robot: where the operator's wrist is if the fingers begin at the same place."""
    knuckles = [hands.KNUCKLES[finger] for finger in own.others]
    away = points[:, knuckles].mean(axis=1) - points[:, hands.WRIST]
    local = np.einsum("nc,nck->nk", away, hands.palm_frame(points, own.side))
    place = np.eye(4)
    place[:3, 3] = own.anchor - scale * own.turn @ np.median(local, axis=0)
    return place


if __name__ == "__main__":
    main()
