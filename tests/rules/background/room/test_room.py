"""From the cleaned photograph to Gaussians without a model; the world is known, so each step is compared with it."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.cameras.image import DepthImage
from dextera_build.artifacts.cameras.panorama import Panorama
from dextera_build.artifacts.cameras.views import Views
from dextera_build.artifacts.scenes.room import Room
from dextera_build.artifacts.spatial.point_cloud import PointCloud
from dextera_build.artifacts.spatial.trajectory import Trajectory
from dextera_build.errors import RuleError
from dextera_build.geometry import cameras, metrics, poses, transforms
from dextera_build.project import project
from dextera_build.recipe import profiles
from dextera_build.recipe.plan import Request, plan
from dextera_build.testing import RuleRunner
from rules.background.room.expand import smaller
from rules.background.room.sphere import level
from tests import factories
from tests.rules.background.room import world
from tests.rules.background.room.world import EYE, LENS, TABLE

POSE = TABLE.camera_pose.matrix
SCENE = world.background()
SMALL = {"frustum": {"height_px": 256}}


class Chain(NamedTuple):
    """What each rule returned, and how it called it."""

    panorama: Panorama
    paths: Collection[Trajectory]
    views: Views
    room: Room
    line: str


def built(runner: RuleRunner, **backends: str) -> Chain:
    base = {"background": SCENE, "support": TABLE}
    panorama = runner.run("background.panorama", backend=backends["panorama"], options=SMALL, camera=LENS, **base)
    paths = runner.run("background.paths", backend="orbit", panorama=panorama, **base)
    views = runner.run(
        "background.expand", backend=backends["expand"], panorama=panorama, paths=paths, background=SCENE, camera=LENS
    )
    room = runner.run("background.compose", backend="points", views=views, background=SCENE)
    return Chain(panorama, paths, views, room, runner.outcome.line)


@pytest.fixture(scope="module")
def chain(tmp_path_factory: pytest.TempPathFactory) -> Chain:
    return built(world.runner(tmp_path_factory.mktemp("room") / "r"), panorama="frustum", expand="warp")


def psnr(one: np.ndarray, other: np.ndarray, where: np.ndarray | None = None) -> float:
    found = metrics.psnr(one, other, np.ones(one.shape[:2], bool) if where is None else where)
    return np.inf if found is None else found


def test_the_panorama_is_level_and_shows_what_the_photograph_shows(chain: Chain) -> None:
    panorama = chain.panorama
    turn = panorama.pose.matrix[:3, :3]
    assert np.allclose(turn[:, 1], (0, 0, -1))
    assert np.allclose(panorama.pose.matrix[:3, 3], EYE)
    assert panorama.seen is not None
    # The solid angle of the photograph over that of the sphere, by counting rays of its own pixels.
    rays = cameras.rays(LENS.height, LENS.width, LENS.matrix())
    angle = (np.linalg.norm(rays, axis=-1) ** -3).sum() / (LENS.fx * LENS.fy)
    rows = np.cos((np.arange(256) + 0.5) / 256 * np.pi - np.pi / 2)
    share = (panorama.seen.mean(axis=1) * rows).sum() / rows.sum()
    assert share == pytest.approx(angle / (4 * np.pi), rel=0.02)


def test_a_known_point_is_where_the_panorama_shows_it(chain: Chain) -> None:
    spots = np.array([[0.0, 0.0, 0.0], [0.15, 0.1, 0.0], [-0.2, -0.1, 0.0]])
    local = transforms.apply(transforms.invert(chain.panorama.pose.matrix), spots)
    columns, rows = np.round(chain.panorama.lens().project(local)).astype(int).T
    assert chain.panorama.seen is not None
    assert chain.panorama.seen[rows, columns].all()
    assert np.abs(chain.panorama.image.pixels[rows, columns] - world.pattern(spots[:, :2])).max() < 10


def test_unseen_pixels_are_smooth_and_close_around_the_back(chain: Chain) -> None:
    pixels, seen = chain.panorama.image.pixels.astype(int), chain.panorama.seen
    assert seen is not None
    assert not seen[:, [0, -1]].any()
    steps = np.abs(np.diff(pixels, axis=1)).max(axis=-1)
    hidden = ~seen[:, 1:] & ~seen[:, :-1]
    assert np.quantile(steps[hidden], 0.99) < 6
    assert np.abs(pixels[:, 0] - pixels[:, -1]).max() < 6
    # A membrane invents no colour.
    low, high = pixels[seen].min(axis=0), pixels[seen].max(axis=0)
    assert ((pixels[~seen] >= low - 1) & (pixels[~seen] <= high + 1)).all()


@pytest.mark.parametrize("direction", [(0.3, 0.4, -0.2), (0.0, 0.0, -1.0)])
def test_level_is_a_rotation_that_looks_where_the_camera_does(direction: tuple[float, float, float]) -> None:
    ahead = np.array(direction) / np.linalg.norm(direction)
    side = np.cross(ahead, (0.0, 0.0, 1.0) if abs(ahead[2]) < 0.9 else (1.0, 0.0, 0.0))
    side /= np.linalg.norm(side)
    turn = level(transforms.rigid(np.stack([side, np.cross(ahead, side), ahead], axis=1), np.zeros(3)))
    assert np.allclose(turn @ turn.T, np.eye(3))
    assert np.linalg.det(turn) == pytest.approx(1.0)
    assert turn[:2, 2] @ ahead[:2] >= 0
    if abs(ahead[2]) > 0.9:
        # The top of the picture, which is -y of the camera, is ahead.
        assert np.allclose(turn[:, 2], -np.cross(ahead, side))


def test_cameras_keep_the_look_at_point_and_begin_at_the_photograph(chain: Chain) -> None:
    depth = float(np.median(SCENE.depth.depth[40:80, 54:106]))
    target = transforms.apply(POSE, np.array([0.0, 0.0, depth]))
    for path in chain.paths.items.values():
        matrices = np.array([poses.to_matrix(pose) for pose in path.poses])
        local = np.array([transforms.apply(transforms.invert(matrix), target) for matrix in matrices])
        assert np.allclose(local, (0, 0, depth), atol=1e-9)
        assert any(np.allclose(matrix, POSE) for matrix in matrices)
        assert path.length_m() > 0.1


def test_cameras_stay_clear_of_the_surface_or_there_are_none(tmp_path: Path, chain: Chain) -> None:
    given = {"panorama": chain.panorama, "background": SCENE, "support": TABLE}
    options = {"orbit": {"upwards_deg": 60.0, "cameras": 41, "clearance_m": 0.4}}
    low = world.runner(tmp_path / "r").run("background.paths", backend="orbit", options=options, **given)
    heights = low.items["upwards"].poses[:, 2]
    assert heights.min() >= 0.4
    assert len(heights) < 41
    with pytest.raises(RuleError, match="no path is free"):
        world.runner(tmp_path / "s").run(
            "background.paths", backend="orbit", options={"orbit": {"clearance_m": 5.0}}, **given
        )


def test_the_first_view_is_the_photograph(chain: Chain) -> None:
    name = chain.views.names[0]
    assert np.allclose(chain.views.pose(name).matrix, POSE)
    measured = SCENE.depth.depth > 0
    # The mesh is cut off half a cell before the end of the depth.
    inner = measured & np.roll(measured, 3, axis=0) & np.roll(measured, -3, axis=0)
    assert psnr(chain.views.pixels(name), SCENE.image.pixels, inner) > 40
    assert psnr(chain.views.pixels(name), SCENE.image.pixels) > 30


def test_a_moved_camera_sees_the_table_where_projection_puts_it(chain: Chain) -> None:
    spots = np.array([[x, y, 0.0] for x in (-0.2, 0.0, 0.2) for y in (-0.1, 0.1)])
    farthest = chain.views.names[-1]
    assert np.linalg.norm(chain.views.pose(farthest).matrix[:3, 3] - EYE) > 0.1
    for name in (chain.views.names[1], farthest):
        local = transforms.apply(transforms.invert(chain.views.pose(name).matrix), spots)
        columns, rows = np.round(LENS.project(local)).astype(int).T
        shown = chain.views.pixels(name)[rows, columns]
        assert np.abs(shown - world.pattern(spots[:, :2])).max() < 12


def test_points_are_on_the_table_or_on_the_sphere_once(chain: Chain) -> None:
    points = chain.views.points
    assert points is not None
    assert points.frame == "world"
    measured = points.attributes["measured"] > 0
    assert np.abs(points.points[measured, 2]).max() < 1e-4
    assert np.allclose(np.linalg.norm(points.points[~measured] - EYE, axis=1), 10.0, atol=1e-3)
    whole = LENS.width * LENS.height
    # The first view gives all of its pixels, others what it does not show.
    assert whole < len(points.points) < 2 * whole
    assert points.normals is not None
    assert np.allclose(points.normals[measured], (0, 0, 1), atol=1e-4)


@pytest.mark.medium
def test_gaussians_look_like_the_photograph_and_like_the_views(chain: Chain) -> None:
    seen = chain.room.splats.seen(LENS, TABLE.camera_pose).pixels
    assert psnr(seen, SCENE.image.pixels) > 28
    for name in chain.views.names[1:]:
        assert psnr(chain.room.splats.seen(LENS, chain.views.pose(name)).pixels, chain.views.pixels(name)) > 25
    assert "the first one at" in chain.line
    assert chain.line.endswith(", rgb")


def test_gaussians_of_plain_points_take_the_nearest_distance(tmp_path: Path, chain: Chain) -> None:
    corners = np.stack(np.meshgrid(np.arange(8), np.arange(8), [0.0]), axis=-1).reshape(-1, 3) * 0.05
    cloud = PointCloud(
        points=corners.astype(np.float32), colours=np.full((64, 3), (200, 40, 90), np.uint8), frame="world"
    )
    views = chain.views.model_copy(update={"points": cloud})
    room = world.runner(tmp_path / "r").run("background.compose", backend="points", views=views)
    assert np.allclose(room.splats.scales, 0.4 * 0.05, rtol=1e-5)
    plain = room.splats.harmonics[:, 0] * 0.28209479 + 0.5
    assert np.allclose(plain * 255, (200, 40, 90), atol=0.01)
    assert room.asset_source == "rgb"


def test_views_without_points_are_refused_with_the_next_step(tmp_path: Path, chain: Chain) -> None:
    views = chain.views.model_copy(update={"points": None})
    with pytest.raises(RuleError, match="the views carry no points") as caught:
        world.runner(tmp_path / "r").run("background.compose", backend="points", views=views)
    assert "backend `warp`" in str(caught.value.hint)


def test_the_camera_of_another_picture_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RuleError, match="the camera is that of another picture"):
        world.runner(tmp_path / "r").run(
            "background.panorama", backend="frustum", background=SCENE, support=TABLE, camera=factories.camera(80, 60)
        )


def test_a_smaller_camera_sees_the_same_directions() -> None:
    large = Camera(width=1280, height=720, fx=900.0, fy=905.0, cx=641.0, cy=350.0)
    small = smaller(large, 640)
    assert (small.width, small.height) == (640, 360)
    edges = np.array([[-0.5, -0.5], [1279.5, 719.5]])
    assert np.allclose(large.unproject(edges), small.unproject(np.array([[-0.5, -0.5], [639.5, 359.5]])))
    assert smaller(large, 4000) == large


def test_a_scene_without_depth_has_cameras_all_the_same(tmp_path: Path, chain: Chain) -> None:
    bare = SCENE.model_copy(update={"depth": DepthImage(depth=np.zeros((120, 160), np.float32))})
    paths = world.runner(tmp_path / "r").run(
        "background.paths", backend="orbit", panorama=chain.panorama, background=bare, support=TABLE
    )
    assert set(paths.items) == {"across", "upwards"}


def test_stubs_have_the_types_and_shapes(tmp_path: Path) -> None:
    made = built(world.runner(tmp_path / "r"), panorama="stub", expand="stub")
    assert made.panorama.seen is not None
    assert not made.panorama.seen.any()
    assert np.allclose(made.views.pose(made.views.names[0]).matrix, POSE)
    assert len(made.room.splats.means) > 0


@pytest.mark.parametrize("address", ["twin/laptop_scene", "twin/tabletop"])
def test_twins_make_the_room_for_its_target_only(tmp_path: Path, address: str) -> None:
    found = project.find(Path(__file__).parents[4])
    inputs = {"capture": str(tmp_path)} if address == "twin/tabletop" else {}
    request = Request(profiles.read("stub", None), inputs=inputs)
    graph = plan(address, found.recipe, found.library, found.root, request).graph
    made = {"panorama", "views", "gaussians"}
    assert {name for (name,) in graph.targets["room"]} == made
    assert not made & {name for name, *_ in graph.targets["default"]}
