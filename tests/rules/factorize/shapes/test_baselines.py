"""The baselines of factorize.mesh: what each is known to get right, and known to get wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.objects.object import Shape
from dextera_build.errors import RuleError
from dextera_build.geometry import metrics, solids, transforms
from dextera_build.geometry.solids import Solid
from dextera_build.testing import RuleRunner
from tests.rules.factorize.synthetic_views import fine, view

NAMES = ("bounding_box", "convex_hull", "poisson")


def turned(degrees: float) -> np.ndarray:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return transforms.rigid(np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]), np.zeros(3))


CARTON = solids.box((0.16, 0.09, 0.12), (0.0, 0.0, 0.06)).moved(turned(35.0))
POST = solids.union([solids.box((0.2, 0.2, 0.03), (0, 0, 0.015)), solids.box((0.05, 0.05, 0.2), (0, 0, 0.1))])


def mesh(tmp_path: Path, body: Solid, backend: str, **options: object) -> Shape:
    seen = view(body, fine())
    made: Shape = RuleRunner(tmp_path).run(
        "factorize.mesh", view=seen.view, measured=seen.measured, backend=backend, options=options
    )
    return made


def apart(shape: Shape, body: Solid) -> float:
    """Chamfer distance of the shape, in the world, to the body [m]."""
    assert shape.pose is not None
    own = transforms.apply(shape.pose.matrix, shape.mesh.vertices.astype(np.float64))
    points = (
        metrics.sample_surface(own, shape.mesh.faces, 4000, 0),
        metrics.sample_surface(body.vertices, body.faces, 4000, 0),
    )
    return metrics.chamfer_and_f(*points, 0.01)[0]


@pytest.mark.slow
@pytest.mark.parametrize("backend", NAMES)
def test_a_carton_is_closed_stands_and_is_near_the_truth(tmp_path: Path, backend: str) -> None:
    shape = mesh(tmp_path, CARTON, backend)
    assert shape.mesh.is_closed
    assert shape.asset_source == "rgbd"
    assert shape.hypothesis == backend
    assert apart(shape, CARTON) < {"bounding_box": 0.006, "convex_hull": 0.012, "poisson": 0.015}[backend]


@pytest.mark.slow
def test_only_the_surface_keeps_a_concave_outline(tmp_path: Path) -> None:
    volume = {
        name: Solid(made.mesh.vertices.astype(np.float64), made.mesh.faces).volume
        for name in NAMES
        for made in [mesh(tmp_path, POST, name)]
    }
    assert volume["bounding_box"] > 2.5 * POST.volume
    assert volume["poisson"] < 0.8 * volume["convex_hull"] < 0.8 * volume["bounding_box"]


@pytest.mark.parametrize("backend", NAMES)
def test_a_view_without_points_is_refused(tmp_path: Path, backend: str) -> None:
    with pytest.raises(RuleError, match=r"pixels with trusted depth, 100000 are needed"):
        mesh(tmp_path, CARTON, backend, least_points=100000)
