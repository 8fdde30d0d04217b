"""evaluate.views: a twin of a known room in views that only the table reads."""

from __future__ import annotations

import io
import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image as Pillow

from dextera_build.artifacts.base import Collection, Folder
from dextera_build.artifacts.objects.object import Asset
from dextera_build.artifacts.objects.view import InstanceMap
from dextera_build.artifacts.scenes.room import Room
from dextera_build.artifacts.scenes.scene import Scene
from dextera_build.artifacts.shapes.splats import Splats
from dextera_build.artifacts.spatial.point_cloud import PointCloud
from dextera_build.artifacts.table import Table
from dextera_build.errors import RuleError
from dextera_build.gaussians.arrays import Gaussians
from dextera_build.gaussians.spherical_harmonics import flat
from dextera_build.geometry import cameras, raycast, transforms
from dextera_build.rule import Context
from dextera_build.testing import RuleRunner
from rules.background import static_planes
from rules.background.static import StaticOptions, static
from rules.evaluate import other_view
from rules.simulate.scene.scene import scene
from tests import factories

LENS = factories.camera(320, 240)
ROOM = [
    ((-0.6, -0.4, -0.03), (0.6, 0.4, 0.0), (0.66, 0.55, 0.43)),
    ((-3.0, 1.0, -0.8), (3.0, 1.1, 1.8), (0.75, 0.76, 0.74)),
    ((-0.5, 0.3, 0.0), (-0.2, 0.39, 0.3), (0.5, 0.1, 0.15)),
]
EYES = {10: (0.0, -1.1, 0.7), 20: (0.15, -1.05, 0.75), 30: (-0.2, -1.0, 0.7)}


