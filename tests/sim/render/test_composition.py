"""Bodies among Gaussians: nearer ones hide, thin ones tint, farther ones are hidden."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.gaussians import spherical_harmonics, splatting
from dextera_build.gaussians.arrays import Gaussians
from dextera_build.sim.render import composition

CAMERA = Camera(width=120, height=80, fx=110.0, fy=112.0, cx=58.0, cy=41.0)
POSE = np.diag([1.0, 1.0, 1.0, 1.0])
"""The camera at the origin looks along z, with y down."""


def plane(depth: float, colour: tuple[float, float, float], columns: tuple[float, float], opacity: float) -> Gaussians:
    """A sheet across the picture from one column to another [px], 1 px between neighbours."""
    u, v = np.meshgrid(np.arange(*columns), np.arange(-4.0, 84.0))
    x, y = (u.ravel() - CAMERA.cx) / CAMERA.fx, (v.ravel() - CAMERA.cy) / CAMERA.fy
    means = depth * np.stack([x, y, np.ones_like(x)], axis=1)
    count = len(means)
    return Gaussians(
        means,
        np.tile([1.0, 0, 0, 0], (count, 1)),
        np.tile(depth / CAMERA.fx * np.array([0.5, 0.5, 0.05]), (count, 1)),
        np.full(count, opacity),
        spherical_harmonics.flat(np.tile(colour, (count, 1))),
    )


def joined(*parts: Gaussians) -> Gaussians:
    names = ("means", "rotations", "scales", "opacities", "harmonics")
    return Gaussians(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


@pytest.fixture(scope="module")
def bodies() -> composition.Drawn:
    """A box at 1 m, another behind the wall, and one that belongs to no body of the twin."""
    spec = mujoco.MjSpec()
    for name, place, size in (
        ("box", (0, 0, 1.05), 0.1),
        ("hidden", (0.2, 0.2, 2.2), 0.1),
        ("shelf", (-0.4, 0, 1.5), 0.1),
    ):
        body = spec.worldbody.add_body(name=name, pos=place)
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[size, size, 0.05], rgba=[0.9, 0.2, 0.1, 1])
    spec.worldbody.add_light(pos=[0, 0, 0], dir=[0, 0, 1])
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return composition.drawn(model, data, ("box", "hidden"), CAMERA, POSE)


WALL = plane(2.0, (0.1, 0.8, 0.2), (-4.0, 124.0), 0.97)
CURTAIN = plane(0.6, (0.1, 0.2, 0.9), (-4.0, 50.0), 0.97)


def test_only_named_bodies_are_drawn_with_their_depth(bodies: composition.Drawn) -> None:
    assert set(np.unique(bodies.owner)) == {-1, 0, 1}
    assert np.abs(bodies.depth_m[bodies.owner == 0] - 1.0).max() < 2e-3
    assert np.isinf(bodies.depth_m[bodies.owner < 0]).all()
    assert (bodies.owner == 0).sum() == pytest.approx(22 * 22.4, rel=0.05)


def test_the_nearest_of_bodies_and_gaussians_is_seen(bodies: composition.Drawn) -> None:
    made = composition.among(bodies, joined(WALL, CURTAIN), CAMERA, POSE).astype(int)
    columns = np.indices(made.shape[:2])[1]
    box = bodies.owner == 0
    # Gaussians reach a pixel or two beyond the curtain's edge.
    open_box, covered = box & (columns > 53), box & (columns < 48)
    assert open_box.sum() > 200
    assert covered.sum() > 5
    assert np.abs(made - bodies.rgb)[open_box].max() <= 1, "the wall behind does not shine through"
    assert np.abs(made[covered] - 255 * np.array([0.1, 0.2, 0.9])).max() < 12
    wall = (bodies.owner != 0) & (columns > 53)
    assert np.abs(made[wall] - 255 * np.array([0.1, 0.8, 0.2])).max() < 12, "what is behind the wall is hidden"


def test_thin_gaussians_tint_what_is_behind_them(bodies: composition.Drawn) -> None:
    veil = plane(0.6, (0.1, 0.2, 0.9), (-4.0, 124.0), 0.1)
    box = bodies.owner == 0
    alone = splatting.render(veil, CAMERA.matrix(), POSE, (80, 120))
    white = splatting.render(veil, CAMERA.matrix(), POSE, (80, 120), paper=1.0)
    light = white - alone
    wanted = alone + light * bodies.rgb / 255
    made = composition.among(bodies, joined(WALL, veil), CAMERA, POSE)
    assert 0.3 < light[box].mean() < 0.9
    assert np.abs(made / 255 - wanted)[box].max() < 0.5 / 255 + 1e-9


@pytest.mark.medium
def test_the_rasteriser_composes_alike(bodies: composition.Drawn) -> None:
    wp = pytest.importorskip("warp", reason="warp-lang is not installed: extra `warp`")
    from dextera_build.gaussians.fit.camera import FitCamera
    from dextera_build.gaussians.fit.parameters import opened
    from dextera_build.gaussians.rasteriser.raster import Parameters, Rasteriser

    veil = plane(0.6, (0.1, 0.2, 0.9), (-4.0, 50.0), 0.3)
    room = joined(WALL, veil)
    maker = Rasteriser()
    kinds = [wp.vec3, wp.vec4, wp.vec3, wp.float32, wp.vec3]
    given = [each.numpy() for each in opened(room, "cpu", 0)]
    arrays = Parameters(*(wp.array(each, dtype=kind, device="cpu") for each, kind in zip(given, kinds, strict=True)))
    limits = wp.array(bodies.depth_m.ravel(), dtype=wp.float32, device="cpu")
    picture = maker.forward(arrays, FitCamera(CAMERA.matrix(), POSE, (80, 120)), limits)
    behind = np.where(bodies.owner[..., None] >= 0, bodies.rgb / 255.0, 0.0).reshape(-1, 3)
    mixed = picture.colour.numpy() + picture.light.numpy()[:, None] * behind
    made = composition.among(bodies, room, CAMERA, POSE).reshape(-1, 3)
    # The rasteriser stops once too little light is left.
    assert np.abs(255 * mixed.clip(0, 1) - made).max() < 3
    assert np.abs(255 * mixed.clip(0, 1) - made)[(bodies.owner == 0).ravel()].max() < 0.6
