"""Soft light where its share is known in closed form, and the triangles that it is cast on."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.geometry import raycast, transforms
from dextera_build.geometry.raycast import Surface
from dextera_build.sim.model import tessellate
from dextera_build.sim.render import lighting, rendering

CAMERA = Camera(width=160, height=120, fx=150.0, fy=150.0, cx=79.5, cy=59.5)
# One metre above the floor, looking straight down; image right is x, image down is -y.
ABOVE = transforms.rigid(np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, 1.0]))
DOWN = np.array([0.0, 0.0, -1.0])


def quad(*corners: tuple[float, float, float]) -> Surface:
    return Surface(np.array(corners), np.array([[0, 1, 2], [0, 2, 3]]))


FLOOR = quad((-5, -5, 0), (5, -5, 0), (5, 5, 0), (-5, 5, 0))
WALL = quad((0.3, -50, 0), (0.3, 50, 0), (0.3, 50, 50), (0.3, -50, 50))


def shares(surfaces: list[Surface], **options: Any) -> tuple[np.ndarray, np.ndarray]:
    seen = raycast.render(surfaces, CAMERA.matrix(), ABOVE, CAMERA.height, CAMERA.width)
    chosen: dict[str, Any] = {"radius_rad": 0.1, "reach_m": 100.0} | options
    return lighting.light(surfaces, CAMERA, ABOVE, seen.depth, DOWN, **chosen)


@pytest.mark.medium
def test_an_empty_floor_sees_the_whole_sky_and_the_lamp() -> None:
    sky, key = shares([FLOOR])
    assert sky.shape == key.shape == (120, 160)
    np.testing.assert_array_equal(sky, 1.0)
    np.testing.assert_array_equal(key, 1.0)


def test_in_front_of_an_endless_wall_half_the_sky_is_open() -> None:
    sky, _ = shares([FLOOR, WALL])
    assert sky[20:100, 20:110].mean() == pytest.approx(0.5, abs=0.03)
    assert sky[20:100, 20:110].std() < 0.03


def test_what_lies_beyond_the_reach_does_not_darken() -> None:
    sky, _ = shares([FLOOR, WALL], reach_m=0.1)
    x = (np.arange(160) - CAMERA.cx) / CAMERA.fx
    assert sky[:, x < 0.15].min() == 1.0
    assert sky[:, (x > 0.27) & (x < 0.29)].max() < 0.8


def test_a_wide_lamp_gives_a_penumbra_of_its_width() -> None:
    high = quad((-0.2, -5, 0.5), (0.0, -5, 0.5), (0.0, 5, 0.5), (-0.2, 5, 0.5))
    # The camera stands beside the edge, so that it sees the floor under it.
    aside = ABOVE.copy()
    aside[0, 3] = 0.15
    seen = raycast.render([FLOOR, high], CAMERA.matrix(), aside, CAMERA.height, CAMERA.width)
    _, key = lighting.light([FLOOR, high], CAMERA, aside, seen.depth, DOWN, radius_rad=0.1, reach_m=1.0)
    x = 0.15 + (np.arange(160) - CAMERA.cx) / CAMERA.fx
    row = key[40:80].mean(axis=0)
    on_floor = seen.depth[60] > 0.9
    assert row[on_floor & (x > 0.065)].min() > 0.95  # the penumbra ends 0.5 m * 0.1 rad = 0.05 m from the edge
    assert 0.3 < np.interp(0.0, x[on_floor], row[on_floor]) < 0.7


def test_the_same_scene_has_the_same_light() -> None:
    first, second = shares([FLOOR, WALL]), shares([FLOOR, WALL])
    assert all(a.tobytes() == b.tobytes() for a, b in zip(first, second, strict=True))


def test_triangles_cover_the_pixels_that_mujoco_draws() -> None:
    spec = mujoco.MjSpec()
    kinds = mujoco.mjtGeom
    for number, (kind, size) in enumerate(
        [
            (kinds.mjGEOM_SPHERE, [0.08, 0, 0]),
            (kinds.mjGEOM_CAPSULE, [0.04, 0.06, 0]),
            (kinds.mjGEOM_CYLINDER, [0.05, 0.07, 0]),
            (kinds.mjGEOM_BOX, [0.05, 0.08, 0.03]),
            (kinds.mjGEOM_ELLIPSOID, [0.05, 0.09, 0.04]),
        ]
    ):
        place = [(number - 2) * 0.2, 0.05 * (-1) ** number, 0.1]
        spec.worldbody.add_geom(type=kind, size=size, pos=place, quat=[0.8, 0.3, 0.4, 0.2])
    mesh = spec.add_mesh(name="wedge")
    mesh.uservert = [0, 0, 0, 0.2, 0, 0, 0, 0.15, 0, 0, 0, 0.1]
    mesh.userface = [0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3]
    spec.worldbody.add_geom(type=kinds.mjGEOM_MESH, meshname="wedge", pos=[0.0, 0.25, 0.0], quat=[0.9, 0, 0.2, 0.1])
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    drawn = rendering.render_segmentation(model, data, CAMERA, ABOVE)
    cast = raycast.render(tessellate.surfaces(model, data), CAMERA.matrix(), ABOVE, CAMERA.height, CAMERA.width).index
    for geom in range(model.ngeom):
        one, other = drawn == geom, cast == geom
        assert (one & other).sum() / (one | other).sum() > 0.93, geom
