"""plyfile reads exported points, Gaussians and meshes, and finds what was written."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.artifacts.spatial.point_cloud import PointCloud
from dextera_build.formats import point_cloud
from tests import factories, readers

pytestmark = pytest.mark.slow
COUNT = 200


@pytest.fixture(scope="module")
def cloud() -> PointCloud:
    rng = np.random.default_rng(5)
    normals = rng.normal(size=(COUNT, 3))
    return PointCloud(
        points=rng.normal(size=(COUNT, 3)).astype(np.float32),
        normals=(normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32),
        colours=rng.integers(0, 256, (COUNT, 3), np.uint8),
        attributes={"confidence": rng.random(COUNT).astype(np.float32)},
        frame="world",
    )


@pytest.fixture(scope="module")
def mesh() -> Mesh:
    return factories.laptop_asset().body.links["base"].mesh


@pytest.fixture(scope="module")
def found(cloud: PointCloud, mesh: Mesh, tmp_path_factory: pytest.TempPathFactory) -> dict[str, np.ndarray]:
    folder = tmp_path_factory.mktemp("written")
    cloud.save(folder / "binary.ply")
    (folder / "text.ply").write_bytes(point_cloud.ply(cloud, text=True))
    factories.splats(COUNT).save(folder / "splats.ply")
    mesh.save(folder / "mesh.ply")
    script = Path(__file__).parent / "plyfile_reader.py"
    readers.run("geometry", script, folder, folder / "found.npz")
    return dict(np.load(folder / "found.npz"))


def columns(found: dict[str, np.ndarray], of: str, *names: str) -> np.ndarray:
    return np.stack([found[f"{of}/{name}"] for name in names], axis=1)


@pytest.mark.parametrize("file", ["binary.ply", "text.ply"])
def test_points_have_their_normals_colours_and_attributes(
    found: dict[str, np.ndarray], cloud: PointCloud, file: str
) -> None:
    of = f"{file}/vertex"
    np.testing.assert_array_equal(columns(found, of, "x", "y", "z"), cloud.points)
    np.testing.assert_array_equal(columns(found, of, "nx", "ny", "nz"), cloud.normals)
    colours = columns(found, of, "red", "green", "blue")
    np.testing.assert_array_equal(colours, cloud.colours)
    assert colours.dtype == np.uint8
    np.testing.assert_array_equal(found[f"{of}/confidence"], cloud.attributes["confidence"])
    assert any("world" in comment for comment in found[f"{file}/comments"])


def test_gaussians_have_the_parameters_of_the_authors_code(found: dict[str, np.ndarray]) -> None:
    splats, of = factories.splats(COUNT), "splats.ply/vertex"
    np.testing.assert_array_equal(columns(found, of, "x", "y", "z"), splats.means)
    np.testing.assert_array_equal(columns(found, of, "rot_0", "rot_1", "rot_2", "rot_3"), splats.rotations)
    scales = np.exp(columns(found, of, "scale_0", "scale_1", "scale_2").astype(np.float64))
    np.testing.assert_allclose(scales, splats.scales, rtol=1e-5)
    opacities = 1 / (1 + np.exp(-found[f"{of}/opacity"].astype(np.float64)))
    np.testing.assert_allclose(opacities, splats.opacities, atol=1e-6)
    np.testing.assert_array_equal(columns(found, of, "f_dc_0", "f_dc_1", "f_dc_2"), splats.harmonics[:, 0])
    rest = columns(found, of, *(f"f_rest_{number}" for number in range(45)))
    np.testing.assert_array_equal(rest.reshape(COUNT, 3, 15).swapaxes(1, 2), splats.harmonics[:, 1:])


def test_a_mesh_has_its_triangles(found: dict[str, np.ndarray], mesh: Mesh) -> None:
    corners = columns(found, "mesh.ply/vertex", "x", "y", "z")
    (name,) = (name for name in found if name.startswith("mesh.ply/face/") and found[name].ndim == 2)
    np.testing.assert_array_equal(corners[found[name]], mesh.vertices[mesh.faces])
