"""Published descriptions as `dxb new robot` reads them: distribution `example-robot-data`, unpacked without its needs.

`pip download --no-deps example-robot-data`, unzip the wheel, and name the folder in `DXB_ROBOT_DESCRIPTIONS`.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tests.e2e.space import Space

pytestmark = pytest.mark.slow  # meshes of up to 25 MB are read and their hulls computed
FOLDER = os.environ.get("DXB_ROBOT_DESCRIPTIONS", "")
ROBOTS = {
    "xarm_description/urdf/xarm7.urdf": ("link_eef", ""),
    "ur_description/urdf/ur3_robot.urdf": ("ee_link", ""),
    "ur_description/urdf/ur5_robot.urdf": ("ee_link", ""),
    "ur_description/urdf/ur5_gripper.urdf": ("ee_link", ""),
    "z1_description/urdf/z1.urdf": ("gripperStator", "jointGripper"),
    "allegro_hand_description/urdf/allegro_right_hand.urdf": ("base", ""),
    "so_arm_description/urdf/so101.urdf": ("gripper_link", "gripper"),
    "so_arm_description/urdf/so100.urdf": ("gripper", "gripper"),
    "tiago_description/robots/tiago.urdf": ("hand_palm_link", ""),
    "kinova_description/robots/kinova.urdf": ("j2s6s200_end_effector", ""),
    "panda_description/urdf/panda.urdf": ("panda_hand", "panda_finger_joint1"),
}
"""Description -> link of its palm, and joint of its gripper."""


@pytest.mark.skipif(not FOLDER, reason="needs example-robot-data, unpacked, in `DXB_ROBOT_DESCRIPTIONS`")
@pytest.mark.parametrize("path", ROBOTS, ids=[Path(each).stem for each in ROBOTS])
def test_a_published_description_builds_as_it_was_guessed(path: str, tmp_path: Path) -> None:
    palm, gripper = ROBOTS[path]
    file = next(Path(FOLDER).rglob(path))
    space = Space(tmp_path)
    space.write("dxb.toml", 'cache = "cache"\n')
    answer = space.dxb("new", "robot", str(file), "--repair-inertias")
    assert answer.code == 0, answer.err
    assert f"palm = {palm}: " in answer.err
    assert f" = {gripper}: open at" in answer.err if gripper else "gripper of" not in answer.err
    built = space.dxb("build", f"robot/{file.stem}", "--console", "none")
    assert built.code == 0, built.err
