"""Supports that are no planes are doubted, flat ones are not, with things on them and however noisy the depth is."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.cameras.camera import Capture
from dextera_build.artifacts.objects.object import Support
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.geometry import planes, raycast, transforms
from dextera_build.rule import Context
from dextera_build.testing import RuleRunner
from rules.align.support.support import SupportOptions, support
from tests import factories, tabletops

CAPTURES = Path(__file__).parents[4] / "shared" / "captures"
Field = Callable[[np.ndarray, np.ndarray], np.ndarray]


def bed(sag: float) -> Field:
    """A cushion that falls by `sag` [m] over half a metre from its middle."""
    return lambda x, y: -sag * (x**2 + y**2) / 0.25


def blanket(height: float) -> Field:
    """Waves of 0.15 m in twelve directions, `height` [m] rms."""
    rng = np.random.default_rng(1)
    ways, starts = rng.uniform(-1, 1, (12, 2)) * 2 * np.pi / 0.15, rng.uniform(0, 2 * np.pi, 12)
    return lambda x, y: height * np.sin(x[..., None] * ways[:, 0] + y[..., None] * ways[:, 1] + starts).sum(-1) / 6**0.5


def photographed(shape: Field, noise: float) -> Capture:
    """A box of 0.1 m on a support of 1 m with this shape, above a floor."""
    n = 81
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, n), np.linspace(-0.5, 0.5, n))
    grid = np.arange(n * n).reshape(n, n)
    a, b, c, d = grid[:-1, :-1], grid[:-1, 1:], grid[1:, :-1], grid[1:, 1:]
    faces = np.concatenate([np.stack(each, axis=-1).reshape(-1, 3) for each in ((a, b, c), (b, d, c))])
    corners = np.stack([x, y, shape(x, y)], axis=-1).reshape(-1, 3).astype(np.float32)
    top = Mesh(vertices=corners, faces=faces.astype(np.int32), colour=(0.65, 0.5, 0.35))
    floor = factories.box_mesh((-3, -3, -0.8), (3, 3, -0.7), colour=(0.4, 0.4, 0.4))
    thing = tabletops.box(0.1, 0.08, 0.1, (0.8, 0.2, 0.2))
    lifted = transforms.apply(factories.pose(-0.12, 0.0, float(shape(np.array(-0.12), np.array(0.0)))), thing.vertices)
    shapes = [raycast.Surface(mesh.vertices, mesh.faces, colour=mesh.colour) for mesh in (top, floor)]
    shapes.append(raycast.Surface(lifted, thing.faces, colour=thing.colour))
    lens = tabletops.LENS
    seen = raycast.render(shapes, lens.matrix(), tabletops.EYE, lens.height, lens.width)
    depth = np.where(seen.index >= 0, seen.depth, 0.0)
    depth += (depth > 0) * noise * planes.depth_sigma(depth) * np.random.default_rng(5).standard_normal(depth.shape)
    return factories.rgbd(raycast.shade(shapes, seen).astype(np.uint8), np.maximum(depth, 0).astype(np.float32), lens)


def told(capture: Capture, folder: Path) -> tuple[Support, list[str]]:
    context = Context(scratch=folder)
    found = support(context, capture.photograph, capture.measured, options=SupportOptions())
    return found, [text for text in context.outcome.warnings if "not flat" in text]


@pytest.mark.parametrize("shape", [bed(0.02), bed(0.04), blanket(0.006), blanket(0.015)])
@pytest.mark.parametrize("noise", [0.5, 2.0])
def test_a_support_that_is_no_plane_is_doubted_with_its_residual(tmp_path: Path, shape: Field, noise: float) -> None:
    found, (text,) = told(photographed(shape, noise), tmp_path)
    assert found.residual_m is not None
    assert f"{1000 * found.residual_m:.1f} mm rms" in text


@pytest.mark.parametrize("noise", [0.0, 1.0, 3.0])
def test_a_flat_support_is_not(tmp_path: Path, noise: float) -> None:
    assert told(photographed(bed(0.0), noise), tmp_path)[1] == []


def test_low_things_on_a_flat_support_do_not_count(tmp_path: Path) -> None:
    sheets = [
        (tabletops.box(0.2, 0.3, 0.012, (0.9, 0.9, 0.9)), factories.pose(x, y))
        for x in (-0.25, 0.25)
        for y in (-0.2, 0.2)
    ]
    assert told(tabletops.tabletop(*sheets).capture, tmp_path)[1] == []


@pytest.mark.medium
@pytest.mark.parametrize("name", ["table_mustard", "table_top_0", "kitchen_table", "clutter_test_51"])
def test_real_tables_are_not_doubted(tmp_path: Path, name: str) -> None:
    folder = CAPTURES / name
    if not folder.is_dir():
        pytest.skip(f"needs shared/captures/{name}")
    files = {file: (folder / file).read_bytes() for file in ("rgb.png", "depth.png", "capture.json")}
    assert told(RuleRunner(tmp_path).run("capture.folder", folder=Folder(files=files)), tmp_path)[1] == []
