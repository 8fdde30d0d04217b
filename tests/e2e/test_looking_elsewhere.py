"""`dxb view` and `dxb report` where results came from a remote or a bundle, without the bytes in between."""

from __future__ import annotations

import io
import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests import factories, tabletops
from tests.e2e.recordings import saved
from tests.e2e.space import Space

RECIPE = "extends: twin/tabletop\ninputs: {capture: shot}\ntargets: {default: [scene]}\n"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Space:
    """A project that built a scene of a box on a table."""
    space = Space(tmp_path_factory.mktemp("made"))
    box = factories.box_mesh((-0.05, -0.05, 0.0), (0.05, 0.05, 0.1), colour=(0.8, 0.2, 0.2))
    seen = tabletops.tabletop((box, np.eye(4)), lens=tabletops.FINE).capture
    assert seen.measured is not None
    space.write("shot/capture.json", json.dumps(tabletops.FINE.model_dump() | {"depth_scale_m": 0.001}))
    Image.fromarray(seen.photograph.rgb.pixels).save(space.root / "shot/rgb.png")
    Image.fromarray(np.round(seen.measured.depth.depth * 1000).astype(np.uint16)).save(space.root / "shot/depth.png")
    prepare(space)
    answer = space.dxb("build", "table")
    assert answer.code == 0, answer.err
    assert "  view: dxb view table      report: dxb report\nstub backends made" in answer.err
    return space


def prepare(space: Space) -> Space:
    space.write("dxb.toml", 'cache = "cache"\nprofile = "stub"\n')
    space.write("recipes/table.yaml", RECIPE)
    return space


def look(space: Space, **env: str) -> str:
    """What viewing and reporting say on standard error."""
    assert space.dxb("report", "table", env=env).code == 0
    answer = space.dxb("view", "table", "--save", "seen.viser", env=env)
    assert answer.code == 0, answer.err
    assert (space.root / "seen.viser").stat().st_size > 1000
    return answer.err


@pytest.mark.slow
def test_after_a_build_the_scene_is_shown_and_marked(made: Space) -> None:
    said = look(made)
    assert "`table` was made with stub backends: " in said
    assert "was written" not in said
    text = (made.root / "cache/out/table/report.html").read_text()
    assert "stub backends made" in text
    assert 'id="turn"' in text
    assert "__VISER_EMBED_DATA__" in text
    assert not (made.root / "cache/out/table/report_3d.html").exists()
    assert made.dxb("report", "table", "--against", "0001", "-o", "beside.html").code == 0
    assert "Beside run 0001" in (made.root / "beside.html").read_text()
    assert "`table:scene` was made with stub backends: " in made.dxb("get", "table:scene", "-o", "got").err
    assert made.dxb("build", "table:photo").code == 0
    assert "`table` was made with stub backends: " in look(made)


@pytest.mark.slow
def test_rerun_reads_the_twin_with_its_photograph(made: Space, tmp_path: Path) -> None:
    found = saved(made, "table", tmp_path)
    packed = found["/cameras/photograph/picture EncodedImage:blob"][0][0]
    seen = np.asarray(Image.open(io.BytesIO(bytes(packed))), float)
    assert np.abs(seen - np.asarray(Image.open(made.root / "shot/rgb.png"))).mean() < 4
    assert found["/cameras/photograph Pinhole:resolution"][0][0] == [tabletops.FINE.width, tabletops.FINE.height]
    assert any(name.startswith("/body\\[") and name.endswith("Mesh3D:vertex_positions") for name in found)
    assert "/background/surface Mesh3D:vertex_positions" in found
    assert not any("/piece_" in name for name in found)  # hidden in the viewer


@pytest.mark.slow
def test_after_an_import_the_scene_is_shown_as_it_was_written(made: Space, tmp_path: Path) -> None:
    assert made.dxb("bundle", "create", "table", "-o", str(tmp_path / "table.tar")).code == 0
    there = prepare(Space(tmp_path))
    assert there.dxb("bundle", "import", "table.tar").code == 0
    assert "shown as `scene` was written, without the photograph: the store lacks the bytes of " in look(there)


@pytest.mark.slow
def test_after_a_fetch_the_bytes_that_are_shown_are_fetched(made: Space) -> None:
    share = str(made.root / "share")
    assert made.dxb("cache", "push", "table", "--to", share).code == 0
    other = {"DXB_CACHE": "other", "DXB_REMOTES": f"local:rw,{share}:r"}
    fetched = made.dxb("build", "table", "--console", "jsonl", env=other)
    assert (fetched.code, fetched.nodes("ran")) == (0, set())
    assert "was written" not in look(made, **other)
