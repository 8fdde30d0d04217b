"""twin/tabletop from a JPEG of which its EXIF alone tells the focal length: with one stated size, and with a marker."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from dextera_build.api import Project
from dextera_build.artifacts.base import Artifact
from dextera_build.artifacts.objects.object import Asset, Shape, Support
from tests import tabletops
from tests.e2e.space import Space
from tests.recipes.test_photograph_alone import COLOURS, HEIGHT_M, PLACES, SIZE
from tests.rules.align import test_markers as markers

pytestmark = pytest.mark.slow

FILM_MM = 36.0, 24.0
FOCAL_TAG, EXIF_TAG = 0xA405, 0x8769
"""FocalLengthIn35mmFilm, in the Exif directory."""
SHEET = 7, 0.13, -0.1
"""Number of the marker, and its place on the table [m]."""
APART_M = float(np.linalg.norm(PLACES["near"][:3, 3] - PLACES["far"][:3, 3]))


def shot(root: Path, *sheets: tuple[int, float, float]) -> Space:
    """A project with a folder that holds a JPEG and nothing else, and the boxes around the things in it."""
    space = Space(root)
    space.write("dxb.toml", "")
    things = [(tabletops.box(*SIZE, COLOURS[name]), place) for name, place in PLACES.items()]
    scene = tabletops.tabletop(*things, half=0.8, noise=0.0, lens=tabletops.FINE)
    pixels = scene.capture.photograph.rgb.pixels.copy()
    for number, x, y in sheets:
        markers.printed(pixels, scene, number, (x, y))
    tags = Image.Exif()
    diagonal = float(np.hypot(tabletops.FINE.width, tabletops.FINE.height))
    tags.get_ifd(EXIF_TAG)[FOCAL_TAG] = round(tabletops.FINE.fx * float(np.hypot(*FILM_MM)) / diagonal)
    (root / "shot").mkdir()
    Image.fromarray(pixels).save(root / "shot/rgb.jpg", "JPEG", quality=95, exif=tags)
    lines = []
    for number, name in enumerate(PLACES, start=1):
        rows, columns = np.nonzero(scene.labels.labels == number)
        box = [int(columns.min()), int(rows.min()), int(columns.max()) + 1, int(rows.max()) + 1]
        lines.append(f"- {{name: {name}, category: box, material: cardboard, box: {box}}}\n")
    space.write("scene.yaml", "elements:\n" + "".join(lines))
    return space


@dataclass(frozen=True)
class Twin:
    """What a build gave."""

    lines: dict[str, str]
    """Node -> what it said."""
    assets: dict[str, Asset]
    height: float
    """Of the camera above the table [m]."""
    sigmas: dict[str, float]
    """Thing -> stated standard deviation of the logarithm of its size."""

    @property
    def apart(self) -> float:
        """Distance of the two boxes [m]."""
        one, other = (self.assets[name].pose.matrix[:3, 3] for name in PLACES)
        return float(np.linalg.norm(one - other))

    def sides(self, name: str) -> np.ndarray:
        """Sides (3,) of a box, sorted [m]."""
        asset = self.assets[name]
        return np.sort(asset.body.links["base"].mesh.extent)


def built(space: Space, **settings: Mapping[str, object]) -> Twin:
    """A twin without depth, with settings of its nodes `support` and `ground`."""
    asked = {f"{node}.{name}": value for node, options in settings.items() for name, value in options.items()}
    words = ["--profile", "picture", "--input", "capture=shot", "--input", "description=scene.yaml"]
    words += [word for name, value in asked.items() for word in ("--set", f"{name}={json.dumps(value)}")]
    answer = space.build("twin/tabletop", *words)
    assert answer.code == 0, answer.err[-3000:]
    inputs = {"capture": space.root / "shot", "description": space.root / "scene.yaml"}
    project = Project.find(space.root, profile="picture")

    def got(node: str) -> Artifact:
        return project.get(f"twin/tabletop:{node}", inputs=inputs, settings=asked)

    ground, assets = got("ground"), {name: got(f"body[{name}].asset") for name in PLACES}
    shapes = {name: got(f"body[{name}].mesh") for name in PLACES}
    assert isinstance(ground, Support)
    return Twin(
        {event["node"]: event["line"] for event in answer.events if event["event"] == "node_finished"},
        {name: asset for name, asset in assets.items() if isinstance(asset, Asset)},
        float(ground.camera_pose.matrix[2, 3]),
        {name: shape.size_sigma or 0.0 for name, shape in shapes.items() if isinstance(shape, Shape)},
    )


def test_a_jpeg_and_one_size_become_a_twin_in_metres(tmp_path: Path) -> None:
    """The camera looks down by 40 deg, and 35 deg are assumed, with a standard deviation of 10 deg."""
    twin = built(shot(tmp_path), ground={"object": "near", "size_m": SIZE[2]})
    assert "is from the EXIF (a focal length of 31 mm on 35 mm film), which is uncertain" in twin.lines["photo"]
    assert twin.lines["ground"].startswith("scale by the size of near, 140 mm")
    assert twin.sides("near")[2] == pytest.approx(SIZE[2], abs=1e-6)
    for name in PLACES:
        # The shorter side follows the tilt most, and where it is wrong by 5 deg, the fit's minimum is flat.
        short, *longer = np.abs(np.log(twin.sides(name) / np.sort(SIZE)))
        assert max(longer) < 0.1
        assert short < 2 * twin.sigmas[name]
        assert twin.sigmas[name] < 0.15
    assert twin.height == pytest.approx(HEIGHT_M, rel=0.1)
    assert twin.apart == pytest.approx(APART_M, rel=0.1)


def test_a_jpeg_with_a_printed_marker_becomes_a_twin_in_metres(tmp_path: Path) -> None:
    """Sizes across the picture are as uncertain as the focal length: by some 5 %, as the build says."""
    marker = {"size_m": markers.INK_M, "number": SHEET[0]}
    twin = built(shot(tmp_path, SHEET), support={"marker": marker})
    assert twin.lines["support"].endswith("m below the camera, by the marker")
    assert twin.lines["ground"] == "scale by the marker"
    for name in PLACES:
        assert twin.sides(name) == pytest.approx(np.sort(SIZE), abs=0.004)
    assert twin.height == pytest.approx(HEIGHT_M, rel=0.02)
    assert twin.apart == pytest.approx(APART_M, rel=0.05)
