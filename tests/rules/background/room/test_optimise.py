"""Gaussians of a room, optimised: what they start from, and that views from other places look better afterwards."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from dextera_build.artifacts.cameras.lens import Equirectangular
from dextera_build.artifacts.cameras.views import Views
from dextera_build.artifacts.scenes.room import Room
from dextera_build.artifacts.spatial.point_cloud import PointCloud
from dextera_build.errors import DxbError, RuleError
from dextera_build.gaussians import spherical_harmonics
from dextera_build.gaussians.arrays import Gaussians
from dextera_build.gaussians.fit.camera import FitCamera
from dextera_build.gaussians.fit.fit import Settings, fit
from dextera_build.gaussians.fit.loss import Target
from dextera_build.gaussians.fit.parameters import Trained, opened
from dextera_build.geometry import cameras
from rules.background.room import compose_gsplat
from rules.background.room.seen_depth import seen_depth
from rules.background.room.thinned import thinned
from tests.gaussians import dense_splats
from tests.rules.background.room import tiny_gsplat, world
from tests.rules.background.room.test_room import SMALL
from tests.rules.background.room.world import LENS, TABLE

SCENE = world.background()
K = np.array([[30.0, 0.0, 15.5], [0.0, 31.0, 11.5], [0.0, 0.0, 1.0]])


@pytest.fixture(scope="module")
def views(tmp_path_factory: pytest.TempPathFactory) -> Views:
    runner = world.runner(tmp_path_factory.mktemp("views") / "r")
    base = {"background": SCENE, "support": TABLE}
    panorama = runner.run("background.panorama", backend="frustum", options=SMALL, camera=LENS, **base)
    paths = runner.run("background.paths", backend="orbit", panorama=panorama, **base)
    made: Views = runner.run(
        "background.expand", backend="warp", panorama=panorama, paths=paths, background=SCENE, camera=LENS
    )
    return made


def optimised(folder: Path, views: Views, **options: float) -> tuple[Room, dict[str, tuple[float, str]]]:
    pytest.importorskip("warp", reason="warp-lang is not installed: extra `warp`")
    runner = world.runner(folder)
    room = runner.run(
        "background.compose", backend="warp", views=views, background=SCENE, options={"warp": {"steps": 40} | options}
    )
    return room, runner.outcome.metrics


@pytest.mark.slow
def test_views_that_are_held_out_look_better_afterwards(tmp_path: Path, views: Views) -> None:
    room, metrics = optimised(tmp_path / "r", views, steps=25)
    before, after = metrics["held-out views before"][0], metrics["held-out views"][0]
    assert after > before + 1.0
    assert room.splats.frame == "world"
    assert views.points is not None
    assert len(room.splats.means) == len(views.points.points)


@pytest.mark.medium
def test_the_same_call_gives_the_same_gaussians(tmp_path: Path, views: Views) -> None:
    one, other = (optimised(tmp_path / name, views, steps=6, held_out=0)[0].splats for name in ("r", "s"))
    for name in ("means", "rotations", "scales", "opacities", "harmonics"):
        assert np.array_equal(getattr(one, name), getattr(other, name)), name


@pytest.mark.slow
def test_fewer_gaussians_of_higher_degree(tmp_path: Path, views: Views) -> None:
    room, metrics = optimised(tmp_path / "r", views, most=4000, degree=2, steps=30, held_out=0)
    assert 2000 < len(room.splats.means) <= 4000
    assert room.splats.harmonics.shape[1] == 9
    assert np.abs(room.splats.harmonics[:, 1:]).max() > 0
    assert "held-out views" not in metrics


def test_a_lens_that_is_no_pinhole_is_refused(tmp_path: Path, views: Views) -> None:
    around = {"1": Equirectangular(width=LENS.width, height=LENS.height)}
    with pytest.raises(RuleError, match="pinhole"):
        optimised(tmp_path / "r", views.model_copy(update={"cameras": around}))


def test_gsplat_is_refused_without_a_gpu(tmp_path: Path, views: Views) -> None:
    with pytest.raises(DxbError) as caught:
        world.runner(tmp_path / "r").run("background.compose", backend="gsplat", views=views, background=SCENE)
    assert caught.value.code == "DXB-E301"


def small(device: str) -> Trained:
    draw = np.random.default_rng(1)
    turns = draw.normal(size=(30, 4))
    given = Gaussians(
        draw.uniform(-0.3, 0.3, (30, 3)),
        turns / np.linalg.norm(turns, axis=1, keepdims=True),
        draw.uniform(0.03, 0.12, (30, 3)),
        draw.uniform(0.2, 0.95, 30),
        0.4 * draw.normal(size=(30, 4, 3)),
    )
    return opened(given, device, 1)


def test_gsplat_is_asked_in_its_own_conventions(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "gsplat", tiny_gsplat)
    check_renders_and_fits("cpu")


@pytest.mark.skipif(not torch.cuda.is_available(), reason="gsplat needs a GPU with CUDA")
def test_gsplat_renders_as_the_dense_renderer() -> None:
    pytest.importorskip("gsplat", reason="gsplat is not installed: extra `gsplat`")
    check_renders_and_fits("cuda")


def check_renders_and_fits(device: str) -> None:
    given = small(device)
    eye = FitCamera(K, cameras.look_at(np.array([0.2, -1.0, 0.5]), np.zeros(3)), (24, 32))
    parts = (each.cpu().double() for each in given)
    wanted = dense_splats.render(*parts, k=K, pose=eye.world_from_camera, size=eye.size)
    made = compose_gsplat.rendered(given, eye)
    assert made[0].shape == (24, 32, 3)
    for found, reference in zip(made, wanted, strict=True):
        assert np.allclose(found.cpu().flatten(), reference.flatten(), atol=1e-5)
    target = Target(eye, torch.tensor(0.5, device=device).expand(24, 32, 3), None)
    fitted = fit(given, [target], compose_gsplat.rendered, Settings(20, pixel_m=0.02, mean_step=0.05, anchor=0.0))
    near, far = ((compose_gsplat.rendered(each, eye)[0] - 0.5).abs().mean() for each in (fitted, given))
    assert near < 0.95 * far


def cloud(side: int = 60) -> PointCloud:
    """A plane 1 m ahead and a wall at 4 m, both sampled once a pixel of a camera."""
    rays = cameras.rays(side, side, np.array([[side, 0, side / 2], [0, side, side / 2], [0, 0, 1.0]])).reshape(-1, 3)
    places = np.concatenate([rays, 4 * rays]).astype(np.float32)
    colours = np.concatenate([np.full((side**2, 3), 40), np.full((side**2, 3), 200)]).astype(np.uint8)
    footprint = np.repeat(np.array([1.0, 4.0], np.float32) / side, side**2)
    normals = np.tile(np.array([0, 0, -1], np.float32), (2 * side**2, 1))
    return PointCloud(
        points=places, colours=colours, normals=normals, attributes={"footprint": footprint}, frame="world"
    )


def test_points_thin_alike_near_and_far() -> None:
    given = cloud()
    few = thinned(given, 1000)
    near = few.points[:, 2] < 2
    assert 600 < len(few.points) <= 1000
    assert near.mean() == pytest.approx(0.5, abs=0.1)
    # No cell holds both surfaces.
    assert np.allclose(few.points[:, 2], np.where(near, 1, 4), atol=1e-5)
    assert few.colours is not None
    assert few.normals is not None
    assert (few.colours[near] == 40).all()
    assert (few.colours[~near] == 200).all()
    assert np.allclose(few.normals, (0, 0, -1))
    # As wide as their distance now.
    wanted = np.sqrt(len(given.points) / len(few.points)) / 60
    assert np.median(few.attributes["footprint"][near]) == pytest.approx(wanted, rel=0.5)
    assert np.array_equal(few.points, thinned(given, 1000).points)


def test_points_without_a_stated_distance_thin_too() -> None:
    given = cloud()
    few = thinned(PointCloud(points=given.points, colours=given.colours, frame="world"), 500)
    assert 100 < len(few.points) <= 500


def test_a_camera_sees_the_depth_of_the_nearest_surface_only() -> None:
    given = cloud()
    side = 60
    eye = FitCamera(np.array([[side, 0, side / 2], [0, side, side / 2], [0, 0, 1.0]]), np.eye(4), (side, side))
    assert np.allclose(seen_depth(given.points, eye), 1.0, atol=1e-5)
    # Nearer by half, the plane has gaps, through which the wall must not shine.
    pose = np.eye(4)
    pose[2, 3] = 0.5
    nearer = seen_depth(given.points, FitCamera(eye.k, pose, eye.size))
    known = nearer > 0
    assert 0.2 < known.mean() < 0.6
    assert np.allclose(nearer[known], 0.5, atol=1e-5)
    pose[2, 3] = 5.0
    assert not seen_depth(given.points, FitCamera(eye.k, pose, eye.size)).any()


def test_degrees_are_those_of_the_counts() -> None:
    assert list(compose_gsplat.DEGREES) == list(spherical_harmonics.COUNTS)
