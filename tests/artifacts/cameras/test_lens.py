"""Lenses: the same pixels as OpenCV and COLMAP, inverses, and files that other programs read."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image as Pillow

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.cameras.lens import BrownConrady, Equirectangular, KannalaBrandt
from dextera_build.errors import ArtifactError
from dextera_build.formats import colmap, registry
from dextera_build.formats import lens as lens_files

cv2 = pytest.importorskip("cv2")
SIZE = {"width": 640, "height": 480}
BASE = {**SIZE, "fx": 512.0, "fy": 498.5, "cx": 322.25, "cy": 237.75}
SMALL = st.floats(-0.02, 0.02)
RADIAL = st.floats(-0.25, 0.25)


@st.composite
def brown_conrady(draw: Any, *, rational: bool = False) -> BrownConrady:
    fields = {"k1": draw(RADIAL), "k2": draw(SMALL), "p1": draw(SMALL) / 10, "p2": draw(SMALL) / 10, "k3": draw(SMALL)}
    if rational:
        fields |= {"k4": draw(RADIAL), "k5": draw(SMALL), "k6": draw(SMALL)}
    return BrownConrady(**BASE, **fields)


@st.composite
def kannala_brandt(draw: Any) -> KannalaBrandt:
    return KannalaBrandt(**BASE, **{name: draw(SMALL) for name in ("k1", "k2", "k3", "k4")})


LENSES = (
    brown_conrady()
    | brown_conrady(rational=True)
    | kannala_brandt()
    | st.just(Camera(**BASE))
    | st.just(Equirectangular(width=640, height=320))
)


def points(count: int = 50) -> np.ndarray:
    """Within 35 degrees of the axis, at different depths."""
    random = np.random.default_rng(3)
    plane = random.uniform(-0.5, 0.5, (count, 2))
    depth = random.uniform(0.3, 5.0, (count, 1))
    return np.hstack([plane * depth, depth])


@pytest.mark.medium
@given(brown_conrady() | brown_conrady(rational=True))
def test_brown_conrady_gives_the_pixels_of_opencv(lens):
    k = np.array([[lens.fx, 0, lens.cx], [0, lens.fy, lens.cy], [0, 0, 1]])
    wanted = cv2.projectPoints(points(), np.zeros(3), np.zeros(3), k, lens.coefficients())[0].reshape(-1, 2)
    found = lens.project(points())
    seen = np.isfinite(found).all(axis=1)
    assert seen.sum() > 25
    assert np.allclose(found[seen], wanted[seen], atol=1e-9)
    normal = cv2.undistortPointsIter(
        wanted[seen], k, lens.coefficients(), None, None, (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 200, 1e-12)
    )[:, 0]
    rays = lens.unproject(wanted[seen])
    again = cv2.projectPoints(
        np.column_stack([normal, np.ones(len(normal))]), np.zeros(3), np.zeros(3), k, lens.coefficients()
    )[0].reshape(-1, 2)
    solved = np.abs(again - wanted[seen]).max(axis=1) < 1e-8  # OpenCV's iteration does not always converge
    assert np.allclose((rays[:, :2] / rays[:, 2:])[solved], normal[solved], atol=1e-6)


@given(kannala_brandt())
def test_kannala_brandt_gives_the_pixels_of_opencv(lens):
    k = np.array([[lens.fx, 0, lens.cx], [0, lens.fy, lens.cy], [0, 0, 1]])
    wanted = cv2.fisheye.projectPoints(points()[None], np.zeros(3), np.zeros(3), k, lens.coefficients())[0][0]
    assert np.allclose(lens.project(points()), wanted, atol=1e-9)
    done = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 100, 1e-12)
    normal = cv2.fisheye.undistortPoints(wanted[None], k, lens.coefficients(), R=np.eye(3), criteria=done)[0]
    rays = lens.unproject(wanted)
    assert np.allclose(rays[:, :2] / rays[:, 2:], normal, atol=1e-6)


@given(LENSES)
def test_unproject_is_the_inverse_of_project(lens):
    wanted = points() / np.linalg.norm(points(), axis=1, keepdims=True)
    pixels = lens.project(points())
    seen = np.isfinite(pixels).all(axis=1)
    assert seen.sum() > 25
    assert np.allclose(lens.unproject(pixels[seen]), wanted[seen], atol=1e-8)


@given(LENSES, st.floats(0, 639), st.floats(0, 479))
def test_project_is_the_inverse_of_unproject(lens, u, v):
    pixel = np.array([[u, v * lens.height / 480]])
    ray = lens.unproject(pixel)
    assert np.isnan(ray).all() or np.allclose(np.linalg.norm(ray, axis=1), 1)
    again = lens.project(ray)
    # One edge of what is seen may fall on either side by rounding.
    assert np.isnan(again).any() or np.allclose(again, pixel, atol=1e-5)


def test_a_lens_is_nan_where_it_does_not_see():
    folded = BrownConrady(**BASE, k1=-0.4)
    limit = 1 / np.sqrt(1.2)  # d/dr (r - 0.4 r^3) = 0
    just, beyond = folded.project(np.array([[limit - 1e-6, 0, 1], [limit + 1e-6, 0, 1]]))
    assert np.isfinite(just).all()
    assert np.isnan(beyond).all()
    edge = BASE["cx"] + BASE["fx"] * (limit - 0.4 * limit**3)
    inside, outside = folded.unproject(np.array([[edge - 1, BASE["cy"]], [edge + 1, BASE["cy"]]]))
    assert np.isfinite(inside).all()
    assert np.isnan(outside).all()
    assert np.isnan(folded.project(np.array([[0.0, 0.0, -1.0]]))).all()
    assert np.isnan(Camera(**BASE).project(np.array([[0.0, 0.0, -1.0]]))).all()
    fisheye = KannalaBrandt(**BASE)
    assert np.isfinite(fisheye.project(np.array([[1.0, 0.0, -1.0]]))).all()
    assert np.isnan(fisheye.unproject(np.array([[BASE["cx"] + 3.2 * BASE["fx"], 0.0]]))).all()


def test_a_panorama_covers_the_sphere():
    lens = Equirectangular(width=8, height=4)
    ahead, right, down, back = lens.project(np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0], [-1e-9, 0, -1]], float))
    assert np.allclose(ahead, [3.5, 1.5])
    assert np.allclose(right, [5.5, 1.5])
    assert np.isclose(down[1], 3.5)
    assert np.isclose(back[0], -0.5)
    assert np.isnan(lens.unproject(np.array([[0.0, 4.0]]))).all()


@given(LENSES)
def test_colmap_reads_the_same_camera(lens):
    pycolmap = pytest.importorskip("pycolmap")
    words = colmap.cameras_written({7: lens_files.numbers(lens)}).splitlines()[-1].split()
    theirs = pycolmap.Camera(
        model=words[1], width=int(words[2]), height=int(words[3]), params=[float(word) for word in words[4:]]
    )
    found = lens.project(points())
    seen = np.isfinite(found).all(axis=1)
    wanted = np.array([theirs.img_from_cam(point) for point in points()[seen]])
    assert np.allclose(found[seen] + 0.5, wanted, atol=1e-6)  # COLMAP counts from the image's corner


@pytest.mark.medium
@given(lens=LENSES, suffix=st.sampled_from([".yaml", ".txt"]))
def test_a_camera_is_read_back_from_its_files(tmp_path_factory, lens, suffix):
    if suffix not in registry.suffixes(type(lens)):
        return
    path = tmp_path_factory.mktemp("lens") / f"camera{suffix}"
    assert lens.save(path) == [path]
    again = lens_files.load(path)
    if isinstance(lens, BrownConrady) and not lens.coefficients().any() and suffix == ".yaml":
        assert again == Camera(**BASE)  # in ROS a lens without distortion is `plumb_bob` with zeros
    else:
        assert type(again) is type(lens)
        assert np.allclose([*again.model_dump().values()], [*lens.model_dump().values()], rtol=0, atol=1e-12)


def test_the_camera_info_of_a_driver_is_read(tmp_path):
    """As `ros2 topic echo /camera/camera_info` prints it."""
    path = tmp_path / "info.yaml"
    path.write_text(
        "header: {frame_id: camera_color_optical_frame}\nheight: 480\nwidth: 640\n"
        "distortion_model: plumb_bob\nd: [0.1, -0.2, 0.001, 0.002, 0.03]\n"
        "k: [600.0, 0.0, 320.0, 0.0, 601.0, 240.0, 0.0, 0.0, 1.0]\n"
    )
    lens = lens_files.load(path)
    assert lens == BrownConrady(**SIZE, fx=600, fy=601, cx=320, cy=240, k1=0.1, k2=-0.2, p1=0.001, p2=0.002, k3=0.03)


GOOD = (
    "image_width: 640\nimage_height: 480\ncamera_matrix: {data: [5, 0, 3, 0, 5, 2, 0, 0, 1]}\n"
    "distortion_model: plumb_bob\ndistortion_coefficients: {data: [0.1, 0, 0, 0, 0]}\n"
)


def tenfold(form: str) -> str:
    """YAML in which each line stands for ten times the one above."""
    lines = [form.format(", ".join([f"*a{number - 1}"] * 10)) for number in range(1, 10)]
    return "a0: &a0 {b: 1}\n" + "".join(f"a{number}: &a{number} {line}\n" for number, line in enumerate(lines, 1))


@pytest.mark.parametrize(
    ("name", "text", "why"),
    [
        ("a.yaml", "{", "it is not YAML, line"),
        ("a.yaml", "[1]", "no mapping"),
        ("a.yaml", "", "no mapping"),
        ("a.yaml", GOOD + "#" * (1 << 18), "characters, but at most 262,144 are read"),
        ("a.yaml", tenfold("[{}]") + GOOD, "its aliases stand for at least 311,111 values"),
        ("a.yaml", tenfold("{{<<: [{}]}}") + GOOD, "but at most 100,000 are read"),
        ("a.yaml", "a: &a [*a]\n" + GOOD, "its aliases stand for at least 100,001 values"),
        ("a.yaml", GOOD.replace("image_width: 640", ""), "no field `image_width`"),
        ("a.yaml", GOOD.replace("640", "-640"), "width is no positive whole number"),
        ("a.yaml", GOOD.replace("[5, 0", "[5, 1"), "not [fx 0 cx; 0 fy cy; 0 0 1]"),
        ("a.yaml", GOOD.replace("[5, 0", "[.nan, 0"), "no finite number"),
        ("a.yaml", GOOD.replace("0, 0, 1]", "0, 1]"), "8 numbers instead of 9"),
        ("a.yaml", GOOD.replace("{data: [0.1, 0, 0, 0, 0]}", "nothing"), "no list of numbers"),
        ("a.yaml", GOOD.replace("plumb_bob", "thin_prism"), "not one of plumb_bob"),
        ("a.yaml", GOOD.replace("0.1, 0, 0, 0, 0", "0.1, 0, 0, 0, 0, 1"), "takes 5 coefficients"),
        ("a.txt", "1 THIN_PRISM_FISHEYE 640 480 1 2 3", "line 1: the camera's model is not one of"),
        ("a.txt", "# c\n1 PINHOLE 640 480 1 2 3", "line 2: PINHOLE takes 4 parameters, but 3"),
        ("a.txt", "1 PINHOLE 640 480 1 2 3 x", "line 1: a word after 4 is no number"),
        ("a.txt", "1 PINHOLE 640 480 1 2 3 inf", "line 1: 4 finite numbers"),
        ("a.txt", "1 PINHOLE 640 0 1 2 3 4", "the image is 640 x 0 px"),
        ("a.txt", "1 PINHOLE wide 480 1 2 3 4", "word 3 is no whole number"),
        ("a.txt", "", "0 cameras instead of one"),
        ("a.txt", 2 * "1 SIMPLE_PINHOLE 640 480 1 2 3\n", "line 2: camera 1 is there twice"),
    ],
)
def test_a_damaged_file_is_refused(tmp_path, name, text, why):
    (tmp_path / name).write_text(text)
    with pytest.raises(ArtifactError) as caught:
        lens_files.load(tmp_path / name)
    assert caught.value.code == "DXB-A402"
    assert why in caught.value.facts["why"]


def test_a_panorama_has_no_camera_info(tmp_path):
    with pytest.raises(ArtifactError, match="names no file format of a Equirectangular"):
        Equirectangular(width=8, height=4).save(tmp_path / "camera.yaml")


@pytest.mark.parametrize("wrong", [{"fx": 0.0}, {"width": 0}, {"k1": float("nan")}, {"cx": float("inf")}])
def test_numbers_that_make_no_lens_are_refused(wrong):
    with pytest.raises(ArtifactError) as caught:
        BrownConrady(**BASE | wrong)
    assert caught.value.code == "DXB-A101"


@pytest.mark.parametrize("lens", [BrownConrady(**BASE, k1=-0.4), KannalaBrandt(**BASE), Equirectangular(**SIZE)])
def test_the_picture_shows_squares_of_ten_degrees(lens):
    picture = np.asarray(Pillow.open(io.BytesIO(lens.picture())))
    assert picture.shape == (480, 640)
    assert len(np.unique(picture)) > 5
