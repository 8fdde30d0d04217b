"""`benchmark/stage_two`: who may know the truth, and two scenes of it; `make meshes` fetches their meshes."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.e2e.space import Answer, Space
from tests.recipes.test_envelope import MESHES, REPO, write_small_library

RECIPE = yaml.safe_load((REPO / "recipes/benchmark/stage_two.yaml").read_text())
TRUE = {"world", "aimed", "stood", "moved", "truth", "postures"}
"""Nodes of a scene that know it as it is."""
KNOWING = {"truth", "postures"}
"""Those of them that are for evaluation, and for the camera that photographs the postures."""


def taken(node: dict[str, Any]) -> set[str]:
    """Names that the inputs of a node begin with."""
    texts = [value for key, value in node.items() if key != "rule" and isinstance(value, str)]
    texts += [text for value in node.values() if isinstance(value, dict) for text in value.values()]
    return {text[1:].split(".")[0] for text in texts if isinstance(text, str) and text.startswith("$")}


def test_what_is_true_reaches_simulated_cameras_generators_and_evaluation_alone() -> None:
    met = set()
    scene = RECIPE["nodes"]["scene"]["nodes"]
    groups = [scene, *(node["nodes"] for node in scene.values() if "nodes" in node)]
    for name, node in ((name, node) for group in groups for name, node in group.items() if "rule" in node):
        stage = node["rule"].split(".")[0]
        if known := taken(node) & TRUE:
            assert stage in ("reference", "evaluate", "benchmark"), name
            met |= known
        if taken(node) & KNOWING:
            assert stage in ("evaluate", "benchmark") or node["rule"] == "reference.robot_views", name
    assert met == TRUE


def test_the_pictures_have_the_postures_options() -> None:
    """Their errors are drawn from the same seed for the same robot."""
    scene = RECIPE["nodes"]["scene"]["nodes"]
    shared = {key: value for key, value in scene["postures"].items() if key != "rule"}
    assert shared.items() <= scene["calibration_views"].items()


def built(tmp_path: Path, scenes: int, *words: str) -> tuple[Answer, dict[str, list[dict[str, str]]]]:
    """Some scenes with few things, and the tables of its targets."""
    space = Space(tmp_path)
    write_small_library(space)
    small = {
        "summary": "Scenes with few things.",
        "extends": "benchmark/stage_two",
        "nodes": {"library": {"recipe": "small/objects", "meshes": "$meshes"}},
    }
    space.write("recipes/small/stage_two.yaml", yaml.safe_dump(small))
    settings = ("--input", f"meshes={MESHES}", "--set", f"draws.scenes={scenes}")
    answer = space.dxb("build", "--console", "jsonl", "small/stage_two", *settings, *words, timeout_s=3000.0)
    assert answer.code == 0, answer.err[-3000:]
    placed = dict(line.split("\t") for line in answer.out.splitlines())
    return answer, {
        name: list(csv.DictReader((tmp_path / path).read_text().splitlines())) for name, path in placed.items()
    }


@pytest.mark.slow
@pytest.mark.timeout(3000)
@pytest.mark.skipif(not (MESHES / ".fetched").exists(), reason="no meshes: `make meshes`")
def test_the_whole_second_stage_on_two_scenes(tmp_path: Path) -> None:
    _, tables = built(tmp_path, 2)
    rows = {(row["Quantity"], row["Method"]): row for row in tables["goals"]}
    for method in ("markers alone", "plain ICP", "balanced ICP"):
        assert rows["hand", method]["Expected"] == "2"
        assert rows["hand", method]["Count"] == "2"
    assert float(rows["hand", "balanced ICP"]["Median"]) < 4.0
    ours, theirs = (float(rows["object", name]["Median"]) for name in ("align.object", "bounding boxes"))
    assert ours < 5.0 < theirs
    assert float(rows["object scale", "align.object"]["Median"]) < 2.0
    methods = {row["Method"] for row in tables["table"]}
    assert {"Ours", "True mesh, align.object", "paper, Ours"} <= methods


@pytest.mark.slow
@pytest.mark.timeout(3000)
@pytest.mark.skipif(not (MESHES / ".fetched").exists(), reason="no meshes: `make meshes`")
def test_it_builds_with_stubs(tmp_path: Path) -> None:
    """Stubs find other things than those that lie there: what they cannot place is left out and counted."""
    answer, _ = built(tmp_path, 1, "--profile", "stub")
    # The mask of a stub may show no single thing; then the true mesh of "unknown" things is none.
    assert all(".unknown[" in name and name.endswith(".asset") for name in answer.nodes("failed"))
