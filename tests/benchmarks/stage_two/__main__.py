"""`benchmark/stage_two` beside small_gicp and roboreg: `python -m tests.benchmarks.stage_two --meshes FOLDER`.

Builds the recipe, adds what `others` can run to the same rules of stage `evaluate`, and prints both tables as Markdown.
`--picture FILE` draws the meshes that were placed and the robot's outline by its calibration over some photographs.
"""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from typing import Any

from dextera_build.api import Project, Result
from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.objects.object import Body, Placement
from dextera_build.artifacts.objects.view import Seen
from dextera_build.artifacts.table import Table
from dextera_build.errors import DxbError
from dextera_build.testing import RuleRunner

from . import others, picture

REPO = Path(__file__).parents[3]
RECIPE = "benchmark/stage_two"
GOALS = {"hand": 2.0, "object": 5.0, "object angle": 3.0, "object scale": 2.0, "scene scale": 0.5}
METHODS = {
    "markers alone": "markers",
    "plain ICP": "plain",
    "balanced ICP": "balanced",
    "align.base": "base",
    "align.object": "placed",
    "bounding boxes": "boxed",
    "Open3D ICP with scaling": "registered",
    "align.scene": "scaled",
}
SHAPES = {
    "Ours": "whole",
    "Bounding box as mesh": "boxes",
    "True mesh, align.object": "true_placed",
    "True mesh, bounding boxes": "true_boxed",
    "True mesh, Open3D ICP with scaling": "true_registered",
}


class Scenes:
    """What the recipe built.

    Args:
        built: Result of the build.
    """

    def __init__(self, built: Result) -> None:
        self._built = built
        self.labels = sorted({match[1] for name in built.nodes if (match := re.match(r"scene\[(\w+)\]\.", name))})

    def get(self, scene: str, node: str) -> Any:
        """The artifact of a node of one scene; None if it failed."""
        try:
            return self._built.artifact(f"scene[{scene}].{node}")
        except DxbError:
            return None

    def robot(self) -> Any:
        """The robot that all scenes share."""
        return self._built.artifact(next(name for name in self._built.nodes if name.endswith(":robot")))

    def table(self, node: str) -> Table | None:
        """A table of the whole recipe; None if it failed."""
        try:
            found = self._built.artifact(node)
        except DxbError:
            return None
        assert isinstance(found, Table)
        return found

    def objects(self, scene: str) -> dict[str, tuple[Body, Seen]]:
        """Name -> asset of unknown frame and its view."""
        found, pattern = {}, re.compile(rf"scene\[{scene}\]\.unknown\[(.+)\]\.asset")
        named = self.get(scene, "twin/named")
        for node in self._built.nodes:
            if (match := pattern.fullmatch(node)) and named is not None:
                asset, instance = self.get(scene, f"unknown[{match[1]}].asset"), named.items[match[1]]
                if asset is not None and instance.measured is not None:
                    found[match[1]] = asset, Seen(instance.view, instance.measured)
        return found


def gicp_tables(run: RuleRunner, scenes: Scenes) -> dict[str, tuple[Table, Table]]:
    """Scene -> errors and metrics of small_gicp; nothing without the package."""
    module = others.optional("small_gicp")
    found = {}
    for scene in scenes.labels if module else ():
        objects = scenes.objects(scene)
        placed = {name: others.gicp(body, seen, module) for name, (body, seen) in objects.items()}
        if not placed:
            continue
        assets = Collection[Body](items={name: body for name, (body, _) in objects.items()})
        placements = Collection[Placement](items=placed)
        support, stood = scenes.get(scene, "twin/support"), scenes.get(scene, "stood")
        truth, photo = scenes.get(scene, "truth"), scenes.get(scene, "photo")
        errors = run.run("benchmark.pose_errors", world=stood, assets=assets, placements=placements, support=support)
        metrics = run.run(
            "evaluate.objects",
            truth=truth,
            bodies=assets,
            placements=placements,
            support=support,
            camera=photo.photograph.camera,
            options={"least_visible": 0.25, "whole": True, "summary": False},
        )
        found[scene] = errors, metrics
    return found


def hydra_tables(run: RuleRunner, scenes: Scenes, *, centroids: bool) -> dict[str, Table]:
    """Scene -> errors of roboreg's registration; nothing without the package."""
    module = others.optional("roboreg.registration.point_cloud.hydra")
    found, robot = {}, scenes.robot()
    for scene in scenes.labels if module else ():
        views, marked = scenes.get(scene, "calibration_views"), scenes.get(scene, "marked")
        stood = scenes.get(scene, "stood")
        if marked is None:
            continue
        made = others.hydra(views, robot, marked, module, centroids=centroids)
        found[scene] = run.run(
            "benchmark.calibration_error",
            world=stood,
            robot=robot,
            views=views,
            postures=scenes.get(scene, "postures"),
            calibration=made,
        )
    return found


def markdown(table: Table) -> str:
    """The table with its notes."""
    head = [column.heading for column in table.columns]
    lines = [" | ".join(head), "|".join(["---"] * len(head))]
    lines += [
        " | ".join(table.text(cell, column) for cell, column in zip(row, table.columns, strict=True))
        for row in table.rows
    ]
    return "\n".join([f"| {line} |" for line in lines] + [f"* {note}" for note in table.notes])


def main() -> None:
    """Build, add the others, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--meshes", type=Path, required=True, help="the folder that `make meshes` writes")
    parser.add_argument("--scenes", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--picture", type=Path)
    parser.add_argument("--recipe", default=RECIPE, help="a recipe that extends it")
    parser.add_argument("--scratch", type=Path, default=Path("/tmp/dxb-stage-two"))
    given = parser.parse_args()
    built = Project.find(Path.cwd()).build(
        given.recipe,
        inputs={"meshes": given.meshes},
        settings={"draws.scenes": given.scenes, "draws.first": given.first},
        keep_going=True,
    )
    scenes, run = Scenes(built), RuleRunner(given.scratch)
    methods = {name: table for name, node in METHODS.items() if (table := scenes.table(node))}
    shapes = {name: table for name, node in SHAPES.items() if (table := scenes.table(node))}
    small = gicp_tables(run, scenes)
    extra = {
        "small_gicp": {scene: errors for scene, (errors, _) in small.items()},
        "roboreg from markers": hydra_tables(run, scenes, centroids=False),
        "roboreg from centroids": hydra_tables(run, scenes, centroids=True),
    }
    for name, tables in extra.items():
        if tables:
            methods[name] = run.run("benchmark.gather", tables=Collection[Table](items=tables))
    if small:
        metrics = Collection[Table](items={scene: table for scene, (_, table) in small.items()})
        shapes["True mesh, small_gicp"] = run.run("benchmark.gather", tables=metrics)
    expected = built.artifact("expected")
    goals = run.run(
        "benchmark.error_limits",
        tables=Collection[Table](items=methods),
        drawn=built.artifact("draws"),
        objects=expected,
        options={"medians": GOALS},
    )
    compared = run.run("benchmark.method_table", tables=Collection[Table](items=shapes), expected=expected)
    print(markdown(goals), markdown(compared), sep="\n\n")
    if given.picture:
        picture.save(given.picture, scenes)


if __name__ == "__main__":
    main()