def taken(frame: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Colours, depth [m] and T_world_camera of one of `EYES`."""
    pose = factories.look_at(EYES[frame], (0.0, 0.2, 0.0))
    meshes = [factories.box_mesh(low, high, colour) for low, high, colour in ROOM]
    surfaces = [raycast.Surface(mesh.vertices, mesh.faces, colour=mesh.colour) for mesh in meshes]
    seen = raycast.render(surfaces, LENS.matrix(), pose, LENS.height, LENS.width)
    return raycast.shade(surfaces, seen), seen.depth, pose


def file_of(pixels: np.ndarray) -> bytes:
    data = io.BytesIO()
    Pillow.fromarray(pixels).save(data, "PNG")
    return data.getvalue()


def folder(own: int = 10, **changes: bytes) -> Folder:
    facts = {name: getattr(LENS, name) for name in ("width", "height", "fx", "fy", "cx", "cy")} | {
        "depth_scale_m": 0.001
    }
    # A room of its own, which is not the twin's world.
    room = factories.pose(2.0, 1.0, 0.5, 0.7)
    files, views = {"capture.json": json.dumps(facts | {"frame": own}).encode()}, []
    for frame in EYES:
        rgb, depth, pose = taken(frame)
        files[f"{frame}.png"], files[f"{frame}.depth.png"] = file_of(rgb), file_of((1000 * depth).astype(np.uint16))
        names = {"rgb": f"{frame}.png", "depth": f"{frame}.depth.png"}
        views.append({"frame": frame, **names, "T_world_camera": (room @ pose).tolist()})
    return Folder(files={**files, "views.json": json.dumps(facts | {"views": views}).encode(), **changes})


@pytest.fixture(scope="module")
def twin(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, object], Scene]:
    rgb, depth, pose = taken(10)
    capture = factories.rgbd(rgb, depth.astype(np.float32), LENS)
    corners = np.array([[-0.55, -0.35], [0.55, -0.35], [0.55, 0.35], [-0.55, 0.35]])
    table = factories.support().model_copy(update={"camera_pose": factories.placed(pose, "camera"), "polygon": corners})
    nothing = InstanceMap(labels=np.zeros(rgb.shape[:2], np.int32), fixed=np.zeros(rgb.shape[:2], bool))
    context = Context(static_planes, static_planes.PlanesOptions(), scratch=tmp_path_factory.mktemp("room"))
    made = static(context, capture.photograph, table, nothing, capture.measured, options=StaticOptions())
    # What is below the floor hides nothing.
    below = Collection[Asset](items={"box": factories.box_asset(factories.pose(0.0, 0.0, -5.0))})
    inputs = {"photograph": capture.photograph, "measured": capture.measured, "instances": nothing}
    return inputs, scene(Context(scratch=tmp_path_factory.mktemp("scene")), below, made, table, LENS)


def rows(table: Table) -> dict[str, dict[str, float]]:
    names = [column.name for column in table.columns]
    return {str(row[0]): dict(zip(names, row, strict=True)) for row in table.rows}  # type: ignore[arg-type]


@pytest.mark.medium
def test_the_twin_is_like_the_other_views(twin: tuple[dict[str, object], Scene], tmp_path: Path) -> None:
    inputs, world = twin
    runner = RuleRunner(tmp_path)
    found = rows(runner.run("evaluate.views", backend="mujoco", scene=world, views=folder(), **inputs))
    # From its own camera, too, though what the room shows as nothing is a grey floor in the twin.
    for area, least in (("seen by the capture", 26), ("capture's camera, outside objects", 18)):
        assert found[area]["PSNR"] > least
        assert found[area]["Depth median"] < 0.004
        assert found[area]["Depth MAE"] < 0.02
    assert found["all"]["Coverage"] > 0.99
    assert {"PSNR, all", "PSNR, seen", "Coverage"} <= set(runner.outcome.metrics)


@pytest.mark.medium
def test_the_baselines_draw_the_capture_and_nothing_else(twin: tuple[dict[str, object], Scene], tmp_path: Path) -> None:
    inputs, world = twin
    given = {"scene": world, "views": folder(), **inputs}
    sheet = rows(RuleRunner(tmp_path).run("evaluate.views", backend="one_sheet", **given))
    only = {"only_drawn": True}
    splat = rows(RuleRunner(tmp_path).run("evaluate.views", backend="depth_splat", options=only, **given))
    for found in (sheet, splat):
        assert found["all"]["Coverage"] < 0.95
        assert found["seen by the capture"]["Depth median"] < 0.004
        # Equal pictures have no PSNR.
        assert found["capture's camera, outside objects"]["RGB MAE"] < 0.03
    gaps = rows(RuleRunner(tmp_path).run("evaluate.views", backend="depth_splat", **given))
    assert gaps["seen by the capture"]["PSNR"] < splat["seen by the capture"]["PSNR"] - 1


@pytest.mark.medium
def test_gaussians_are_drawn_with_the_objects(twin: tuple[dict[str, object], Scene], tmp_path: Path) -> None:
    pytest.importorskip("warp")
    inputs, world = twin
    given = {"scene": world, "views": folder(), **inputs}
    rgb, depth, _ = taken(10)
    points = transforms.apply(world.camera_pose.matrix, cameras.backproject(depth, LENS.matrix())[depth > 0])
    count = len(points)
    shapes = np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)), np.full((count, 3), 0.0025), np.full(count, 0.99)
    made = Gaussians(points, *shapes, flat(rgb[depth > 0] / 255.0))
    cloud = PointCloud(points=points.astype(np.float32), frame="world")
    room = Room(splats=Splats.of(made, "world"), points=cloud)
    found = rows(RuleRunner(tmp_path).run("evaluate.views", backend="gaussians", room=room, **given))
    assert found["capture's camera, outside objects"]["PSNR"] > 24
    assert found["seen by the capture"]["Depth median"] < 0.01
    with pytest.raises(RuleError, match="no Gaussians to draw"):
        RuleRunner(tmp_path).run("evaluate.views", backend="gaussians", **given)


@pytest.mark.slow
def test_a_twin_that_is_moved_is_worse(twin: tuple[dict[str, object], Scene], tmp_path: Path) -> None:
    inputs, world = twin
    pose = world.camera_pose.matrix.copy()
    pose[0, 3] += 0.08
    moved = world.model_copy(update={"camera_pose": factories.placed(pose, "camera")})
    right, wrong = (
        rows(RuleRunner(tmp_path).run("evaluate.views", backend="mujoco", scene=each, views=folder(), **inputs))
        for each in (world, moved)
    )
    for area in ("all", "seen by the capture"):
        assert wrong[area]["PSNR"] < right[area]["PSNR"] - 1
        assert wrong[area]["Depth MAE"] > right[area]["Depth MAE"] + 0.005


@pytest.mark.medium
def test_the_stub_draws_nothing(twin: tuple[dict[str, object], Scene], tmp_path: Path) -> None:
    inputs, world = twin
    found = rows(RuleRunner(tmp_path).run("evaluate.views", backend="stub", scene=world, views=folder(), **inputs))
    assert found["all"]["Coverage"] == 0
    assert found["all"]["Depth MAE"] is None


def test_a_pixel_is_seen_if_its_surface_is_in_the_capture() -> None:
    rgb, depth, pose = taken(10)
    _, other, there = taken(20)
    own = other_view.Own(rgb, depth, np.zeros(depth.shape, bool), LENS.matrix())
    move = np.linalg.inv(pose) @ there
    seen = other_view.seen(own, other, move, 0.05)
    assert 0.5 < seen.mean() < (other > 0).mean()
    # Some of the wall behind the red box is hidden from one eye and not from the other.
    assert (~seen & (other > 0))[:, 40:-40].sum() > 20
    assert other_view.seen(own, other, move, 1e-9).sum() < 0.02 * seen.sum(), "a tolerance that nothing keeps"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"views.json": b"{"}, "not valid JSON"),
        ({"views.json": b"[]"}, "must hold an object"),
        ({"views.json": b"{}"}, "incomplete"),
        ({"20.png": b"no picture"}, "no readable picture"),
        ({"20.png": file_of(np.zeros((10, 10, 3), np.uint8))}, "not have the size"),
        ({"capture.json": b'{"frame": 11}'}, "lacks the frame"),
    ],
)
def test_a_damaged_folder_is_refused(
    twin: tuple[dict[str, object], Scene], tmp_path: Path, changes: dict[str, bytes], message: str
) -> None:
    inputs, world = twin
    with pytest.raises(RuleError, match=message):
        RuleRunner(tmp_path).run("evaluate.views", backend="stub", scene=world, views=folder(**changes), **inputs)
