"""One line about a value, and its picture: what a notebook shows."""

from __future__ import annotations

import base64
import io
import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image as Pillow

from dextera_build.artifacts.base import Artifact, Collection, File, Folder
from dextera_build.artifacts.cameras.image import DepthImage, Image, LabelImage
from dextera_build.artifacts.shapes.mesh import Hull, Mesh
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.artifacts.table import Column, Table
from dextera_build.errors import UsageError
from tests import factories

DEPTH = np.zeros((3, 4), np.float32)
DEPTH[0] = (0.5, 0.75, 1.0, 1.25)
TABLE = Table(title="Sizes", columns=(Column(name="edge", unit="mm", digits=1),), rows=((12.25,), (None,)))
LINES = [
    (Image(pixels=np.zeros((48, 64, 3), np.uint8)), "Image(64 x 48 px)"),
    (DepthImage(depth=DEPTH), "DepthImage(4 x 3 px, depth 0.50 to 1.25 m on 33%)"),
    (DepthImage(depth=DEPTH * 0), "DepthImage(4 x 3 px)"),
    (factories.box_mesh((0, 0, 0), (0.1, 0.2, 0.3)), r"Mesh\(\d+ vertices, 100 x 200 x 300 mm, 12 faces\)"),
    (File(data=b"x" * 1200), "File(1.2 kB)"),
    (Folder(files={"a": b"12", "b/c": b"3"}), "Folder(2 files (a, b/c), 3 bytes)"),
    (Collection[File](items={"one": File(data=b"")}), "Collection(1 File (one))"),
    (Collection[File](items={}), "Collection()"),
    (
        Pose(parent="camera", child="base", matrix=np.eye(4)),
        r"Pose\(T_camera_base at \(0\.000, 0\.000, 0\.000\) m, turned 0\.0 deg\)",
    ),
    (factories.laptop_asset(), r"Asset\(2 links \(\w+, \w+\), 1 joint \(\w+\), .*\)"),
    (TABLE, "Table(title Sizes, 1 column (edge), 2 rows)"),
]


@pytest.mark.parametrize(("value", "line"), LINES, ids=lambda value: getattr(value, "name", lambda: "")())
def test_a_value_says_in_one_line_what_it_is(value: Artifact, line: str) -> None:
    assert repr(value) == line or re.fullmatch(line, repr(value)), repr(value)
    assert len(repr(value)) < 140


def test_a_large_file_is_not_read_for_its_line(tmp_path: Path) -> None:
    (tmp_path / "large").write_bytes(bytes(5_000_000))
    made = File.of(str(tmp_path / "large"))
    assert repr(made) == "File(5.0 MB)"
    assert "data" not in vars(made)


def picture(value: Artifact) -> np.ndarray:
    found = re.search(r'src="data:image/png;base64,([^"]+)"', value._repr_html_())
    assert found, value._repr_html_()
    return np.array(Pillow.open(io.BytesIO(base64.b64decode(found[1])), formats=("PNG",)).convert("RGB"))


def test_notebooks_show_pictures() -> None:
    pixels = np.random.default_rng(0).integers(0, 255, (48, 64, 3)).astype(np.uint8)
    assert np.array_equal(picture(Image(pixels=pixels)), pixels)
    assert picture(Image(pixels=np.zeros((1300, 700, 3), np.uint8))).shape == (434, 234, 3)
    grey = picture(DepthImage(depth=DEPTH))
    assert grey[0, 0, 0] > grey[0, 3, 0] > 0 == grey[1, 1, 0]
    labels = picture(LabelImage(labels=np.array([[0, 1, 2, 6]], np.int32)))
    assert not labels[0, 0].any()
    assert not np.array_equal(labels[0, 1], labels[0, 2])


def test_a_mesh_is_drawn_from_its_front_in_its_colour() -> None:
    seen = picture(factories.box_mesh((0, 0, 0), (0.1, 0.1, 0.1), colour=(1.0, 0.0, 0.0)))
    red = (seen[..., 0] > 100) & (seen[..., 1] < 20)
    assert 0.1 < red.mean() < 0.6
    assert (seen[0, 0] == 255).all()
    assert red[seen.shape[0] // 2, seen.shape[1] // 2]
    empty = Mesh(vertices=np.zeros((0, 3), np.float32), faces=np.zeros((0, 3), np.int32))
    assert (picture(empty) == 255).all()


def test_an_asset_is_drawn_with_all_its_links() -> None:
    asset = factories.laptop_asset()
    whole, base = picture(asset), picture(asset.body.links["base"])
    assert whole.shape == base.shape
    assert not np.array_equal(whole, base)


def test_what_has_no_picture_is_a_line_and_a_table_is_a_table() -> None:
    assert Hull(vertices=np.eye(4, 3, dtype=np.float32))._repr_html_().startswith("<div><code>Hull(4 vertices")
    assert "<td>12.2</td>" in TABLE._repr_html_()
    assert "<th>edge [mm]</th>" in TABLE._repr_html_()


def test_nothing_of_a_value_becomes_markup() -> None:
    table = TABLE.model_copy(update={"title": "<script>", "rows": (("<b>",),)})
    assert "<script>" not in table._repr_html_()
    assert "<b>" not in table._repr_html_()
    assert "\x1b" not in repr(table.model_copy(update={"title": "a\x1b[2Jb"}))


def test_an_error_says_its_place_facts_and_hint() -> None:
    error = UsageError("no such node", facts={"nodes": "a, b"}, hint="`dxb ls`")
    assert str(error) == "no such node\n  nodes: a, b\n  hint: `dxb ls`"
    assert str(UsageError("no such node")) == "no such node"
