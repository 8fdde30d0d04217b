"""One run of dex-retargeting, in an environment of its own: `python peer.py SETTING.json POINTS.npz OUT.npz`."""

from __future__ import annotations

import json
import sys
import time
from importlib.metadata import version
from pathlib import Path

import numpy as np
from dex_retargeting.retargeting_config import RetargetingConfig


def main(setting: Path, points: Path, out: Path) -> None:
    """Retarget (N, 21, 3) joints in the axes of the robot's wrist; write joint positions, seconds and names."""
    given = json.loads(setting.read_text())
    retargeting = RetargetingConfig.from_dict(given).build()
    optimizer = retargeting.optimizer
    first, second = optimizer.target_link_human_indices
    found, seconds = [], []
    for hand in np.load(points)["points"]:
        before = time.process_time()
        found.append(retargeting.retarget((hand[second] - hand[first]).astype(np.float32)))
        seconds.append(time.process_time() - before)
    names = np.array(optimizer.robot.dof_joint_names)
    np.savez(out, positions=np.array(found), seconds=np.array(seconds), names=names, version=version("dex-retargeting"))


if __name__ == "__main__":
    main(*(Path(each) for each in sys.argv[1:]))
