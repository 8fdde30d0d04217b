"""The rasteriser in float64 beside autograd through a dense renderer and beside finite differences."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest
import torch

from dextera_build.gaussians import splatting
from dextera_build.gaussians.arrays import Gaussians
from tests.gaussians import dense_splats

wp = pytest.importorskip("warp", reason="warp-lang is not installed: extra `warp`")
raster = pytest.importorskip("dextera_build.gaussians.rasteriser.raster")

SIZE = (37, 52)
K = np.array([[45.0, 0.0, 24.3], [0.0, 47.0, 17.2], [0.0, 0.0, 1.0]])
NAMES = ("means", "quaternions", "log_scales", "logits", "harmonics")


class Scene(NamedTuple):
    """Parameters of Gaussians, float64."""

    means: np.ndarray
    quaternions: np.ndarray
    log_scales: np.ndarray
    logits: np.ndarray
    harmonics: np.ndarray


def pose() -> np.ndarray:
    turn = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    made = np.eye(4)
    made[:3, :3], made[:3, 3] = turn, (0.3, -0.2, 0.5)
    return made


def scene(degree: int, seed: int = 0, count: int = 60) -> Scene:
    """Overlapping Gaussians, some behind the camera, some on borders of tiles, some far beside the picture."""
    draw = np.random.default_rng(seed)
    z = draw.uniform(0.6, 3.0, count)
    local = np.stack([draw.uniform(-0.7, 0.7, count) * z, draw.uniform(-0.5, 0.5, count) * z, z], axis=1)
    local[:6, 2] *= -1
    corners = np.array([(16, 16), (32, 16), (16, 32), (15.5, 31.5), (48, 36)]) - K[:2, 2]
    local[6:11, :2] = corners / (K[0, 0], K[1, 1]) * local[6:11, 2:]
    # Wide ones whose direction is beyond the limit of the linearisation, but that reach into the picture.
    local[11:14, 0] = 0.95 * local[11:14, 2]
    local[14:16, 1] = -0.7 * local[14:16, 2]
    scales = np.log(draw.uniform(0.03, 0.2, (count, 3)))
    scales[11:16] += 1.5
    logits = draw.normal(size=count) * 2
    # Opaque ones over one another, so that no light is left.
    logits[20:40] = 7.0
    scales[20:40] += 0.7
    local[20:40, :2] *= 0.3
    place = pose()
    means = local @ place[:3, :3].T + place[:3, 3]
    harmonics = draw.normal(size=(count, (degree + 1) ** 2, 3)) * 0.5
    return Scene(means, draw.normal(size=(count, 4)) * 1.7, scales, logits, harmonics)


def arrays(given: Scene, real: Any) -> Any:
    kinds = [wp.types.vector(3, real), wp.types.vector(4, real), wp.types.vector(3, real), real]
    kinds.append(wp.types.vector(3, real))
    return raster.Parameters(*(wp.array(a, dtype=kind, device="cpu") for a, kind in zip(given, kinds, strict=True)))


def camera() -> Any:
    return raster.FitCamera(K, pose(), SIZE)


def rendered(given: Scene, *, double: bool = True, threads: int = 2) -> tuple[np.ndarray, ...]:
    maker = raster.Rasteriser(double=double, threads=threads)
    picture = maker.forward(arrays(given, maker.real), camera())
    return picture.colour.numpy(), picture.depth.numpy(), picture.light.numpy()


def weights() -> tuple[np.ndarray, ...]:
    """What each number of a picture counts in the loss."""
    draw = np.random.default_rng(9)
    pixels = SIZE[0] * SIZE[1]
    return draw.normal(size=(pixels, 3)), draw.normal(size=pixels), draw.normal(size=pixels)


def gradients(given: Scene, *, double: bool = True, threads: int = 2) -> Scene:
    maker = raster.Rasteriser(double=double, threads=threads)
    parameters = arrays(given, maker.real)
    picture = maker.forward(parameters, camera())
    kinds = [wp.types.vector(3, maker.real), maker.real, maker.real]
    worth = [wp.array(w, dtype=kind, device="cpu") for w, kind in zip(weights(), kinds, strict=True)]
    into = raster.Parameters(*(wp.zeros_like(getattr(parameters, name)) for name in NAMES))
    maker.backward(picture, *worth, into)
    return Scene(*(getattr(into, name).numpy() for name in NAMES))


def by_autograd(given: Scene) -> Scene:
    tensors = [torch.tensor(each, requires_grad=True) for each in given]
    made = dense_splats.render(*tensors, k=K, pose=pose(), size=SIZE)
    sum((part * torch.tensor(w)).sum() for part, w in zip(made, weights(), strict=True)).backward()
    return Scene(*(each.grad.numpy() for each in tensors))


@pytest.mark.slow
@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_a_picture_is_that_of_the_dense_renderer(degree: int) -> None:
    given = scene(degree)
    wanted = dense_splats.render(*map(torch.tensor, given), k=K, pose=pose(), size=SIZE)
    for found, reference in zip(rendered(given), wanted, strict=True):
        assert np.abs(found - reference.numpy()).max() < 1e-12
    assert 1e-4 < rendered(given)[2].min() < 2e-4
    assert rendered(given)[2].max() > 0.3


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_gradients_are_those_of_autograd(degree: int) -> None:
    given = scene(degree)
    for name, found, wanted in zip(NAMES, gradients(given), by_autograd(given), strict=True):
        assert np.abs(found - wanted).max() < 1e-9 * np.abs(wanted).max(), name
        assert np.abs(wanted[6:]).max() > 1e-3, name


@pytest.mark.parametrize("name", NAMES)
def test_gradients_are_those_of_finite_differences(name: str) -> None:
    given, step = scene(3, seed=1), 1e-6
    found, place = getattr(gradients(given), name), NAMES.index(name)

    def loss(array: np.ndarray) -> float:
        changed = Scene(*(array if number == place else each for number, each in enumerate(given)))
        return float(sum((part * w).sum() for part, w in zip(rendered(changed), weights(), strict=True)))

    draw = np.random.default_rng(3)
    array = given[place]
    for _ in range(25):
        spot = tuple(
            int(draw.integers(6, array.shape[0])) if n == 0 else int(draw.integers(s))
            for n, s in enumerate(array.shape)
        )
        up, down = array.copy(), array.copy()
        up[spot] += step
        down[spot] -= step
        slope = (loss(up) - loss(down)) / (2 * step)
        assert found[spot] == pytest.approx(slope, rel=1e-5, abs=1e-6), spot


def test_what_is_behind_the_camera_or_nowhere_in_the_picture_has_no_gradient() -> None:
    given = scene(1)
    given.means[17] = pose()[:3, :3] @ (50.0, 0.0, 1.0) + pose()[:3, 3]
    given.logits[18] = -9.0
    for found in gradients(given):
        assert not found[:6].any()
        assert not found[17:19].any()


def test_results_do_not_depend_on_threads_and_single_precision_is_close() -> None:
    given = scene(3)
    one, many = gradients(given, double=False, threads=1), gradients(given, double=False, threads=3)
    for found, other, exact in zip(one, many, gradients(given), strict=True):
        assert np.array_equal(found, other)
        assert np.abs(found - exact).max() < 2e-3 * np.abs(exact).max()


def test_a_picture_is_that_of_the_preview_renderer_where_light_is_left() -> None:
    """`geometry.splatting` has the same constants, but never stops."""
    given = scene(2)
    turns = given.quaternions / np.linalg.norm(given.quaternions, axis=1, keepdims=True)
    opacities = 1 / (1 + np.exp(-given.logits))
    plain = Gaussians(given.means, turns, np.exp(given.log_scales), opacities, given.harmonics)
    wanted = splatting.render(plain, K, pose(), SIZE).reshape(-1, 3)
    colour, _, light = rendered(given)
    there = light > 0.02
    assert 0.2 < there.mean() < 0.9
    assert np.abs(colour - wanted)[there].max() < 1e-9


def test_without_gaussians_the_picture_is_black() -> None:
    empty = Scene(*(each[:0] for each in scene(0)))
    colour, depth, light = rendered(empty)
    assert not colour.any()
    assert not depth.any()
    assert (light == 1).all()
    hidden = Scene(*(each[:6] for each in scene(0)))
    assert (rendered(hidden)[2] == 1).all()
    assert not gradients(hidden).means.any()


def test_a_small_picture_shows_the_mean_of_what_was_measured_with_noise() -> None:
    """Without it the nearest of the sixteen Gaussians in a pixel hides the others, and the wall comes nearer."""
    draw = np.random.default_rng(3)
    column, row = (each.ravel() for each in np.meshgrid(np.arange(160.0), np.arange(120.0)))
    z = 2.0 * (1.0 + 0.01 * draw.normal(size=len(row)))
    means = np.stack([(column - 79.5) / 200 * z, (row - 59.5) / 200 * z, z], axis=1)
    turns = np.tile([1.0, 0, 0, 0], (len(z), 1))
    scales = np.repeat(np.log(0.45 * z / 200)[:, None], 3, axis=1)
    given = Scene(means, turns, scales, np.full(len(z), 3.5), np.zeros((len(z), 1, 3)))
    small = raster.FitCamera(np.array([[50.0, 0, 19.5], [0, 50.0, 14.5], [0, 0, 1]]), np.eye(4), (30, 40))
    maker = raster.Rasteriser(double=True)
    off = []
    for faded in (True, False):
        picture = maker.forward(arrays(given, maker.real), small, faded=faded)
        solid = 1 - picture.light.numpy()
        assert np.median(solid) > 0.6
        off.append(np.median(picture.depth.numpy() / solid) - 2.0)
    assert abs(off[0]) < 0.25 * abs(off[1])
    assert off[1] < -0.015
