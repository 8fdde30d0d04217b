"""capture.file: files of other programs as artifacts; what is exported can be an input again."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dextera_build.artifacts.base import Artifact, File, Folder
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.cameras.lens import Equirectangular, KannalaBrandt
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.artifacts.spatial.point_cloud import PointCloud
from dextera_build.artifacts.spatial.track import Track
from dextera_build.errors import ArtifactError, MachineError, RuleError
from dextera_build.formats import mcap, point_cloud
from dextera_build.formats import video as video_files
from dextera_build.testing import RuleRunner
from tests import factories
from tests.artifacts.core.test_forms import same
from tests.formats.test_calibration import CAMERA, SECOND, full
from tests.formats.test_mcap import JOINTS
from tests.formats.test_panorama import PIXELS
from tests.formats.test_rig import LEFT, RIGHT, load
from tests.formats.test_track import GOOD
from tests.formats.test_trajectory import turning
from tests.formats.test_video import pixels, shown
from tests.formats.test_views import alike, encoded, views

BOX = factories.box_asset().body.links["base"].mesh
PLAIN = BOX.model_copy(update={"uv": None, "texture": None})
FISHEYE = KannalaBrandt(width=640, height=480, fx=300.0, fy=301.0, cx=320.0, cy=240.0, k1=0.01)


@pytest.fixture
def runner(tmp_path: Path) -> RuleRunner:
    return RuleRunner(tmp_path)


def opened(
    runner: RuleRunner, kind: str, file: Artifact, more: dict[str, Artifact] | None = None, **options: Any
) -> Any:
    return runner.run("capture.file", options={"type": kind, **options}, file=file, **(more or {}))


def folder(root: Path) -> Folder:
    return Folder(files={path.relative_to(root).as_posix(): path.read_bytes() for path in root.rglob("*.*")})


def meshes(scratch: Path, *meshes: Mesh) -> Folder:
    for number, mesh in enumerate(meshes):
        mesh.save(scratch / "in" / f"mesh_{number}.obj")
    return folder(scratch / "in")


@pytest.mark.parametrize("form", ["glb", "ply", "stl", "usda", "usdc"])
def test_the_format_of_a_mesh_is_known_by_its_content(runner, tmp_path, form):
    found = opened(runner, "Mesh", File.of(PLAIN.save(tmp_path / f"a.{form}")[0]))
    assert np.allclose(found.vertices[found.faces], BOX.vertices[BOX.faces])


@pytest.mark.parametrize(
    "text",
    [
        "# by hand\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
        "solid\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid",
    ],
)
def test_triangles_in_words_are_known(runner, text):
    assert len(opened(runner, "Mesh", File(data=text.encode())).faces) == 1


def test_an_unknown_format_is_refused(runner):
    with pytest.raises(RuleError, match="the format of the file is not known") as caught:
        opened(runner, "Mesh", encoded(PIXELS.pixels))
    assert caught.value.facts["begins"].startswith(r"b'\x89PNG")
    with pytest.raises(RuleError, match="the format of the file is not known"):
        opened(runner, "PointCloud", File(data=b"points"))


def test_a_mesh_is_read_with_the_files_beside_it(runner, tmp_path):
    found = opened(runner, "Mesh", meshes(tmp_path, BOX))
    assert np.array_equal(found.texture.pixels, BOX.texture.pixels)


def test_unit_and_axis_can_be_told(runner, tmp_path):
    found = opened(runner, "Mesh", File.of(BOX.save(tmp_path / "a.stl")[0]), unit_m=0.001, up="y")
    x, y, z = BOX.extent
    assert found.extent == pytest.approx(np.array([x, z, y]) / 1000)


def test_a_mesh_is_repaired(runner, tmp_path):
    file = File.of(BOX.model_copy(update={"faces": BOX.faces[1:], "uv": BOX.uv[1:]}).save(tmp_path / "a.glb")[0])
    assert not opened(runner, "Mesh", file).is_closed
    assert opened(runner, "Mesh", file, repair=True).is_closed


def test_what_stays_open_is_refused(runner, tmp_path):
    faces = np.concatenate([BOX.faces, [[0, 1, 7]]]).astype(np.int32)
    file = File.of(PLAIN.model_copy(update={"faces": faces}).save(tmp_path / "a.ply")[0])
    with pytest.raises(RuleError, match="the mesh stays open after the repair"):
        opened(runner, "Mesh", file, repair=True)


def test_a_folder_of_several_files_needs_a_name(runner, tmp_path):
    two = meshes(tmp_path, BOX, BOX)
    with pytest.raises(RuleError, match="the folder holds 2 files that can be read") as caught:
        opened(runner, "Mesh", two)
    assert caught.value.facts["files"] == "mesh_0.obj, mesh_1.obj"
    assert len(opened(runner, "Mesh", two, path="mesh_1.obj").faces) == 12
    with pytest.raises(RuleError, match=r"the folder does not hold `mesh_7\.obj`"):
        opened(runner, "Mesh", two, path="mesh_7.obj")


def test_points_are_read(runner):
    cloud = PointCloud(points=np.eye(3, dtype=np.float32), frame="map")
    read = opened(runner, "PointCloud", File(data=point_cloud.ply(cloud, text=True)))
    assert point_cloud.ply(read) == point_cloud.ply(cloud)
    assert opened(runner, "PointCloud", File(data=point_cloud.ply(cloud)), frame="world").frame == "world"


@pytest.mark.parametrize("form", ["ply", "usda"])
def test_gaussians_are_read(runner, tmp_path, form):
    made = factories.splats(4)
    found = opened(runner, "Splats", File.of(made.save(tmp_path / f"a.{form}")[0]))
    assert np.allclose(found.scales, made.scales)
    assert found.frame == "object"


@pytest.mark.parametrize("name", ["camera.yaml", "cameras.txt"])
def test_a_lens_is_read(runner, tmp_path, name):
    FISHEYE.save(tmp_path / name)
    assert opened(runner, "KannalaBrandt", File.of(tmp_path / name)) == FISHEYE


def test_a_lens_is_of_the_wanted_type(runner):
    plain = File(data=b"1 PINHOLE 640 480 300 301 320.5 240.5")
    assert opened(runner, "Camera", plain) == Camera(width=640, height=480, fx=300, fy=301, cx=320, cy=240)
    around = File(data=b"1 EQUIRECTANGULAR 640 320 640 320")
    assert opened(runner, "Equirectangular", around) == Equirectangular(width=640, height=320)
    with pytest.raises(RuleError, match="the lens is a Equirectangular, not a Camera") as caught:
        opened(runner, "Camera", around)
    assert caught.value.hint == "write `type: Equirectangular`"
    with pytest.raises(ArtifactError, match=r"`camera_info.yaml` cannot be read as ROS camera_info"):
        opened(runner, "Camera", File(data=b"\xff"))


def test_a_trajectory_and_a_track_are_read(runner, tmp_path):
    turning(covariances=True).save(tmp_path / "path.txt")
    assert same(opened(runner, "Trajectory", File.of(tmp_path / "path.txt")), turning(covariances=True))
    named = opened(runner, "Trajectory", File.of(tmp_path / "path.txt"), child="hand")
    assert (named.parent, named.child) == ("world", "hand")
    Track(**GOOD).save(tmp_path / "track.csv")
    assert same(opened(runner, "Track", File.of(tmp_path / "track.csv")), Track(**GOOD))


def test_a_recording_is_opened(runner, tmp_path):
    mcap.record(tmp_path / "a.mcap", joints={"/joint_states": JOINTS})
    file = File.of(tmp_path / "a.mcap")
    found = opened(runner, "Stream", file, topics=["/joint_states"])
    assert (mcap.joints(found, "/joint_states").positions == JOINTS.positions).all()
    with pytest.raises(RuleError, match="topic `/camera` was not recorded"):
        opened(runner, "Stream", file, topics=["/camera"])


def test_a_calibration_is_read(runner, tmp_path):
    full(camera=CAMERA).save(tmp_path / "arm.yaml")
    found = opened(runner, "Calibration", File.of(tmp_path / "arm.yaml"))
    assert found.camera == CAMERA
    assert list(found.facts()) == list(full().facts())
    CAMERA.save(tmp_path / "info.yaml")
    info = {"camera_info": File.of(tmp_path / "info.yaml")}
    assert opened(runner, "Calibration", File(data=SECOND.encode()), info).camera == CAMERA


def test_a_video_is_opened(runner, tmp_path):
    video_files.write(tmp_path / "a.mp4", map(pixels, range(12)), video_files.encoder(64, 32, 30.0))
    found = opened(runner, "Video", File.of(tmp_path / "a.mp4"))
    assert [shown(frame) for frame in found.frames([11, 4])] == [11, 4]
    with pytest.raises(ArtifactError, match="cannot be read as a video"):
        opened(runner, "Video", File(data=b"no video"))


def test_a_package_that_one_type_needs_is_missed_by_no_other(runner, tmp_path, monkeypatch):
    video_files.write(tmp_path / "a.mp4", map(pixels, range(2)), video_files.encoder(64, 32, 30.0))
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(MachineError, match="reading a Video needs `av`, which is not installed"):
        opened(runner, "Video", File.of(tmp_path / "a.mp4"))
    assert opened(runner, "Camera", File(data=b"1 PINHOLE 640 480 300 301 320.5 240.5"))


def test_views_are_read(runner, tmp_path):
    views().export(tmp_path / "out", "scene")
    alike(views(), opened(runner, "Views", folder(tmp_path / "out")))
    (tmp_path / "out" / "scene" / "transforms.json").unlink()
    found = opened(runner, "Views", folder(tmp_path / "out"), frame="room")
    assert (found.frame, found.points.frame) == ("room", "room")


def test_pictures_of_views_are_checked(runner, tmp_path):
    views().save(tmp_path / "out" / "transforms.json")
    encoded(np.zeros((2, 2, 3), np.uint8)).place(tmp_path / "out" / "images" / "left" / "1.png")
    with pytest.raises(ArtifactError, match="not have the size"):
        opened(runner, "Views", folder(tmp_path / "out"))
    with pytest.raises(RuleError, match="no picture has a pose"):
        opened(runner, "Views", Folder(files={"transforms.json": b'{"frames": []}'}))
    with pytest.raises(RuleError, match="views are a folder"):
        opened(runner, "Views", File(data=b"{}"))


def test_a_rig_is_read(runner, tmp_path):
    rig = load(tmp_path, {"cam0": LEFT, "cam1": RIGHT})
    assert opened(runner, "Rig", File.of(tmp_path / "camchain.yaml")).cameras == rig.cameras


def test_a_panorama_looks_along_x_with_z_up(runner):
    found = opened(runner, "Panorama", encoded(PIXELS.pixels))
    assert (found.image.pixels == PIXELS.pixels).all()
    ahead, up = found.pose.matrix[:3, 2], -found.pose.matrix[:3, 1]
    assert ahead.tolist() == [1, 0, 0]
    assert up.tolist() == [0, 0, 1]
    assert opened(runner, "Panorama", encoded(PIXELS.pixels), {"pose": found.pose}, frame="x").pose.parent == "world"
    with pytest.raises(RuleError, match="not twice as wide as high"):
        opened(runner, "Panorama", encoded(PIXELS.pixels[:3]))
