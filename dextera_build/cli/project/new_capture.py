"""`dxb new capture`: a folder for a calibration capture, to be filled."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from dextera_build.cli.table import writing
from dextera_build.errors import UsageError

VIEWS = 12
"""Pictures that the template names; ten and more leave room for bad ones."""
_README = """# A calibration capture

Put the pictures here as rgb_01.png, rgb_02.png, ... and fill in capture.json. It is read by

    photographs: {rule: capture.robot_views, folder: $capture}

| field | what it is |
|---|---|
| width, height | size of the pictures [px] |
| fx, fy, cx, cy | intrinsics of the colour camera [px]; a `camera_info.yaml` in this folder does as well |
| distortion | OpenCV's k1 k2 p1 p2 k3; leave it out for rectified pictures |
| depth_scale_m | metres per count of the depth images; remove it if there are none |
| setup | "eye-to-hand": the camera stands beside the robot; "eye-in-hand": it is on the hand |
| target | the board; `dxb new board` prints one and says what to write here |
| target.mounted | "gripper" for eye-to-hand, "table" for eye-in-hand |
| effector_frame | link of the robot's model that T_base_ee is the pose of: the flange, as a rule |
| views | one per picture, in any order |

Each view has

| field | what it is |
|---|---|
| rgb | file of the picture |
| depth | file of the depth image, registered to the picture; remove it if there is none |
| T_base_ee | pose of the effector in the robot's base: t_m [m], and rotvec_rad [rad] or quat_wxyz |
| joints | joint -> position [rad, of a sliding joint m]; with T_base_ee or instead of it |

Stop the robot for each picture, and read the pose while it stands. Turn the hand about at least two different axes, by
30 degrees and more, and let the board fill a quarter of the picture.
"""


def template() -> dict[str, object]:
    """`capture.json` with every field."""
    views = [
        {
            "rgb": f"rgb_{number:02d}.png",
            "depth": f"depth_{number:02d}.png",
            "T_base_ee": {"t_m": [None] * 3, "rotvec_rad": [None] * 3},
            "joints": {"joint_1": None, "joint_2": None},
        }
        for number in range(1, VIEWS + 1)
    ]
    board = {"type": "charuco", "squares": [7, 5], "square_m": 0.033, "marker_m": 0.024, "dictionary": "DICT_5X5_100"}
    return {
        **dict.fromkeys(("width", "height", "fx", "fy", "cx", "cy")),
        "distortion": [0.0, 0.0, 0.0, 0.0, 0.0],
        "depth_scale_m": 0.001,
        "setup": "eye-to-hand",
        "target": {**board, "mounted": "gripper"},
        "effector_frame": "flange",
        "views": views,
    }


def run(args: argparse.Namespace) -> int:
    """Write the folder and print its files."""
    if not args.name or args.object or args.out:
        raise UsageError("a capture takes the name of its folder", code="DXB-U217", hint="`dxb new capture my_capture`")
    folder = Path(args.name)
    files = {folder / "capture.json": _spelled(template()), folder / "README.md": _README}
    for path in files:
        if path.exists():
            raise UsageError(f"`{path}` exists already", code="DXB-U191", hint="name another folder")
    for path, text in files.items():
        with writing(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
        print(path)
    print(f"  fill them in, and put the pictures into {folder}/", file=sys.stderr)
    return 0


def _spelled(facts: dict[str, object]) -> str:
    """JSON with one field or view per line."""
    lines = [f" {json.dumps(name)}: {json.dumps(value)}" for name, value in facts.items() if name != "views"]
    views = facts["views"]
    assert isinstance(views, list)
    rows = ",\n".join("  " + json.dumps(view) for view in views)
    return "{\n" + ",\n".join([*lines, f' "views": [\n{rows}\n ]']) + "\n}\n"
