"""What people correct by hand: a proposed scene.yaml, and one painted mask, with the backends of profile cpu."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests import factories, tabletops
from tests.e2e.space import Space

pytestmark = pytest.mark.usefixtures("twin_workers")

TARGET = "twin/tabletop:body.physics"
CAPTURE = ("--input", "capture=shot")
RED = tabletops.box(0.10, 0.08, 0.10, (0.8, 0.2, 0.2))
BLUE = tabletops.box(0.08, 0.08, 0.07, (0.2, 0.2, 0.8))


def write_capture(folder: Path) -> None:
    """Two boxes on a table, as a depth camera sees them."""
    seen = tabletops.tabletop((RED, factories.pose(-0.12)), (BLUE, factories.pose(0.12))).capture
    assert seen.measured is not None
    folder.mkdir()
    Image.fromarray(seen.photograph.rgb.pixels).save(folder / "rgb.png")
    Image.fromarray((seen.measured.depth.depth * 1000).round().astype(np.uint16)).save(folder / "depth.png")
    lens = tabletops.LENS.model_dump()
    told = {key: lens[key] for key in ("width", "height", "fx", "fy", "cx", "cy")}
    (folder / "capture.json").write_text(json.dumps({**told, "depth_scale_m": 0.001}))


@pytest.fixture(scope="module")
def seen(tmp_path_factory) -> Space:
    """A project in which objects were found, and nothing was built of them."""
    space = Space(tmp_path_factory.mktemp("corrections"))
    space.write("dxb.toml", 'cache = "cache"\n')
    write_capture(space.root / "shot")
    answer = space.build("twin/tabletop:parse", *CAPTURE)
    assert answer.code == 0, answer.err
    return space


@pytest.fixture
def unbuilt(seen: Space, tmp_path: Path) -> Space:
    """A project of its own with the objects that were found."""
    shutil.copytree(seen.root, tmp_path / "project", symlinks=True)
    return Space(tmp_path / "project")


@pytest.fixture(scope="module")
def built(seen: Space) -> Space:
    answer = seen.build(TARGET, *CAPTURE)
    assert answer.code == 0, answer.err
    assert {"body[red_box].physics", "body[blue_box].physics"} <= answer.nodes("ran")
    return seen


@pytest.fixture
def space(built: Space, tmp_path: Path) -> Space:
    """A project of its own with the results of the first build."""
    shutil.copytree(built.root, tmp_path / "project", symlinks=True)
    return Space(tmp_path / "project")


def of_bodies(nodes: set[str]) -> set[str]:
    return {node for node in nodes if node.startswith("body")}


@pytest.mark.slow
def test_the_proposed_scene_builds_what_was_built_without_it(space):
    answer = space.dxb("new", "scene", "twin/tabletop", *CAPTURE)
    assert (answer.code, answer.out) == (0, "scene.yaml\n"), answer.err
    assert "dxb build twin/tabletop --input capture=shot --input description=scene.yaml" in answer.err
    again = space.build(TARGET, *CAPTURE, "--input", "description=scene.yaml")
    assert again.code == 0, again.err
    assert again.nodes("ran") == {"parse", "objects"}, again.err


@pytest.mark.medium
def test_an_error_in_the_file_names_its_real_path(unbuilt):
    unbuilt.write("lists/things.yaml", "elements:\n- {name: Red Box}\n")
    answer = unbuilt.build(TARGET, *CAPTURE, "--input", "description=lists/things.yaml")
    assert answer.code == 1
    assert "`Red Box` is not a name" in answer.err
    assert '["lists/things.yaml", 2, 10]' in answer.err
    assert "$scene" not in answer.err


@pytest.mark.slow
def test_an_edited_scene_rebuilds_what_was_edited(space):
    space.dxb("new", "scene", "twin/tabletop", *CAPTURE)
    space.edit("scene.yaml", "name: red_box", "name: tea")
    text = (space.root / "scene.yaml").read_text()
    entry = text[text.index("name: tea") :].split("- name:")[0]
    space.write("scene.yaml", text.replace(entry, entry.replace("# material: cardboard", "material: metal")))
    answer = space.build(TARGET, *CAPTURE, "--input", "description=scene.yaml")
    assert answer.code == 0, answer.err
    assert of_bodies(answer.nodes("ran")) == {"body[tea].joints", "body[tea].physics"}
    assert of_bodies(answer.nodes("cached")) >= {"body[tea].mesh", "body[blue_box].mesh", "body[blue_box].physics"}


@pytest.mark.medium
def test_a_file_that_is_there_is_never_written_over(unbuilt):
    unbuilt.write("scene.yaml", "elements: [{name: mine}]\n")
    answer = unbuilt.dxb("new", "scene", "twin/tabletop", *CAPTURE)
    assert answer.code == 2
    assert "error[DXB-U191]: `scene.yaml` exists already, and nothing of it was changed" in answer.err
    assert (unbuilt.root / "scene.yaml").read_text() == "elements: [{name: mine}]\n"
    assert unbuilt.dxb("new", "scene", "twin/tabletop", *CAPTURE, "-o", "other.yaml").out == "other.yaml\n"


@pytest.mark.slow
def test_one_painted_mask_rebuilds_that_object_alone(space):
    answer = space.dxb("new", "mask", "twin/tabletop", "red_box", *CAPTURE)
    assert (answer.code, answer.out) == (0, "masks/red_box.png\n"), answer.err
    masks = (*CAPTURE, "--input", "masks=masks")
    answer = space.build(TARGET, *masks)
    assert answer.nodes("ran") == {"corrected"}, answer.err
    path = space.root / "masks" / "red_box.png"
    painted = np.array(Image.open(path))
    painted[:, int(np.nonzero(painted)[1].max()) - 6 :] = 0
    Image.fromarray(painted).save(path)
    answer = space.build(TARGET, *masks)
    assert answer.code == 0, answer.err
    whole = ("whole", "mesh", "joints", "placed", "physics")
    assert answer.nodes("ran") == {"corrected", "shown", "ground", *(f"body[red_box].{name}" for name in whole)}
    assert of_bodies(answer.nodes("cached")) == {f"body[blue_box].{name}" for name in whole}
    line = next(event["line"] for event in answer.events if event.get("node") == "corrected" and "line" in event)
    assert line.startswith("red_box ")


@pytest.mark.slow
def test_a_mask_of_no_object_is_refused_with_the_objects(space):
    answer = space.dxb("new", "mask", "twin/tabletop", "red_bx", *CAPTURE)
    assert answer.code == 2
    assert "no object is called `red_bx`" in answer.err
    assert "hint: did you mean `red_box`?" in answer.err
    (space.root / "masks").mkdir()
    (space.root / "masks" / "red_bx.png").write_bytes((space.root / "shot" / "rgb.png").read_bytes())
    answer = space.dxb("build", TARGET, *CAPTURE, "--input", "masks=masks")
    assert (answer.code, answer.err.count("error[DXB-")) == (1, 1)
    assert "`red_bx.png` is the mask of no object" in answer.err
    assert "hint: did you mean `red_box`?" in answer.err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("mask", "twin/tabletop"), "a mask is that of one object"),
        (("scene", "twin/tabletop", "red_box"), "a scene is that of a whole photograph"),
        (("scene", "robot/kuka_leap"), "finds objects in no photograph"),
        (("recipe", "toy/scene", "red_box"), "a recipe takes its name and nothing else"),
    ],
)
def test_what_new_does_not_take_is_said(unbuilt, words, message):
    answer = unbuilt.dxb("new", *words)
    assert answer.code == 2
    assert message in answer.err
