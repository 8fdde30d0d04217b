"""The figures of the paper in the report of runs with the backends of profile cpu."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import yaml

from tests.e2e.space import Space
from tests.recipes.test_captured_tables import built

PAGE = Path(__file__).parents[2] / "dextera_build/docs/seeing.md"


def figures(space: Space, recipe: str) -> dict[int, str]:
    """Number of a figure -> its text, without markup, in the report of the last run."""
    answer = space.dxb("report", recipe, "-o", "report.html")
    assert answer.code == 0, answer.err
    section = re.findall(r'<section id="figures".*?</section>', (space.root / "report.html").read_text(), re.DOTALL)[0]
    parts = re.split(r'<div class="card" id="figure(\d)">', section)[1:]
    return {int(number): re.sub(r"<[^>]*>", " ", text) for number, text in zip(parts[::2], parts[1::2], strict=True)}


@pytest.mark.slow
def test_a_twin_of_two_methods_has_the_figures_of_the_page(tmp_path: Path) -> None:
    """The recipe is the one that the page shows; its photograph is one of the reference world."""
    space = Space(tmp_path)
    (recipe,) = (text for text in re.findall(r"```yaml\n(.*?)```", PAGE.read_text(), re.DOTALL) if "boxes:" in text)
    assert yaml.safe_load(recipe)["extends"] == "twin/box_table"
    space.write("recipes/methods.yaml", recipe)
    built(space, "methods")
    found = figures(space, "methods")
    assert sorted(found) == [1, 2, 3, 5, 6]
    for number, text in found.items():
        assert "simulated" in text, number
    assert {"(a) Elements", "(b) Objects", "(c) Static scene"} <= set(
        re.findall(r"\(\w\) [A-Z]\w+(?: scene)?", found[1])
    )
    for label in ("box", "blue_cube", "thermometer"):
        assert f"{label} mesh" in found[1]
        assert f"{label} placed" in found[2]
        assert f" {label} " in found[6]
    assert "primitives" in found[6]
    assert "bounding_box" in found[6]
    metrics = space.dxb("show", "methods:modalities", "--json").document["metrics"]
    assert metrics["mask_iou"]["value"] > 0.9
    assert metrics["depth_difference"]["value"] < 0.005
