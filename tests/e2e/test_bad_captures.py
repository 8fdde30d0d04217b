"""Captures that cannot be built from: one clear error each, through the recipe that people use."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.e2e.space import Space

pytestmark = pytest.mark.usefixtures("twin_workers")

WIDTH, HEIGHT = 160, 120
INTRINSICS = {
    "width": WIDTH,
    "height": HEIGHT,
    "fx": 150.0,
    "fy": 150.0,
    "cx": 79.5,
    "cy": 59.5,
    "depth_scale_m": 0.001,
}


def write_capture(folder: Path, *, box: bool = True) -> None:
    """A camera 0.8 m above a table, looking down; a box of 6 cm stands in the middle."""
    folder.mkdir()
    rng = np.random.default_rng(1)
    depth = 800.0 + rng.normal(0.0, 1.0, (HEIGHT, WIDTH))
    rgb = np.full((HEIGHT, WIDTH, 3), (150, 110, 70), np.uint8)
    if box:
        depth[45:75, 60:100] -= 60.0
        rgb[45:75, 60:100] = (200, 40, 40)
    Image.fromarray(rgb).save(folder / "rgb.png")
    Image.fromarray(depth.round().astype(np.uint16)).save(folder / "depth.png")
    (folder / "capture.json").write_text(json.dumps(INTRINSICS))


@pytest.fixture(scope="module")
def built(tmp_path_factory) -> Space:
    """A project in which the good capture was built."""
    made = Space(tmp_path_factory.mktemp("captures"))
    made.write("dxb.toml", 'profile = "stub"\n')
    write_capture(made.root / "shot")
    answer = build(made)
    assert answer.code == 0, answer.err
    return made


@pytest.fixture
def space(built: Space) -> Space:
    """The same with the good capture."""
    shutil.rmtree(built.root / "shot")
    write_capture(built.root / "shot")
    return built


def build(space: Space):
    return space.dxb("build", "twin/tabletop:objects", "--input", "capture=shot")


def spoil(space: Space, **changes: object) -> None:
    known = json.loads((space.root / "shot/capture.json").read_text())
    (space.root / "shot/capture.json").write_text(
        json.dumps({name: value for name, value in {**known, **changes}.items() if value is not None})
    )


def lose_depth(space: Space) -> None:
    (space.root / "shot/depth.png").unlink()


def truncate(space: Space) -> None:
    data = (space.root / "shot/rgb.png").read_bytes()
    (space.root / "shot/rgb.png").write_bytes(data[: len(data) // 2])


def not_a_number(space: Space) -> None:
    lose_depth(space)
    np.save(space.root / "shot/depth.npy", np.full((HEIGHT, WIDTH), np.nan, np.float32))


def smaller_depth(space: Space) -> None:
    Image.fromarray(np.full((60, 80), 800, np.uint16)).save(space.root / "shot/depth.png")


def break_json(space: Space) -> None:
    (space.root / "shot/capture.json").write_text("{")


def no_object(space: Space) -> None:
    for file in (space.root / "shot").iterdir():
        file.unlink()
    (space.root / "shot").rmdir()
    write_capture(space.root / "shot", box=False)


@pytest.mark.medium
@pytest.mark.parametrize(
    ("harm", "words"),
    [
        (lose_depth, "depth"),
        (truncate, "rgb.png"),
        (lambda space: spoil(space, depth_scale_m=None), "depth_scale_m"),
        (lambda space: spoil(space, width=320), "320"),
        (lambda space: spoil(space, fx=None), "fx"),
        (lambda space: spoil(space, depth_scale_m=1.0), "unit"),
        (not_a_number, "NaN"),
        (smaller_depth, "80 x 60"),
        (break_json, "capture.json"),
        (no_object, "no object"),
    ],
    ids=[
        "missing",
        "truncated",
        "no scale",
        "other size",
        "no focal length",
        "unit",
        "nan",
        "sizes",
        "json",
        "empty table",
    ],
)
def test_a_bad_capture_is_refused_and_the_next_build_goes_on(space, harm, words):
    good = {file.name: file.read_bytes() for file in (space.root / "shot").iterdir()}
    harm(space)
    answer = build(space)
    assert answer.code in (1, 2), answer.err
    assert answer.err.count("error[DXB-") == 1, answer.err
    assert words in answer.err
    assert "Traceback" not in answer.err
    for file in (space.root / "shot").iterdir():
        file.unlink()
    for name, data in good.items():
        (space.root / "shot" / name).write_bytes(data)
    assert build(space).code == 0


def test_a_missing_folder_is_named(space):
    answer = space.dxb("build", "twin/tabletop:objects", "--input", "capture=nowhere")
    assert answer.code == 2
    assert (
        "error[DXB-R301]: `nowhere` is neither a file nor a recipe\n  --> the command line: --input capture=nowhere\n"
        in answer.err
    )
    assert f"looked for: {space.root / 'nowhere'}" in answer.err
