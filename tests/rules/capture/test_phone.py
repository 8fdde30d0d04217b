"""Photographs as people have them: turned by EXIF, without calibration, through a lens with distortion."""

from __future__ import annotations

import io
import json

import cv2
import numpy as np
import pytest
from PIL import Image as Pillow

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.cameras.image import png
from dextera_build.errors import RuleError
from dextera_build.testing import RuleRunner
from tests.rules.capture.test_folder import FACTS, facts, files

UPRIGHT = np.zeros((48, 64, 3), np.uint8)
UPRIGHT[:16, :16] = (250, 10, 10)
UPRIGHT[:16, 48:] = (10, 250, 10)
UPRIGHT[32:, :16] = (10, 10, 250)
SIZED = {"width": 64, "height": 48, "fx": 60.0, "fy": 60.0, "cx": 31.5, "cy": 23.5}


@pytest.fixture
def runner(tmp_path):
    return RuleRunner(tmp_path)


def jpeg(pixels: np.ndarray, orientation: int | None = None, focal_35mm: int | None = None) -> bytes:
    tags = Pillow.Exif()
    if orientation is not None:
        tags[0x0112] = orientation
    if focal_35mm is not None:
        tags.get_ifd(0x8769)[0xA405] = focal_35mm
    buffer = io.BytesIO()
    Pillow.fromarray(pixels).save(buffer, "JPEG", quality=95, exif=tags)
    return buffer.getvalue()


def stored(orientation: int) -> np.ndarray:
    """How a camera with this orientation stores the upright picture (EXIF 2.3, section 4.6.4)."""
    by = {
        1: lambda x: x,
        2: lambda x: x[:, ::-1],
        3: lambda x: x[::-1, ::-1],
        4: lambda x: x[::-1],
        5: lambda x: x.swapaxes(0, 1),
        6: lambda x: np.rot90(x, 1),
        7: lambda x: np.rot90(x, 2).swapaxes(0, 1),
        8: lambda x: np.rot90(x, -1),
    }
    return np.ascontiguousarray(by[orientation](UPRIGHT))


@pytest.mark.parametrize("orientation", range(1, 9))
def test_the_picture_is_turned_as_its_exif_says(runner, orientation):
    folder = Folder(
        files={"rgb.jpg": jpeg(stored(orientation), orientation), "capture.json": json.dumps(SIZED).encode()}
    )
    capture = runner.run("capture.folder", folder=folder)
    assert np.abs(capture.photograph.rgb.pixels.astype(int) - UPRIGHT).mean() < 4
    assert ("rotated by its EXIF orientation" in runner.outcome.line) == (orientation > 1)


def test_intrinsics_of_the_stored_picture_leave_it_as_it_is(runner):
    turned = {**SIZED, "width": 48, "height": 64, "cx": 23.5, "cy": 31.5}
    folder = Folder(files={"rgb.jpg": jpeg(stored(6), 6), "capture.json": json.dumps(turned).encode()})
    capture = runner.run("capture.folder", folder=folder)
    assert capture.photograph.rgb.pixels.shape == (64, 48, 3)
    assert "so it was not rotated" in runner.outcome.warnings[0]


def test_the_focal_length_comes_from_the_exif_and_is_called_uncertain(runner):
    folder = Folder(files={"rgb.jpg": jpeg(UPRIGHT, focal_35mm=26)})
    camera = runner.run("capture.folder", folder=folder).photograph.camera
    # 26 mm on film of 36 x 24 mm: a diagonal angle of view of 79.5 deg (CIPA DCG-001).
    assert 2 * np.degrees(np.arctan(np.hypot(64, 48) / 2 / camera.fx)) == pytest.approx(79.5, abs=0.1)
    assert (camera.cx, camera.cy, camera.fx) == (31.5, 23.5, camera.fy)
    assert "uncertain by about 5 %" in runner.outcome.warnings[0]


