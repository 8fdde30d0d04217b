"""Backend `silhouette` of factorize.mesh: sizes and places of standing things from their outlines alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.objects.object import ScaleSource, Shape, Support
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.errors import RuleError
from dextera_build.geometry import massprops, solids
from dextera_build.geometry.solids import Solid
from dextera_build.testing import RuleRunner
from tests import object_views
from tests.rules.factorize import synthetic_views as synthetic

CAN = solids.loft(np.stack([solids.ring(0.033, 0.033, 2.0, z, 72) for z in (0.0, 0.1)]))
BOX = solids.box((0.1, 0.06, 0.14), (0.0, 0.0, 0.07))
SQUARE = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])


def looks(
    body: Solid,
    phrase: str = "thing",
    covariance: np.ndarray | None = None,
    unit: float = 1.0,
    scale: ScaleSource = "marker",
) -> dict:
    """Inputs of factorize.mesh: an exact mask and the camera's pose in units of `unit` [m]."""
    seen = synthetic.view(body, synthetic.fine())
    matrix = seen.measured.camera_pose.matrix.copy()
    matrix[:3, 3] /= unit
    pose = Pose(parent="world", child="camera", matrix=matrix, covariance=covariance)
    view = seen.view.model_copy(update={"phrase": phrase})
    return {"view": view, "support": Support(camera_pose=pose, polygon=SQUARE, scale=scale)}


def made(folder: Path, **inputs: object) -> Shape:
    shape: Shape = RuleRunner(folder).run("factorize.mesh", backend="silhouette", **inputs)
    return shape


@pytest.mark.medium
@pytest.mark.parametrize(("body", "family"), [(CAN, "cylinder"), (BOX, "box")])
def test_size_place_and_family_of_a_standing_thing(tmp_path, body, family):
    found = made(tmp_path, **looks(synthetic.placed(body, 0.08, -0.05, 25)))
    assert found.hypothesis == family
    assert found.asset_source == "rgb"
    assert found.residual_m is None
    assert np.sort(found.mesh.extent) == pytest.approx(np.sort(np.ptp(body.vertices, axis=0)), abs=0.003)
    assert found.pose.matrix[:3, 3] == pytest.approx([0.08, -0.05, 0.0], abs=0.003)


@pytest.mark.medium
def test_a_bowl_is_open_by_its_name_and_its_profile_follows_the_outline(tmp_path):
    bowl = synthetic.cup(0.045, 0.08, 0.06, 0.004, 0.006)
    found = made(tmp_path, **looks(bowl, "white bowl"))
    assert found.hollow
    assert found.mesh.extent == pytest.approx([0.16, 0.16, 0.06], abs=0.006)
    vertices = found.mesh.vertices
    base = np.linalg.norm(vertices[vertices[:, 2] < 0.002, :2], axis=1).max()
    assert base == pytest.approx(0.045, abs=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("turn_deg", [0.0, 180.0])
def test_a_handle_is_found_beside_a_mug_and_does_not_widen_it(tmp_path, turn_deg):
    found = made(tmp_path, **looks(synthetic.placed(object_views.mug(), 0.0, 0.0, turn_deg), "blue mug"))
    vertices = found.mesh.vertices
    assert found.hollow
    assert found.mesh.extent[2] == pytest.approx(0.09, abs=0.005)
    assert np.ptp(vertices[:, 1]) == pytest.approx(0.08, abs=0.005)
    # It reaches 70 mm from the axis, on the side where it is seen, in a frame that is not turned.
    side = vertices[:, 0] if turn_deg == 0.0 else -vertices[:, 0]
    assert (side.max(), -side.min()) == pytest.approx((0.07, 0.04), abs=0.005)
    # Vertices - edges + faces = 2 - 2 genus: the handle is a loop.
    assert len(np.unique(found.mesh.faces)) - len(found.mesh.faces) // 2 == 0
    assert found.pose.covariance[5, 5] > 0.3**2


@pytest.mark.slow
def test_the_tilt_of_the_camera_widens_the_interval_of_the_size(tmp_path):
    covariance = np.zeros((6, 6))
    covariance[3, 3] = np.radians(10.0) ** 2
    sure, unsure = made(tmp_path, **looks(CAN)), made(tmp_path, **looks(CAN, covariance=covariance))
    assert unsure.size_sigma > 1.5 * sure.size_sigma
    assert unsure.mesh.extent == pytest.approx(sure.mesh.extent)


@pytest.mark.slow
def test_any_unit_of_length_gives_the_same_thing(tmp_path):
    metres, halves = made(tmp_path, **looks(BOX)), made(tmp_path, **looks(BOX, unit=0.5))
    assert halves.mesh.extent == pytest.approx(2 * metres.mesh.extent, rel=0.03)


def volume(shape: Shape) -> float:
    """[m^3]."""
    return massprops.of_mesh(shape.mesh.vertices, shape.mesh.faces).volume


@pytest.mark.medium
def test_a_vessel_of_unknown_scale_has_the_walls_of_one_of_usual_size(tmp_path):
    """A wall of 3 mm was 3 thousandths of whatever the unit was, the height of the camera: a mug weighed 62 g."""
    cup = synthetic.cup(0.03, 0.04, 0.09, 0.004, 0.006)
    shapes = [made(tmp_path, **looks(cup, "mug", unit=unit, scale="unknown")) for unit in (1.0, 0.4)]
    volumes = [volume(shape) for shape in shapes]
    assert volumes[1] == pytest.approx(volumes[0] / 0.4**3, rel=0.05)
    known = volume(made(tmp_path, **looks(cup, "mug")))
    assert volumes[0] == pytest.approx(known, rel=0.4)


def test_without_a_support_or_above_the_horizon_the_error_says_so(tmp_path):
    inputs = looks(CAN)
    with pytest.raises(RuleError, match="the camera's pose over the support is not given"):
        made(tmp_path, view=inputs["view"])
    level = inputs["support"].camera_pose.matrix.copy()
    level[:3, :3] = np.column_stack([[1, 0, 0], [0, 0.6, -0.8], [0, 0.8, 0.6]])
    pose = inputs["support"].camera_pose.model_copy(update={"matrix": level})
    with pytest.raises(RuleError, match="the lowest point of the mask is not on the support"):
        made(tmp_path, view=inputs["view"], support=inputs["support"].model_copy(update={"camera_pose": pose}))
