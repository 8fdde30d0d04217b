"""Real frames: things of `kitchen_table`, tracked without knowledge of how the camera moves.

`python -m tests.benchmarks.tracking.kitchen` builds `twin/tracked` from view 300 and its 27 views and prints a row per
thing: views in which at least half of it is before the camera, views in which it was tracked, medians and largest
distances of its middle, of its axis and of its turn from where the stated motion of the camera puts it, and the same
for the views where the stated motion is confirmed by the measured depth: there at least 60 % of the unhidden pixels of
the thing, placed by that motion, are where they should be. The motion itself is said to be good to about 10 mm.
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dextera_build import Project
from dextera_build.artifacts.cameras.rgbd_video import RgbdFrame, RgbdVideo
from dextera_build.artifacts.objects.object import Asset, Support
from dextera_build.artifacts.spatial.tracking import Tracking
from dextera_build.geometry import poses, transforms
from dextera_build.tracking import judge
from dextera_build.tracking.colours import Colours
from dextera_build.tracking.frame import Frame
from dextera_build.tracking.model import Model, State

REPO = Path(__file__).parents[3]
CAPTURE = REPO.parent / "shared" / "captures" / "kitchen_table"
FIRST = 4
"""View 300 among the views."""
INSIDE, CONFIRMED = 0.5, 0.6


@dataclass(frozen=True)
class Row:
    """One thing in one view."""

    inside: bool  # at least half of it is before the camera, by the stated motion
    confirmed: bool  # the depth confirms the stated motion
    status: str
    off: float  # of its middle [m]
    tilt: float  # of its vertical axis [rad]
    turn: float  # of its orientation [rad]


def main(arguments: list[str]) -> None:
    """Build and print the table."""
    with tempfile.TemporaryDirectory() as scratch:
        for name, rows in measured(Path(arguments[0]) if arguments else Path(scratch) / "store").items():
            print(f"{name:12s} {told(rows)}")


def told(rows: list[Row]) -> str:
    """A row of the table."""
    tracked = [row for row in rows if row.status == "tracked"]
    sure = [row for row in tracked if row.confirmed]
    inside = [row for row in rows if row.inside]
    both = [row for row in inside if row.status == "tracked"]
    return f"before the camera {len(inside)}, tracked {len(both)}; all {_medians(tracked)}; confirmed {_medians(sure)}"


def _medians(rows: list[Row]) -> str:
    off, tilt, turn = (np.array([getattr(row, name) for row in rows]) for name in ("off", "tilt", "turn"))
    return (
        f"{len(rows)}: {1e3 * np.median(off):.1f} mm (most {1e3 * off.max():.0f}), "
        f"axis {np.degrees(np.median(tilt)):.1f} deg, turn {np.degrees(np.median(turn)):.1f} deg"
    )


def measured(store: Path) -> dict[str, list[Row]]:
    """Name -> rows of all views, of what is built in `store`."""
    project = Project.find(REPO, cache=str(store))
    inputs = {"capture": CAPTURE, "recording": CAPTURE}
    settings = {"followed.frame": FIRST, "tracks.camera": "unknown"}
    built = project.build("twin/tracked", inputs=inputs, settings=settings)
    tracking, video, support = (built.artifact(node) for node in ("tracks", "video", "ground"))
    assert isinstance(tracking, Tracking)
    assert isinstance(video, RgbdVideo)
    assert isinstance(support, Support)
    frames, found = list(video.frames()), {}
    for name in tracking.tracks:
        asset = built.artifact(f"body[{name}].asset")
        assert isinstance(asset, Asset)
        found[name] = [_row(tracking, name, asset, support, frames, number) for number in range(len(frames))]
    return found


def _row(tracking: Tracking, name: str, asset: Asset, support: Support, frames: list[RgbdFrame], number: int) -> Row:
    frame, first, track = frames[number], frames[FIRST].pose, tracking.tracks[name]
    assert frame.pose is not None
    assert first is not None
    start = transforms.invert(support.camera_pose.matrix) @ asset.pose.matrix
    stated = transforms.invert(frame.pose) @ first @ start
    mesh = asset.body.links["base"].mesh
    model, k = Model({"base": (mesh.vertices, mesh.faces)}), _matrix()
    verdict, _ = judge.look(model, Frame(frame.rgb, frame.depth, k, frame.stamp), State(stated, np.zeros(0)), Colours())
    inside, confirmed = verdict.outside < 1 - INSIDE, verdict.agreement >= CONFIRMED
    if track.status[number] == "lost":
        return Row(inside, confirmed, "lost", np.nan, np.nan, np.nan)
    made = poses.to_matrix(track.poses[number])
    middle = model.centre[None]
    return Row(
        inside,
        confirmed,
        track.status[number],
        float(np.linalg.norm(transforms.apply(made, middle) - transforms.apply(stated, middle))),
        float(np.arccos(np.clip(made[:3, 2] @ stated[:3, 2], -1, 1))),
        transforms.angle(made[:3, :3] @ stated[:3, :3].T),
    )


def _matrix() -> np.ndarray:
    import json

    said = json.loads((CAPTURE / "views.json").read_text())
    return np.array([[said["fx"], 0, said["cx"]], [0, said["fy"], said["cy"]], [0, 0, 1]])


if __name__ == "__main__":
    main(sys.argv[1:])
