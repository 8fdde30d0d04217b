"""twin/tracked and twin/seen_again, with real backends, on a short drawn film of two boxes of which one is pushed."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from dextera_build.api import Project
from dextera_build.artifacts.base import Artifact
from dextera_build.artifacts.cameras.rgbd_video import RgbdFrame
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.artifacts.spatial.tracking import Tracking
from dextera_build.artifacts.table import Table
from dextera_build.geometry import poses, transforms
from tests import tabletops
from tests.benchmarks.tracking import scene
from tests.e2e.space import Space

pytestmark = pytest.mark.slow

COUNT, RATE_HZ = 6, 10.0
LAST_S = (COUNT - 1) / RATE_HZ
PUSH_M_S, TURN_DEG_S, HEADING_DEG_S = 0.08, 16.0, 4.0
SIDES_M = {"pushed": (0.06, 0.09, 0.12), "still": (0.1, 0.06, 0.07)}
MOST_OFF_M, MOST_OFF_DEG = 0.003, 3.0
COLOURS = {"pushed": (0.75, 0.1, 0.1), "still": (0.1, 0.2, 0.7)}


def pushed(time: float) -> np.ndarray:
    """T_world_object of the red box at a time [s]."""
    return scene.standing(-0.1 + PUSH_M_S * time, 0.0, 15 + TURN_DEG_S * time)


def still(time: float) -> np.ndarray:
    """The same of the blue one."""
    return scene.standing(0.12, 0.05, 40)


def camera(time: float) -> np.ndarray:
    """T_world_camera."""
    return scene.before(heading_deg=HEADING_DEG_S * time)


def written(root: Path, frames: list[RgbdFrame]) -> None:
    """The film as a folder, and its first and its last frame as captures."""
    lens = scene.CAMERA.model_dump() | {"depth_scale_m": 0.001}
    views = []
    for number, frame in enumerate(frames):
        files = {"rgb": frame.rgb[..., ::-1], "depth": np.round(1000 * frame.depth).astype(np.uint16)}
        view = {name: f"{name}_{number}.png" for name in files}
        views.append({"stamp": frame.stamp, **view})
        for name, pixels in files.items():
            data = cv2.imencode(".png", pixels)[1].tobytes()
            folders = {"film": view[name]} | ({"first": f"{name}.png"} if number == 0 else {})
            for folder, file in (folders | ({"now": f"{name}.png"} if number == COUNT - 1 else {})).items():
                (root / folder).mkdir(exist_ok=True)
                (root / folder / file).write_bytes(data)
    (root / "film/views.json").write_text(json.dumps(lens | {"views": views}))
    for folder in ("first", "now"):
        (root / folder / "capture.json").write_text(json.dumps(lens))


@pytest.fixture(scope="module")
def space(tmp_path_factory: pytest.TempPathFactory) -> Space:
    made = Space(tmp_path_factory.mktemp("project"))
    made.write("dxb.toml", 'cache = "cache"\n')
    paths = {"pushed": pushed, "still": still}
    actors = {
        name: scene.Actor({"base": tabletops.box(*SIDES_M[name], COLOURS[name])}, path) for name, path in paths.items()
    }
    film = scene.Sequence("short", actors, camera, COUNT / RATE_HZ, RATE_HZ)
    written(made.root, [frame for frame, _ in scene.frames(film)])
    return made


def made(space: Space, recipe: str, nodes: tuple[str, ...], **inputs: str) -> dict[str, Artifact]:
    """Artifacts of a build with real backends."""
    given = {name: space.root / folder for name, folder in inputs.items()}
    words = [word for name, folder in given.items() for word in ("--input", f"{name}={folder}")]
    answer = space.dxb("build", recipe, "--console", "plain", *words)
    assert answer.code == 0, answer.err[-3000:]
    project = Project.find(space.root)
    return {node: project.get(f"{recipe}:{node}", inputs=given) for node in nodes}


def test_the_things_of_a_photograph_are_tracked_through_a_film(space: Space) -> None:
    found = made(space, "twin/tracked", ("tracks",), capture="first", recording="film")["tracks"]
    assert isinstance(found, Tracking)
    for name, path in {"red_box": pushed, "blue_box": still}.items():
        track = found.tracks[name]
        assert track.status == COUNT * ("tracked",)
        for row, stamp in zip(track.poses, track.stamps, strict=True):
            way = transforms.invert(poses.to_matrix(track.poses[0])) @ poses.to_matrix(row)
            true = transforms.invert(path(0.0)) @ path(float(stamp))
            assert np.linalg.norm((row - track.poses[0])[:3]) == pytest.approx(
                np.linalg.norm(path(float(stamp))[:3, 3] - path(0.0)[:3, 3]), abs=MOST_OFF_M
            )
            assert np.degrees(transforms.angle(way[:3, :3].T @ true[:3, :3])) < MOST_OFF_DEG


def test_a_second_photograph_tells_where_the_camera_is_and_what_moved(space: Space) -> None:
    space.write("recipes/twin/mine.yaml", "extends: twin/tabletop\n")
    assert space.dxb("new", "twin", "twin/mine", "--moved-camera").code == 0
    found = made(space, "twin/mine_again", ("seen_again/camera", "seen_again/what"), capture="first", now="now")
    where, what = found["seen_again/camera"], found["seen_again/what"]
    assert isinstance(where, Pose)
    assert isinstance(what, Table)
    assert (where.parent, where.child) == ("world", "camera")
    moved = transforms.invert(camera(0.0)) @ camera(LAST_S)
    rows = {row[0]: row[1:] for row in what.rows}
    assert rows["camera"][0] == pytest.approx(1000 * np.linalg.norm(moved[:3, 3]), abs=1.0)
    assert rows["camera"][1] == pytest.approx(HEADING_DEG_S * LAST_S, abs=0.1)
    assert rows["red_box"][0] == pytest.approx(1000 * PUSH_M_S * LAST_S, abs=1000 * MOST_OFF_M)
    assert rows["red_box"][1] == pytest.approx(TURN_DEG_S * LAST_S, abs=MOST_OFF_DEG)
    assert {name: row[2] for name, row in rows.items()} == {"camera": "moved", "red_box": "moved", "blue_box": "stayed"}
