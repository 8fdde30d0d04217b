"""Gaussians fitted to pictures, with the dense renderer of the tests."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.ndimage import correlate1d
from torch import Tensor

from dextera_build.artifacts.shapes.splats import Splats
from dextera_build.formats import splats_ply, splats_usd
from dextera_build.gaussians.arrays import Gaussians
from dextera_build.gaussians.fit.camera import FitCamera
from dextera_build.gaussians.fit.fit import Settings, fit
from dextera_build.gaussians.fit.loss import Target, loss_of, ssim
from dextera_build.gaussians.fit.parameters import Trained, closed, opened
from dextera_build.geometry import cameras, ply
from dextera_build.learning import reproducible
from tests.gaussians import dense_splats

SIZE = (24, 32)
K = np.array([[30.0, 0.0, 15.5], [0.0, 30.0, 11.5], [0.0, 0.0, 1.0]])
EYES = ((0.0, -1.0, 0.4), (0.3, -1.0, 0.5), (-0.4, -0.9, 0.3))


@pytest.fixture(autouse=True)
def _one_thread() -> Iterator[None]:
    with reproducible.one_thread():
        yield


def render(given: Trained, camera: FitCamera) -> tuple[Tensor, Tensor, Tensor]:
    doubled = [each.double() for each in given]
    colour, depth, light = dense_splats.render(*doubled, k=camera.k, pose=camera.world_from_camera, size=camera.size)
    return colour.view(*SIZE, 3).float(), depth.view(SIZE).float(), light.view(SIZE).float()


def truth(degree: int = 1, count: int = 40) -> Gaussians:
    draw = np.random.default_rng(4)
    turns = draw.normal(size=(count, 4))
    return Gaussians(
        draw.uniform(-0.3, 0.3, (count, 3)),
        turns / np.linalg.norm(turns, axis=1, keepdims=True),
        draw.uniform(0.03, 0.12, (count, 3)),
        draw.uniform(0.3, 0.95, count),
        0.4 * draw.normal(size=(count, (degree + 1) ** 2, 3)),
    )


def targets(given: Gaussians, *, depth: bool = True) -> list[Target]:
    found = []
    for eye in EYES:
        camera = FitCamera(K, cameras.look_at(np.array(eye), np.zeros(3)), SIZE)
        colour, far, light = render(opened(given, "cpu", 1), camera)
        known = torch.where(light < 0.5, far / (1 - light).clamp(min=1e-3), torch.zeros(()))
        found.append(Target(camera, colour.clamp(0, 1), known if depth else None))
    return found


def moved(given: Gaussians) -> Gaussians:
    draw = np.random.default_rng(8)
    return Gaussians(
        given.means + 0.02 * draw.normal(size=given.means.shape),
        given.rotations,
        1.2 * given.scales,
        np.full(len(given), 0.6),
        0.5 * given.harmonics[:, :1],
    )


def error(given: Trained, wanted: list[Target]) -> float:
    return float(np.mean([float((render(given, each.camera)[0] - each.pixels).abs().mean()) for each in wanted]))


def test_ssim_is_that_of_its_definition() -> None:
    draw = np.random.default_rng(0)
    one, other = draw.uniform(size=(2, *SIZE, 3))
    other = 0.6 * one + 0.4 * other
    bell = np.exp(-(np.arange(-5, 6) ** 2) / (2 * 1.5**2))
    bell /= bell.sum()

    def blurred(picture: np.ndarray) -> np.ndarray:
        down = correlate1d(picture, bell, axis=0, mode="constant")
        return correlate1d(down, bell, axis=1, mode="constant")

    x, y = blurred(one), blurred(other)
    xx, yy, xy = blurred(one**2) - x * x, blurred(other**2) - y * y, blurred(one * other) - x * y
    wanted = ((2 * x * y + 1e-4) * (2 * xy + 9e-4) / ((x * x + y * y + 1e-4) * (xx + yy + 9e-4))).mean()
    target = Target(FitCamera(K, np.eye(4), SIZE), torch.tensor(other))
    assert float(ssim(torch.tensor(one), target)) == pytest.approx(wanted, abs=1e-12)
    assert float(ssim(torch.tensor(other), target)) == pytest.approx(1.0, abs=1e-12)


def test_only_known_depth_counts_and_relative_to_itself() -> None:
    pixels = torch.zeros(*SIZE, 3)
    depth = torch.zeros(SIZE)
    depth[2, 3], depth[5, 5], depth[7, 7] = 2.0, 4.0, 3.0
    light = torch.zeros(SIZE)
    light[7, 7] = 0.9
    target = Target(FitCamera(K, np.eye(4), SIZE), pixels, depth)
    made = (pixels, torch.full(SIZE, 3.0), light)
    assert float(loss_of(made, target, 0.2, 0.0)) == pytest.approx(0.0, abs=1e-6)
    assert float(loss_of(made, target, 0.2, 0.5)) == pytest.approx(0.5 * (0.5 + 0.25) / depth.numel(), rel=1e-4)


@pytest.mark.medium
def test_fitting_brings_the_pictures_near_and_does_not_depend_on_chance() -> None:
    wanted, start = targets(truth()), opened(moved(truth()), "cpu", 1)
    told: list[int] = []
    settings = Settings(90, pixel_m=0.02, mean_step=0.2, anchor=0.0, seed=2)
    made = fit(start, wanted, render, settings, lambda step, loss: told.append(step))
    assert told == list(range(1, 91))
    assert error(made, wanted) < 0.6 * error(start, wanted)
    again = fit(start, wanted, render, settings)
    assert all(torch.equal(one, other) for one, other in zip(made, again, strict=True))
    other = fit(start, wanted, render, Settings(90, pixel_m=0.02, mean_step=0.2, anchor=0.0, seed=3))
    assert not torch.equal(made.means, other.means)
    # Every tensor took part.
    for name, before, after in zip(Trained._fields, start, made, strict=True):
        assert not torch.equal(before, after), name


@pytest.mark.medium
def test_the_anchor_holds_gaussians_where_they_began() -> None:
    wanted, start = targets(truth()), opened(moved(truth()), "cpu", 1)

    def distances(anchor: float) -> list[float]:
        made = fit(start, wanted, render, Settings(30, pixel_m=0.02, mean_step=0.2, anchor=anchor))
        return [float((one - other).norm()) for one, other in zip(made, start, strict=True)]

    free, held = distances(0.0), distances(50.0)
    assert all(near < 0.7 * far for near, far in zip(held, free, strict=True))


def test_depth_alone_moves_gaussians() -> None:
    given = truth()
    wanted = [Target(each.camera, torch.zeros(*SIZE, 3), each.depth) for each in targets(given)]
    dark = np.full((len(given), 1, 3), -9.0)
    black = Gaussians(given.means, given.rotations, given.scales, given.opacities, dark)
    start = opened(black, "cpu", 1)
    start.means.add_(torch.tensor([0.0, 0.05, 0.0]))

    def far(made: Trained) -> float:
        return float(np.mean([float(loss_of(render(made, each.camera), each, 0.2, 1.0)) for each in wanted]))

    assert far(
        fit(start, wanted, render, Settings(60, pixel_m=0.02, mean_step=0.2, anchor=0.0, depth_weight=1.0))
    ) < 0.5 * far(start)


def test_a_loss_that_is_no_number_ends_the_fit() -> None:
    wanted = targets(truth(), depth=False)
    wanted[0].pixels[3, 3] = torch.nan
    with pytest.raises(FloatingPointError, match=r"after [0-2] steps"):
        fit(opened(truth(), "cpu", 1), wanted, render, Settings(9, pixel_m=0.02))


def test_fitted_gaussians_come_back_from_ply_and_usd(tmp_path: Path) -> None:
    """Logits, logarithms and the order of the coefficients are those of the authors' file."""
    start = opened(truth(degree=3), "cpu", 3)
    start.quaternions.mul_(1.7)
    values = Splats.of(closed(start), "world")
    table, _ = ply.read(splats_ply.ply(values))
    assert np.allclose(table["opacity"], start.logits, atol=1e-5)
    for axis in range(3):
        assert np.allclose(table[f"scale_{axis}"], start.log_scales[:, axis], atol=1e-6)
        # Channel by channel.
        assert np.array_equal(table[f"f_dc_{axis}"], start.harmonics[:, 0, axis])
        for number in range(15):
            assert np.array_equal(table[f"f_rest_{15 * axis + number}"], start.harmonics[:, 1 + number, axis])
    path = tmp_path / "room.ply"
    path.write_bytes(splats_ply.ply(values))
    for file in (path, *values.save(tmp_path / "room.usdc")):
        read = Splats.load(file) if file.suffix == ".ply" else splats_usd.load(file)
        back = opened(read.gaussians, "cpu", 3)
        wanted = start._replace(quaternions=start.quaternions / start.quaternions.norm(dim=1, keepdim=True))
        for name, one, other in zip(Trained._fields, back, wanted, strict=True):
            assert torch.allclose(one, other, atol=2e-5), name
        assert read.frame == "world"


def test_opacities_at_their_ends_and_other_degrees_are_opened() -> None:
    given = truth(degree=2)
    ends = Gaussians(given.means, given.rotations, given.scales, np.linspace(0, 1, len(given)), given.harmonics)
    less, more = opened(ends, "cpu", 1), opened(ends, "cpu", 3)
    assert torch.isfinite(less.logits).all()
    assert np.allclose(less.harmonics, given.harmonics[:, :4], atol=1e-6)
    assert np.allclose(more.harmonics[:, :9], given.harmonics, atol=1e-6)
    assert not more.harmonics[:, 9:].any()
