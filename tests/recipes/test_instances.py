"""What is apart in an instance is rebuilt apart: pixels, measurements, traits."""

from __future__ import annotations

import json

import pytest

from tests.e2e.space import Space

ADDRESS = "twin/laptop_scene"


def described(space: Space, material: str, boxes: dict[str, list[int]]) -> str:
    things = "".join(
        f"  - {{name: {name}, category: object, material: {material if name == 'mug' else 'wood'}, box: {box}}}\n"
        for name, box in boxes.items()
    )
    return str(space.write(f"{material}.yaml", f"elements:\n{things}").name)


@pytest.mark.slow
def test_another_material_meshes_nothing_again(tmp_path):
    space = Space(tmp_path)
    assert space.build(f"{ADDRESS}:parse", "--profile", "stub").code == 0
    got = space.dxb("get", f"{ADDRESS}:parse", "--out", "parsed", "--profile", "stub")
    assert got.code == 0, got.err
    known = json.loads((tmp_path / "parsed/parse.json").read_text())["elements"]
    boxes = [element["box"] for element in known if element["interactive"]]
    # The laptop and the mug, which the recipe binds.
    names = {"other": boxes[0], "mug": boxes[3]}
    words = ("--profile", "stub", "--input")
    first = space.build(ADDRESS, *words, f"description={described(space, 'plastic', names)}")
    assert first.code == 0, first.err[-3000:]
    again = space.build(ADDRESS, *words, f"description={described(space, 'ceramic', names)}")
    assert again.code == 0, again.err[-3000:]
    # Joints are rebuilt because they read the body type, and stop there: their bytes are the same.
    mug = {f"body[blue_mug].{node}" for node in ("joints", "physics", "asset", "urdf")}
    assert again.nodes("ran") == {
        "parse",
        "objects",
        "named",
        "corrected",
        "shown",
        *mug,
        "composed",
        "scene",
        "usd",
        "settle",
        "overlay",
    }
