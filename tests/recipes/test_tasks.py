"""The tasks of the paper: all 18 are recipes, and nothing in the code knows any of them."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from dextera_build.recipe import strict_yaml
from rules.evaluate import published
from rules.evaluate.series import SeriesOptions

ROOT = Path(__file__).parents[2]
TASKS = sorted(path for arm in ("ob", "kl") for path in (ROOT / "recipes" / "task" / arm).glob("*.yaml"))
EVALUATED = {
    "ob": {
        "LiftToyBus",
        "LiftBlueMug",
        "PlaceToyBusInBasket",
        "HandoverGrayBowl",
        "BimanualLiftBasket",
        "ReorientThermometer",
        "BimanualLiftBox",
        "PushBlueCube",
        "BimanualPlaceBoxInBasket",
        "CloseLaptop",
    },
    "kl": {"PlaceCoconutWaterInBasket", "LiftMustardBottle", "CloseLaptop"},
}
EXAMPLES = {"PushT", "ReorientCamera", "StackBowls", "OpenScissors", "OpenSunglasses"}


def read(path: Path) -> dict:
    return strict_yaml.parse(path.read_text(), str(path)).plain()


def test_every_pair_of_the_paper_has_a_recipe_and_a_row_in_the_benchmark() -> None:
    found = {(path.parent.name, read(path)["nodes"]["task"]["name"]) for path in TASKS}
    wanted = {(arm, name) for arm, names in EVALUATED.items() for name in names} | {("ob", name) for name in EXAMPLES}
    assert found == wanted
    nodes = read(ROOT / "recipes" / "benchmark" / "tasks.yaml")["nodes"]
    built = {node["recipe"] for node in nodes.values() if "recipe" in node}
    assert built == {f"task/{path.parent.name}/{path.stem}" for path in TASKS}
    assert len(nodes["evaluated"]["tables"]) == 13
    assert len(nodes["examples"]["tables"]) == 5
    pairs = nodes["evaluated"]["tables"]
    assert nodes["elsewhere"]["tables"] == {name: f"${name}.elsewhere" for name in pairs}


def test_every_pair_of_the_paper_has_a_data_set_of_both_worlds() -> None:
    found = sorted(path for arm in ("ob", "kl") for path in (ROOT / "recipes" / "dataset" / arm).glob("*.yaml"))
    pairs = {path.parent.name + "/" + path.stem: read(path)["nodes"]["pair"]["recipe"] for path in found}
    nodes = read(ROOT / "recipes" / "benchmark" / "tasks.yaml")["nodes"]
    assert pairs == {nodes[name]["recipe"].removeprefix("task/"): nodes[name]["recipe"] for name in evaluated(nodes)}
    whole = read(ROOT / "recipes" / "dataset" / "all.yaml")["nodes"]
    assert {whole[name]["recipe"] for name in evaluated(nodes)} == {f"dataset/{pair}" for pair in pairs}
    assert whole["twin"]["episodes"] == {name: f"${name}.pair.episodes" for name in evaluated(nodes)}
    assert whole["reference"]["episodes"] == {name: f"${name}.data.recorded" for name in evaluated(nodes)}
    assert whole["replayed"]["trials"] == {name: f"${name}.data.replay" for name in evaluated(nodes)}
    shared = read(ROOT / "recipes" / "task" / "shown.yaml")["nodes"], read(ROOT / "recipes/dataset/pair.yaml")["nodes"]
    assert [len(pairs) * nodes["shards"]["episodes"] for nodes in shared] == [3900, 390]
    assert shared[0]["sources"]["episodes"] == 10
    assert len(pairs) * shared[1]["replay"]["trials"] == sum(rate.trials for rate in published.REPLAY.values())


def test_tables_have_the_papers_names_of_its_robots() -> None:
    robots = {read(path)["inputs"]["robot"].removeprefix("robot/") for path in TASKS}
    assert set(SeriesOptions().robots) == robots
    assert {robot for robot, _ in published.REPLAY} == set(SeriesOptions().robots.values())


def evaluated(nodes: dict) -> list[str]:
    return list(nodes["evaluated"]["tables"])


@pytest.mark.parametrize("folder", ["dextera_build/sim", "rules/demonstrate", "rules/simulate", "rules/evaluate"])
def test_no_code_knows_a_task_or_its_object(folder: str) -> None:
    tasks = [read(path)["nodes"]["task"] for path in TASKS]
    # A box, a basket and a camera are words of their own.
    words = {task["name"] for task in tasks} | {task["object"] for task in tasks if "_" in task["object"]}
    known = {}
    for path in sorted((ROOT / folder).rglob("*.py")):
        # The paper's own numbers stand there as a table.
        if path.name != "published.py":
            texts = {node.value for node in ast.walk(without_docstrings(path)) if isinstance(node, ast.Constant)}
            known |= {str(path.relative_to(ROOT)): found} if (found := words & {*map(str, texts)}) else {}
    assert not known


def without_docstrings(path: Path) -> ast.Module:
    tree = ast.parse(path.read_text())
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            node.body = [
                each for each in body if not (isinstance(each, ast.Expr) and isinstance(each.value, ast.Constant))
            ]
    return tree
