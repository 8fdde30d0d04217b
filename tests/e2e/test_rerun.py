"""`dxb view --save FILE.rrd`: Rerun reads the bodies, their motion, and the cameras with their pictures."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from dextera_build.api import Project
from dextera_build.artifacts.tasks.episode import Film
from dextera_build.geometry import transforms
from tests import episodes
from tests.e2e.recordings import Columns, saved
from tests.e2e.robots import STORED, stored
from tests.e2e.space import Space

pytestmark = pytest.mark.slow

RECIPE = """
summary: Episodes that a camera filmed.
inputs:
  task_file: data/task.json
  episodes_file: data/episodes.json
  view_file: data/view.json
nodes:
  task: {rule: demo.task, stored: $task_file}
  episodes: {rule: demo.episodes, stored: $episodes_file, bundle: $task}
  view: {rule: demo.view, stored: $view_file}
  front: {rule: demonstrate.film, bundle: $task, episodes: $episodes, view: $view}
targets:
  default: [front]
"""
KINDS = {
    "task": ("tasks.task", "TaskBundle"),
    "episodes": ("tasks.episode", "Episodes"),
    "view": ("tasks.task", "View"),
}
STEPS = 12
RATE_HZ = 20


@pytest.fixture(scope="module")
def space(tmp_path_factory: pytest.TempPathFactory) -> Space:
    pytest.importorskip("viser", reason="needs viser (extra `view`)")
    space = Space(tmp_path_factory.mktemp("shown"))
    space.write("dxb.toml", 'cache = "cache"\n')
    space.write("recipes/task/shown.yaml", RECIPE)
    values = {"task": episodes.bundle(), "episodes": episodes.small(2, STEPS), "view": episodes.view(96, 64)}
    for name, (module, kind) in KINDS.items():
        text = STORED.replace("NAME", name).replace("tasks.task", module).replace("KIND", kind)
        if name == "episodes":  # they belong to the task from which they were made
            text = text.replace("stored: File, ", "stored: File, bundle: TaskBundle, ")
            text = text.replace(
                "import json\n", "import json\nfrom dextera_build.artifacts.tasks.task import TaskBundle\n"
            )
        space.write(f"rules/demo/{name}.py", text.lstrip())
        space.write(f"data/{name}.json", stored(values[name]))
    done = space.dxb("build", "task/shown")
    assert done.code == 0, done.err
    return space


def test_an_episode_has_its_bodies_their_motion_and_the_pictures(space: Space, tmp_path: Path) -> None:
    found = saved(space, "task/shown:episodes", tmp_path, "--episode", "1")
    episode, body = episodes.small(2, STEPS).items["1"], "/episodes/box"
    places = {time: row[0] for time, row in moves(found, f"{body} Transform3D:translation")}
    assert max(places) == pytest.approx((STEPS - 1) / RATE_HZ)
    base = episodes.bundle().base_pose.matrix
    for step, pose in enumerate(episode.objects[:, 0]):
        wanted = transforms.apply(base, pose[:3].astype(float))
        np.testing.assert_allclose(at(places, step / RATE_HZ), wanted, atol=1e-5)
    corners = np.array(found[f"{body}/visual_0 Mesh3D:vertex_positions"][0])
    np.testing.assert_allclose(np.abs(corners).max(axis=0), episodes.BOX_HALF_M, atol=1e-6)
    assert {"/episodes/robot/link_3", "/episodes/case_lid"} <= {name.partition(" ")[0] for name in found}
    check_pictures(space, found)


def moves(found: Columns, column: str) -> list[tuple[float, list[list[float]]]]:
    times = found[f"{column.partition(' ')[0]} time"]
    return [(float(time), row) for time, row in zip(times, found[column], strict=True) if row is not None]


def at(places: dict[float, list[float]], seconds: float) -> list[float]:
    """The latest value at a time."""
    return places[max(time for time in places if time <= seconds + 1e-6)]


def check_pictures(space: Space, found: Columns) -> None:
    view, eye = episodes.view(96, 64), "/cameras/front"
    film = Project.find(space.root).get("task/shown:front")
    assert isinstance(film, Film)
    pictures = moves(found, f"{eye}/picture EncodedImage:blob")
    assert [time for time, _ in pictures] == pytest.approx([step / RATE_HZ for step in range(STEPS)])
    for (_, row), pixels in zip(pictures, film.each("1"), strict=True):
        shown = np.asarray(Image.open(io.BytesIO(bytes(row[0]))), float)
        assert np.abs(shown - pixels).mean() < 4
    assert found[f"{eye} Pinhole:resolution"][0][0] == [96.0, 64.0]
    columns = np.array(found[f"{eye} Pinhole:image_from_camera"][0][0]).reshape(3, 3)
    np.testing.assert_allclose(columns.T[:2, :2], view.camera.matrix()[:2, :2], rtol=1e-6)
    np.testing.assert_allclose(columns.T[:2, 2], view.camera.matrix()[:2, 2] + 0.5, rtol=1e-6)
    np.testing.assert_allclose(found[f"{eye} Transform3D:translation"][0][0], view.camera_pose.matrix[:3, 3], rtol=1e-6)
