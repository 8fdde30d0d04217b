"""Views: COLMAP and nerfstudio agree on where a point is seen, and files hold everything."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given, settings
from scipy.spatial.transform import Rotation

from dextera_build.artifacts.base import File
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.cameras.lens import BrownConrady, Equirectangular
from dextera_build.artifacts.cameras.views import Views, encoded
from dextera_build.errors import ArtifactError
from dextera_build.formats import lens as lens_files
from dextera_build.formats import views as views_files
from dextera_build.geometry import transforms
from tests.artifacts.generated import values

CAMERA = Camera(width=8, height=6, fx=7.0, fy=7.5, cx=3.25, cy=2.75)
DISTORTED = BrownConrady(width=8, height=6, fx=7.0, fy=7.5, cx=3.25, cy=2.75, k1=-0.1, p1=0.001)


def pose(seed: int) -> np.ndarray:
    """A camera 3 m before the origin, more or less towards it."""
    random = np.random.default_rng(seed)
    turn = Rotation.from_rotvec(0.1 * random.normal(size=3)).as_matrix()
    return transforms.rigid(turn, np.array([0.0, 0.0, -3.0]) + 0.1 * random.normal(size=3))


def views(camera: Camera | BrownConrady = CAMERA, count: int = 3) -> Views:
    names = tuple(f"left/{number}.png" for number in range(count))
    random = np.random.default_rng(0)
    return Views(
        images={name: encoded(random.integers(0, 256, (6, 8, 3), dtype=np.uint8)) for name in names},
        names=names,
        camera=tuple("1" for _ in names),
        cameras={"1": camera},
        poses=np.stack([pose(number) for number in range(count)]),
    )


def alike(one: Views, other: Views) -> None:
    assert other.names == one.names
    assert np.allclose(other.poses, one.poses, atol=1e-12)
    assert other.frame == one.frame
    for name in one.names:
        assert (other.pixels(name) == one.pixels(name)).all()
        wanted, found = lens_files.numbers(one.lens(name)), lens_files.numbers(other.lens(name))
        numbers = [(*each.focal, *each.centre, *each.coefficients) for each in (wanted, found)]
        assert (found.width, found.height) == (wanted.width, wanted.height)
        if any(wanted.coefficients) or wanted.model != "brown_conrady":  # without distortion it is a pinhole
            assert found.model == wanted.model
            assert np.allclose(*numbers, rtol=1e-12, atol=1e-12)


@settings(max_examples=20)
@given(values(Views))
def test_colmap_holds_everything_but_observations(tmp_path_factory, given_views):
    root = tmp_path_factory.mktemp("colmap")
    given_views.export(root, "out")
    (root / "out" / "transforms.json").unlink(missing_ok=True)
    again = Views.load(root / "out")
    alike(given_views, again)
    assert len(again.points.points) == (0 if given_views.points is None else 2)


@pytest.mark.parametrize("camera", [CAMERA, DISTORTED])
def test_transforms_hold_everything_but_points(tmp_path, camera):
    written = views(camera).save(tmp_path / "transforms.json")
    assert written[0] == tmp_path / "transforms.json"
    assert (tmp_path / "images" / "left" / "2.png").is_file()
    alike(views(camera), Views.load(tmp_path / "transforms.json"))
    alike(views(camera), Views.load(tmp_path))


def test_colmap_sees_a_point_where_we_see_it(tmp_path):
    pycolmap = pytest.importorskip("pycolmap")
    one = views(DISTORTED)
    one.export(tmp_path, "out")
    model = pycolmap.Reconstruction()
    model.read_text(str(tmp_path / "out" / "sparse" / "0"))
    points = np.random.default_rng(1).uniform(-0.5, 0.5, (20, 3))
    for image in model.images.values():
        inside = transforms.apply(one.pose(image.name).inverse().matrix, points)
        wanted = np.array([image.project_point(point) for point in points])
        assert np.allclose(one.lens(image.name).project(inside) + 0.5, wanted, atol=1e-9)


def test_transforms_have_opengl_axes(tmp_path):
    """A nerfstudio camera at the origin with the identity looks along -z with y up."""
    views().save(tmp_path / "transforms.json")
    facts = json.loads((tmp_path / "transforms.json").read_text())
    matrix = np.array(facts["frames"][0]["transform_matrix"])
    assert np.allclose(-matrix[:3, 2], pose(0)[:3, 2])
    assert np.allclose(matrix[:3, 1], -pose(0)[:3, 1])
    assert facts["frames"][0]["cx"] == 3.75  # counted from the corner of the image


def test_a_scene_of_the_nerf_authors_is_read(tmp_path):
    (tmp_path / "train").mkdir()
    encoded(np.zeros((6, 8, 3), np.uint8)).place(tmp_path / "train" / "r_0.png")
    frame = {"file_path": "./train/r_0", "transform_matrix": np.eye(4).tolist()}
    (tmp_path / "transforms.json").write_text(json.dumps({"camera_angle_x": np.pi / 2, "frames": [frame]}))
    found = Views.load(tmp_path)
    lens = lens_files.numbers(found.lens("train/r_0.png"))
    assert np.allclose([*lens.focal, *lens.centre], [4, 4, 3.5, 2.5])
    assert np.allclose(found.pose("train/r_0.png").matrix, np.diag([1, -1, -1, 1]))


@pytest.mark.parametrize(
    ("change", "code", "said"),
    [
        ({"names": ("left/0.png",)}, "DXB-A508", "every picture needs one name"),
        ({"camera": ("1", "1", "2")}, "DXB-A509", "no camera `2`"),
        ({"poses": np.stack([2 * np.eye(4)] * 3)}, "DXB-A202", "the pose of `left/0.png` is not a rigid motion"),
    ],
)
def test_parts_that_do_not_fit_are_refused(change, code, said):
    good = {name: getattr(views(), name) for name in Views.model_fields}
    with pytest.raises(ArtifactError, match=said) as caught:
        Views(**good | change)
    assert caught.value.code == code


def test_a_picture_of_another_size_is_refused():
    one = views()
    other = one.model_copy(update={"images": one.images | {"left/1.png": encoded(np.zeros((3, 4, 3), np.uint8))}})
    with pytest.raises(ArtifactError, match="not have the size") as caught:
        other.pixels("left/1.png")
    assert caught.value.code == "DXB-A510"
    assert caught.value.facts == {"picture": "4 x 3 px", "camera": "8 x 6 px"}
    text = one.model_copy(update={"images": one.images | {"left/1.png": File(data=b"no picture")}})
    with pytest.raises(ArtifactError, match=r"`1.png` cannot be read as PNG or JPEG"):
        text.pixels("left/1.png")


FRAME = {"file_path": "a.png", "transform_matrix": np.eye(4).tolist()}
LENS = {"w": 8, "h": 6, "fl_x": 7, "cx": 4, "cy": 3}


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("{", "Expecting property name"),
        ("[]", "no list `frames`"),
        (json.dumps({"frames": [{}]}), "frame 1 has no `file_path`"),
        (json.dumps({"frames": [{"file_path": "a.png"}]}), "frame 1 has no `transform_matrix`"),
        (json.dumps({"frames": [FRAME]}), "frame 1: `w` is no finite number"),
        (json.dumps({**LENS, "w": 0, "frames": [FRAME]}), "the image is 0 x 6 px"),
        (json.dumps({**LENS, "camera_model": "THIN", "frames": [FRAME]}), "`THIN` is not one of OPENCV"),
        (json.dumps({**LENS, "k4": 0.1, "frames": [FRAME]}), "k4 is the eighth power"),
        (json.dumps({"camera_angle_x": 4, "frames": [FRAME]}), "no angle of a camera"),
    ],
)
def test_damaged_transforms_are_refused(tmp_path, text, why):
    (tmp_path / "transforms.json").write_text(text)
    with pytest.raises(ArtifactError, match=r"`transforms.json` cannot be read as transforms.json") as caught:
        Views.load(tmp_path)
    assert why in caught.value.facts["why"]


@pytest.mark.parametrize(
    ("name", "text", "why"),
    [
        ("images.txt", "1 1 0 0 0 0 0 0 1\n", "line 1: an image has 10 words, but 9"),
        ("images.txt", "1 2 0 0 0 0 0 0 1 a.png\n", "the quaternion has length 2"),
        ("images.txt", 2 * "1 1 0 0 0 0 0 0 1 a.png\n\n", "line 3: image 1 is there twice"),
        ("points3D.txt", "1 0 0 0 300 0 0 0\n", "a colour is not within 0..255"),
        ("points3D.txt", "1 0 0 0\n", "line 1: 7 finite numbers"),
    ],
)
def test_a_damaged_model_is_refused(tmp_path, name, text, why):
    views().export(tmp_path, "out")
    (tmp_path / "out" / "transforms.json").unlink()
    (tmp_path / "out" / "sparse" / "0" / name).write_text(text)
    with pytest.raises(ArtifactError, match=f"`{name}` cannot be read as COLMAP text") as caught:
        Views.load(tmp_path)
    assert why in caught.value.facts["why"]


def test_a_missing_picture_is_named(tmp_path):
    views().save(tmp_path / "transforms.json")
    (tmp_path / "images" / "left" / "1.png").unlink()
    with pytest.raises(ArtifactError, match=r"the picture `images/left/1.png` is missing") as caught:
        Views.load(tmp_path)
    assert caught.value.code == "DXB-A512"
    with pytest.raises(ArtifactError, match="no pictures with poses") as caught:
        Views.load(tmp_path / "images")
    assert caught.value.code == "DXB-A511"


def test_what_a_format_has_no_place_for_is_refused(tmp_path):
    rational = BrownConrady(width=8, height=6, fx=7.0, fy=7.5, cx=3.25, cy=2.75, k4=0.1)
    with pytest.raises(ArtifactError, match=r"cannot be written as transforms\.json") as caught:
        views(rational).save(tmp_path / "transforms.json")
    assert caught.value.code == "DXB-A507"
    assert "rational model" in caught.value.facts["why"]
    assert not any(path.name == "transforms.json" for path in views(rational).export(tmp_path, "out"))
    spaced = views(count=1).model_copy(update={"names": ("a b.png",)})
    with pytest.raises(ArtifactError, match="cannot be written as COLMAP"):
        views_files.colmap(spaced)
    mixed = views(count=2).model_copy(
        update={"camera": ("1", "2"), "cameras": {"1": CAMERA, "2": Equirectangular(width=8, height=4)}}
    )
    with pytest.raises(ArtifactError, match="cannot be written") as caught:
        views_files.transforms(mixed)
    assert "several models: EQUIRECTANGULAR, OPENCV" in caught.value.facts["why"]


def test_they_are_shown():
    assert list(views().facts())[:2] == ["3 pictures", "1 camera"]
    assert views().picture().startswith(b"\x89PNG")