def test_without_any_intrinsics_the_error_says_what_would_do(runner):
    with pytest.raises(RuleError, match=r"`capture.json` is missing") as caught:
        runner.run("capture.folder", folder=Folder(files={"rgb.jpg": jpeg(UPRIGHT)}))
    assert "a focal length in the EXIF" in str(caught.value.facts["wanted"])


def test_damaged_tags_count_as_none(runner):
    data = bytearray(jpeg(UPRIGHT, 6))
    at = data.index(b"Exif\0\0") + 6
    data[at : at + 8] = b"XX\xff\xff\xff\xff\xff\xff"
    folder = Folder(files={"rgb.jpg": bytes(data), "capture.json": json.dumps(SIZED).encode()})
    assert runner.run("capture.folder", folder=folder).photograph.rgb.pixels.shape == (48, 64, 3)


@pytest.mark.parametrize("told", ["view", "exif"])
def test_distortion_belongs_to_any_camera_of_the_picture(runner, told):
    """It was read with fx and fy alone."""
    view = {"view_deg": 60.0} if told == "view" else {}
    shots = {}
    for name, more in (("plain", {}), ("bent", {"distortion": [-0.3, 0.1, 0.0, 0.0]})):
        data = jpeg(UPRIGHT, focal_35mm=28)
        shots[name] = runner.run(
            "capture.folder", folder=Folder(files={"rgb.jpg": data, "capture.json": json.dumps(view | more).encode()})
        )
    assert shots["plain"].photograph.camera == shots["bent"].photograph.camera
    assert not np.array_equal(shots["plain"].photograph.rgb.pixels, shots["bent"].photograph.rgb.pixels)


def test_distortion_is_taken_out_of_picture_and_depth(runner):
    k = np.array([[60.0, 0, 31.5], [0, 60.0, 23.5], [0, 0, 1]])
    coefficients = [-0.25, 0.08, 0.001, -0.002, 0.01]
    smooth = cv2.resize(np.random.default_rng(0).integers(0, 255, (6, 8, 3)).astype(np.uint8), (64, 48))
    depth = np.tile(np.linspace(500, 900, 64).astype(np.uint16), (48, 1))
    told = {**SIZED, "depth_scale_m": 0.001, "distortion": coefficients}
    folder = Folder(files={"rgb.png": png(smooth), "depth.png": png(depth), "capture.json": json.dumps(told).encode()})
    capture = runner.run("capture.folder", folder=folder)
    expected = cv2.undistort(smooth, k, np.array(coefficients))
    inner = np.s_[6:-6, 8:-8]
    assert np.abs(capture.photograph.rgb.pixels.astype(int) - expected)[inner].mean() < 1.0
    assert np.abs(smooth.astype(int) - expected)[inner].mean() > 1.0
    row = cv2.undistort(depth.astype(np.float32), k, np.array(coefficients)) / 1000
    assert np.abs(capture.measured.depth.depth - row)[inner].max() < 0.01


def test_a_calibration_file_gives_the_lens(runner):
    info = (
        "image_width: 64\nimage_height: 48\ncamera_name: c\ndistortion_model: plumb_bob\n"
        "camera_matrix: {rows: 3, cols: 3, data: [60, 0, 31.5, 0, 60, 23.5, 0, 0, 1]}\n"
        "distortion_coefficients: {rows: 1, cols: 5, data: [-0.2, 0, 0, 0, 0]}\n"
        "rectification_matrix: {rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}\n"
        "projection_matrix: {rows: 3, cols: 4, data: [60, 0, 31.5, 0, 0, 60, 23.5, 0, 0, 0, 1, 0]}\n"
    )
    folder = Folder(files={"rgb.png": png(UPRIGHT), "camera_info.yaml": info.encode()})
    capture = runner.run("capture.folder", folder=folder)
    assert capture.photograph.camera.fx == 60.0
    assert (capture.photograph.rgb.pixels != UPRIGHT).any(), "the distortion was taken out"


