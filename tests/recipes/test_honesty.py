"""What only a simulator knows reaches the rules that make pictures and worlds, and those that judge, and no others."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from dextera_build.artifacts.robots.cell import Cell
from dextera_build.artifacts.scenes.scene import Truth
from dextera_build.artifacts.scenes.world import World
from dextera_build.engine.graph import Gather, Graph, Group, Input, Item, Output, parts_of
from dextera_build.project import project
from dextera_build.recipe import schema
from dextera_build.recipe.plan import Request, plan

ROOT = Path(__file__).parents[2]
PROJECT = project.find(ROOT)
JUDGES = ("evaluate.", "benchmark.")
"""Stages whose rules compare with the truth."""
STAND_INS = {"reference.task", "simulate.perturbed"}
"""Rules whose task is one in a world that stands in for hardware."""
OF_WORLDS = {
    *("reference.photograph", "reference.robot_views", "reference.truth", "reference.background_views"),
    "reference.move_camera",
    *("reference.look_at", "reference.place_robot", "reference.open_joints", "reference.task", "simulate.cell"),
}
"""Rules that take a world apart from those that judge: they render it, move its camera, put a robot into it, or make a
stand-in of it."""
RECORDS = {"reference.episodes", "demonstrate.recorded_film"}
"""Rules that run a task in a world that stands in for hardware, and return what its cell or a camera measures."""
RECIPES = [
    *("twin/laptop_scene", "task/close_laptop", "task/lift_blue_mug", "task/lift_mustard_bottle"),
    *("benchmark/first_policies", "benchmark/recalibration", "benchmark/objects", "benchmark/rooms"),
    *("benchmark/tasks", "dataset/kl/lift_mustard_bottle"),
]


def dishonest(graph: Graph) -> list[str]:
    """Edges by which truth, or a verdict, gets where hardware would not have it."""
    rules = {name: call.rule.path for name, call in graph.calls()}
    over = dict(_groups(graph))
    found = []
    for name, call in graph.calls():
        for slot, given in call.inputs.items():
            for source in _sources(given, over):
                if source in rules and not _may_read(call.rule.path, rules[source]):
                    found.append(f"{'/'.join(name)} ({call.rule.path}) reads {'/'.join(source)} as `{slot}`")
    return found


def _may_read(reader: str, source: str) -> bool:
    judges = reader.startswith(JUDGES)
    returns = PROJECT.library.find(source).rule.returns
    if returns is World:
        return judges or reader in OF_WORLDS
    if returns is Cell or source in STAND_INS:
        return judges or reader in RECORDS
    if returns is Truth or source.startswith(JUDGES):
        return judges
    return True


def _sources(given: Input, over: dict[tuple[str, ...], Input]) -> Iterator[tuple[str, ...]]:
    for part in parts_of(given):
        if isinstance(part, Output | Gather):
            yield part.call
        elif isinstance(part, Item) and part.group in over:
            yield from _sources(over[part.group], over)


def _groups(graph: Graph) -> Iterator[tuple[tuple[str, ...], Input]]:
    waiting = [((name,), member) for name, member in graph.members.items()]
    while waiting:
        address, member = waiting.pop()
        if isinstance(member, Group):
            if isinstance(member.over, Output | Item):
                yield address, member.over
            waiting += [((*address, name), below) for name, below in member.members.items()]


def resolved(address: str, folder: Path, **recipes: schema.Recipe) -> Graph:
    """The graph of a recipe of the project, or of `recipes`; any folder is its photograph."""
    recipe = recipes.get(address) or PROJECT.recipe(address)
    assert recipe is not None
    needed = [name for name, decl in recipe.inputs.items() if decl.default is None and not decl.optional]
    request = Request(inputs={name: str(folder) for name in needed})
    read = lambda name: recipes.get(name) or PROJECT.recipe(name)  # noqa: E731
    return plan(address, read, PROJECT.library, ROOT, request).graph


@pytest.mark.medium
@pytest.mark.parametrize("address", RECIPES)
def test_truth_reaches_pictures_worlds_and_judges_alone(address, tmp_path):
    assert dishonest(resolved(address, tmp_path)) == []


def test_there_is_truth_to_be_kept_apart(tmp_path):
    paths = {call.rule.path for _, call in resolved("benchmark/first_policies", tmp_path).calls()}
    assert {"reference.world", "reference.truth", "simulate.cell", *STAND_INS} <= paths


CHEATS = {
    "ppo: {rule: learn.ppo, bundle: $reference}": "ppo (learn.ppo) reads reference as `bundle`",
    "sources: {rule: demonstrate.operate, bundle: $reference, episodes: 10}": (
        "sources (demonstrate.operate) reads reference as `bundle`"
    ),
    "film: {rule: demonstrate.film, bundle: $reference, episodes: $episodes, view: $view}": (
        "film (demonstrate.film) reads reference as `bundle`"
    ),
    "view: {rule: simulate.view, scene: $scene}\n  extra: {rule: background.robot, robot: $robot,"
    " camera: $cell.camera, mount: $cell.eye}": "extra (background.robot) reads cell as `mount`",
}
"""Nodes that a recipe for cheats adds to task/close_laptop -> what is said about them."""


@pytest.mark.parametrize("nodes", CHEATS)
def test_a_dishonest_recipe_is_found_out(nodes, tmp_path):
    file = tmp_path / "cheat.yaml"
    targets = "targets: {default: [act, ppo, film" + (", extra]}" if "extra:" in nodes else "]}")
    file.write_text(f"summary: Cheats.\nextends: task/close_laptop\nnodes:\n  {nodes}\n{targets}\n")
    base = PROJECT.recipe("task/close_laptop")
    assert base is not None
    cheat = schema.read(file, "task/cheat").over(base)
    assert CHEATS[nodes] in dishonest(resolved("task/cheat", tmp_path, **{"task/cheat": cheat}))
