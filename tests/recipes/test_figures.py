"""The figures of the paper in the report of runs with the backends of profile cpu."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import yaml

from dextera_build.explain import runs
from dextera_build.project.project import find
from dextera_build.report import cotraining
from dextera_build.report.run import read
from dextera_build.session import reading
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


@pytest.mark.slow
def test_policies_of_one_pair_have_bars_of_both_trainings_in_both_worlds(tmp_path: Path) -> None:
    """The nodes of the recipe, made by stub backends, whose trials are shown only if they are taken for results.

    Its students of a teacher and its policies of pictures have the same algorithms, and no bars.
    """
    space = Space(tmp_path)
    space.write("dxb.toml", 'cache = "cache"\nprofile = "stub"\n')
    few = ("--set", "set/pair/shards.episodes=2", "--set", "set/data/shards.episodes=1")
    recipe = "policy/kl/lift_mustard_bottle"
    targets = [f"{recipe}:{target}" for target in ("default", "co_training", "two_cameras")]
    answer = space.dxb("build", *targets, "--console", "none", *few, timeout_s=900.0)
    assert answer.code == 0, answer.err
    project = find(tmp_path)
    run = read(runs.find(project, None)[1], reading(project))
    assert cotraining.charts(run) == []
    for node in run.nodes:
        node.backend = "mujoco"
    chart = cotraining.charts(run)[0]
    words = [text for text in re.findall(r"<text[^>]*>([^<]*)", chart) if not text.isdigit()]
    assert words == ["twin", "ACT", "DP", "reference, simulated", "ACT", "DP"]
    assert re.findall(r"<title>\d+ of (\d+)", chart) == ["100"] * 4 + ["20"] * 4
    assert "LiftMustardBottle, kuka_leap" in chart