@pytest.mark.parametrize("value", [[1, 2], "k1", [0.1, 0.2, 0.3, None], [1e9, 0, 0, 0]])
def test_wrong_distortion_is_refused(runner, value):
    with pytest.raises(RuleError, match="`distortion`") as caught:
        runner.run("capture.folder", folder=files(capture__json=json.dumps({**FACTS, "distortion": value}).encode()))
    assert caught.value.hint


@pytest.mark.parametrize(("key", "value"), [("fx", "NaN"), ("fx", "Infinity"), ("cx", "NaN"), ("depth_scale_m", "NaN")])
def test_numbers_that_are_none_are_named_with_their_key(runner, key, value):
    text = facts(**{key: 12345.5}).replace(b"12345.5", value.encode())
    with pytest.raises(RuleError) as caught:
        runner.run("capture.folder", folder=files(capture__json=text))
    assert f"`{key}` is {float(value.replace('Infinity', 'inf'))}" in caught.value.message


FOCAL, FOCAL_35MM, DENSITY, UNIT, WIDTH, HEIGHT = 0x920A, 0xA405, 0xA20E, 0xA210, 0xA002, 0xA003


def tagged(pixels: np.ndarray, photo: dict[int, object]) -> bytes:
    """A JPEG with these tags of its EXIF."""
    tags = Pillow.Exif()
    tags.get_ifd(0x8769).update(photo)
    buffer = io.BytesIO()
    Pillow.fromarray(pixels).save(buffer, "JPEG", exif=tags)
    return buffer.getvalue()


def camera_of(runner, data: bytes):
    return runner.run("capture.folder", folder=Folder(files={"rgb.jpg": data})).photograph.camera


def test_focal_length_and_resolution_of_the_sensor_do_as_well(runner):
    # 4.2 mm at 20 px/mm, once per inch and once per centimetre.
    for density, unit in ((20 * 25.4, 2), (200.0, 3)):
        camera = camera_of(runner, tagged(UPRIGHT, {FOCAL: 4.2, DENSITY: density, UNIT: unit}))
        assert camera.fx == pytest.approx(84.0)
        assert "resolution of the sensor" in runner.outcome.warnings[0]


def test_a_resized_picture_has_its_focal_length_resized(runner):
    camera = camera_of(runner, tagged(UPRIGHT, {FOCAL: 4.2, DENSITY: 400.0, UNIT: 3, WIDTH: 128, HEIGHT: 96}))
    assert camera.fx == pytest.approx(84.0)
    assert not any("cropped" in text for text in runner.outcome.warnings)


def test_a_cropped_picture_is_suspected_and_keeps_its_pixels(runner):
    crop = np.ascontiguousarray(UPRIGHT[:40, :44])
    camera = camera_of(runner, tagged(crop, {FOCAL_35MM: 26, WIDTH: 64, HEIGHT: 48}))
    assert camera.fx == pytest.approx(26.0 / np.hypot(36, 24) * np.hypot(64, 48))
    assert any("64 x 48 px were taken and 44 x 40 px are here" in text for text in runner.outcome.warnings)
    camera_of(runner, tagged(np.ascontiguousarray(UPRIGHT[:30]), {FOCAL_35MM: 26}))
    assert any("its sides are 2.13 to 1" in text for text in runner.outcome.warnings)


def test_a_stated_field_of_view_makes_the_camera(runner):
    folder = Folder(files={"rgb.png": png(UPRIGHT), "capture.json": b'{"view_deg": 90}'})
    assert runner.run("capture.folder", folder=folder).photograph.camera.fx == pytest.approx(32.0)
    for wrong in (b'{"view_deg": "wide"}', b'{"view_deg": 200}'):
        with pytest.raises(RuleError, match="`view_deg` must be a horizontal field of view"):
            runner.run("capture.folder", folder=Folder(files={"rgb.png": png(UPRIGHT), "capture.json": wrong}))
