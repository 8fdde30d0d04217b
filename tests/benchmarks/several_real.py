"""Real photographs of `kitchen_table`, placed beside one another by `align.photographs`.

`python -m tests.benchmarks.several_real` prints a row per pair of views: their distance, and the error of the pose that
is found, or why there is none. The stated motion of the camera is said to be good to about 10 mm.
"""

from __future__ import annotations

import json
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image as Pictures

from dextera_build.artifacts.cameras.camera import Capture
from dextera_build.artifacts.cameras.further import Further, FurtherPhotographs
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.errors import RuleError
from dextera_build.geometry import poses, transforms
from dextera_build.testing import RuleRunner
from tests import factories

CAPTURE = Path(__file__).parents[3] / "shared" / "captures" / "kitchen_table"
PAIRS = ((390, 380), (390, 360), (390, 340), (390, 420), (390, 450), (300, 320), (500, 470))


def view(frame: int) -> tuple[Capture, np.ndarray]:
    """A view of the recording, and T_world_camera (4, 4) as stated."""
    facts = json.loads((CAPTURE / "views.json").read_text())
    one = next(each for each in facts["views"] if each["frame"] == frame)
    rgb = np.asarray(Pictures.open(CAPTURE / one["rgb"]).convert("RGB"))
    depth = np.asarray(Pictures.open(CAPTURE / one["depth"])).astype(np.float32) * facts["depth_scale_m"]
    lens = {name: facts[name] for name in ("fx", "fy", "cx", "cy")}
    camera = factories.camera(facts["width"], facts["height"]).model_copy(update=lens)
    # The recording states seven digits, which is less than a rigid motion needs.
    return factories.rgbd(rgb, depth, camera), poses.to_matrix(poses.from_matrix(np.array(one["T_world_camera"])))


def placed(folder: Path, first: int, other: int, *, off: np.ndarray | None = None) -> np.ndarray:
    """T_stated_found (4, 4) of a view beside another one.

    Args:
        folder: For temporary files.
        first: The first view's frame.
        other: The frame of the view that is placed.
        off: A motion (4, 4) of its camera from the stated pose, which then is stated; None: no pose is stated.

    Raises:
        RuleError: It cannot be placed.
    """
    (capture, world_from_first), (further, world_from_other) = view(first), view(other)
    true = transforms.invert(world_from_first) @ world_from_other
    pose = None if off is None else Pose(parent="camera", child="further", matrix=true @ off)
    item = Further(file=f"{other}.png", capture=further, pose=pose)
    run = RuleRunner(folder).run
    (found,) = run("align.photographs", photo=capture, further=FurtherPhotographs(items=(item,))).items
    return transforms.invert(true) @ found.pose.matrix


def main() -> None:
    """Print the table."""
    for first, other in PAIRS:
        (_, one), (_, two) = view(first), view(other)
        apart = transforms.invert(one) @ two
        with tempfile.TemporaryDirectory() as folder:
            try:
                told = _told(placed(Path(folder), first, other))
            except RuleError as error:
                told = error.message
        print(f"{first}, {other}: {_told(apart)} apart; off {told}", flush=True)


def _told(motion: np.ndarray) -> str:
    angle = np.degrees(transforms.angle(motion[:3, :3]))
    return f"{1000 * np.linalg.norm(motion[:3, 3]):.0f} mm and {angle:.1f} deg"


if __name__ == "__main__":
    main()
