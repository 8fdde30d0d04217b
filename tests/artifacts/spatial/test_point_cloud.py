"""Point clouds: their files, their frames, and what is refused."""

from __future__ import annotations

import io

import numpy as np
import pytest
from hypothesis import given, settings
from PIL import Image as Pillow
from scipy.spatial.transform import Rotation

from dextera_build.artifacts.spatial.point_cloud import PointCloud
from dextera_build.artifacts.spatial.pose import Pose, Similarity
from dextera_build.errors import ArtifactError
from dextera_build.formats import point_cloud
from dextera_build.geometry import ply
from tests.artifacts.generated import values

RNG = np.random.default_rng(3)
UNIT = Rotation.random(50, rng=RNG).apply([0.0, 0.0, 1.0]).astype(np.float32)


def cloud(**more: object) -> PointCloud:
    points = (UNIT * np.float32(0.1)) + np.float32(1)
    return PointCloud(**{"points": points, "normals": UNIT.copy(), "frame": "object", **more})


@given(values(PointCloud))
@settings(deadline=None, max_examples=40)
def test_a_file_gives_back_what_was_saved(tmp_path_factory, made):
    folder = tmp_path_factory.mktemp("ply")
    made.save(folder / "binary.ply")
    (folder / "text.ply").write_bytes(point_cloud.ply(made, text=True))
    for name in ("binary.ply", "text.ply"):
        again = PointCloud.load(folder / name)
        assert point_cloud.ply(again) == point_cloud.ply(made)
        assert again.frame == made.frame


def test_another_program_reads_the_file(tmp_path):
    import trimesh

    colours = RNG.integers(0, 256, (50, 3), np.uint8)
    cloud(colours=colours).save(tmp_path / "a.ply")
    read = trimesh.load(tmp_path / "a.ply")
    assert np.array_equal(read.vertices, cloud().points)
    assert np.array_equal(read.colors[:, :3], colours)


def test_other_kinds_of_columns_are_understood(tmp_path):
    table = np.zeros(2, [(name, "f8") for name in ("x", "y", "z", "nx", "ny", "nz")] + [(c, "f4") for c in COLOURS])
    table["x"], table["nz"], table["red"] = [0.25, 1.5], [2.0, 0.0], [1.0, 0.5]
    (tmp_path / "a.ply").write_bytes(ply.written(table))
    read = PointCloud.load(tmp_path / "a.ply", frame="map")
    assert read.points[:, 0].tolist() == [0.25, 1.5]
    assert read.normals is not None
    assert read.normals.tolist() == [[0, 0, 1], [0, 0, 0]]
    assert read.colours is not None
    assert read.colours[:, 0].tolist() == [255, 128]
    assert read.frame == "map"


COLOURS = ("red", "green", "blue")


def columns(**kinds: tuple[str, float]) -> bytes:
    table = np.zeros(1, [(name, kind) for name, (kind, _) in kinds.items()])
    for name, (_, number) in kinds.items():
        table[name] = number
    return ply.written(table)


XYZ = dict.fromkeys("xyz", ("f8", 0.5))


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (b"no ply", "does not begin with a PLY header"),
        (columns(x=("f4", 0.0), y=("f4", 0.0)), "it has no properties `x`, `y` and `z`"),
        (columns(**XYZ | {"x": ("f8", 5123456.789)}), "so large that float32 rounds them by 0.21 m"),
        (columns(**XYZ, **dict.fromkeys(COLOURS, ("i4", 7))), "its colours are neither bytes nor numbers"),
        (columns(**XYZ, stamp=("i4", 2**24 + 1)), "property `stamp` holds whole numbers that float32 cannot hold"),
    ],
)
def test_a_file_that_does_not_fit_is_refused(tmp_path, data, why):
    (tmp_path / "a.ply").write_bytes(data)
    with pytest.raises(ArtifactError, match=r"`a\.ply` cannot be read as PLY") as caught:
        PointCloud.load(tmp_path / "a.ply")
    assert caught.value.code == "DXB-A402"
    assert why in caught.value.facts["why"]


@pytest.mark.parametrize(
    ("make", "code", "message"),
    [
        (lambda: cloud(normals=2 * UNIT), "DXB-A403", "50 of 50 are of another length than 1"),
        (lambda: cloud(attributes={"red": UNIT[:, 0].copy()}), "DXB-A404", "'red' is no free name of a PLY property"),
        (lambda: cloud(attributes={"a b": UNIT[:, 0].copy()}), "DXB-A404", "'a b' is no free name"),
        (lambda: cloud(attributes={"": UNIT[:, 0].copy()}), "DXB-A404", "'' is no free name"),
        (lambda: cloud(attributes={"a": UNIT[:3, 0].copy()}), "DXB-A105", "axis N is 3, but points says 50"),
        (lambda: cloud(frame="two\nlines"), "DXB-A101", "PointCloud.frame: String should match pattern"),
        (lambda: cloud().save("a.obj"), "DXB-A401", "`a.obj` names no file format of a PointCloud"),
        (lambda: PointCloud.load("absent.ply"), "DXB-A402", "`absent.ply` cannot be read as PLY"),
        (lambda: PointCloud.load("a.las"), "DXB-A401", "`a.las` names no file format of a PointCloud"),
        (
            lambda: cloud().moved(Pose(parent="world", child="camera", matrix=np.eye(4))),
            "DXB-A208",
            "a PointCloud in frame `object` cannot be moved by T_world_camera",
        ),
    ],
)
def test_what_does_not_fit_is_refused(make, code, message):
    with pytest.raises(ArtifactError) as caught:
        make()
    assert caught.value.code == code
    assert message in caught.value.message


def test_a_moved_cloud_moves_back():
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_rotvec([0.3, -1.0, 0.5]).as_matrix()
    matrix[:3, 3] = 1.0, 2.0, 3.0
    motion = Similarity(parent="world", child="object", matrix=matrix, scale=2.5)
    moved = cloud().moved(motion)
    assert moved.frame == "world"
    assert moved.normals is not None
    spread = np.linalg.norm(np.ptp(moved.points.astype(float), axis=0))
    assert spread > np.linalg.norm(np.ptp(cloud().points, axis=0))
    back = moved.moved(motion.inverse())
    assert np.abs(back.points - cloud().points).max() < 1e-6
    assert back.normals is not None
    assert np.abs(back.normals - UNIT).max() < 1e-6


def test_the_picture_shows_the_colours_of_the_points():
    blue = np.tile(np.array([[0, 0, 255]], np.uint8), (50, 1))
    pixels = np.asarray(Pillow.open(io.BytesIO(cloud(colours=blue).picture())))
    drawn = (pixels != 255).any(axis=2)
    assert (pixels[drawn] == [0, 0, 255]).all()
    assert 50 < drawn.sum() <= 450
    nothing = PointCloud(points=np.zeros((0, 3), np.float32))
    assert (np.asarray(Pillow.open(io.BytesIO(nothing.picture()))) == 255).all()


def test_its_line_says_what_is_known():
    said = repr(cloud(attributes={"confidence": UNIT[:, 0].copy()}))
    assert said.startswith("PointCloud(50 points, ")
    assert said.endswith("mm, normals, confidence, frame object)")


def test_it_is_exported_as_ply(tmp_path):
    assert cloud().export(tmp_path, "seen") == [tmp_path / "seen.ply"]
    assert point_cloud.ply(PointCloud.load(tmp_path / "seen.ply")) == point_cloud.ply(cloud())
