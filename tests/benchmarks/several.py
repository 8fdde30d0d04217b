"""Print errors of shapes and fills made from one, two and three photographs of drawn scenes.

    make meshes
    python -m tests.benchmarks.several --scenes 3

All use the masks of the first photograph. The poses of the others are found, not given.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dextera_build.api import Project
from dextera_build.artifacts.cameras.further import Further, FurtherPhotographs
from dextera_build.artifacts.objects.object import Shape
from dextera_build.errors import DxbError
from dextera_build.geometry import metrics, transforms
from dextera_build.testing import RuleRunner
from rules.benchmark.instances import overlaps
from rules.factorize.household import sides
from tests.benchmarks import catalogue

FOUND = 0.5
"""Smallest IoU of a mask with an object's."""
POINTS = 5000
"""Number of points per surface."""


@dataclass(frozen=True)
class View:
    """A drawn photograph with its truth."""

    capture: Any
    world: Any
    truth: Any


def views(recipe: str, meshes: Path, scene: int, count: int, settings: dict[str, Any]) -> list[View]:
    """The first photographs of a scene."""
    project = Project.find(catalogue.REPO)
    labels = [f"scene[{scene:04d}_{view}]" for view in range(count)]
    wanted = [f"{label}.{node}" for label in labels for node in ("photo", "aimed", "truth")]
    told = {"draws.scenes": 1, "draws.first": scene, "draws.views": count, **settings}
    built = project.build(recipe, *wanted, inputs={"meshes": meshes}, settings=told)
    return [View(*(built.artifact(f"{label}.{node}") for node in ("photo", "aimed", "truth"))) for label in labels]


class Bench:
    """Rules on one scene."""

    def __init__(self, folder: Path, shown: list[View]) -> None:
        self.run = RuleRunner(folder).run
        self.shown = shown
        capture = shown[0].capture
        self.shot = {"photograph": capture.photograph, "measured": capture.measured}
        self.support = self.run("align.support", **self.shot)
        elements = self.run("factorize.parse", **self.shot, support=self.support)
        self.objects = self.run("factorize.segment", **self.shot, support=self.support, elements=elements)

    def further(self, count: int) -> FurtherPhotographs | None:
        """The first `count` photographs besides the first, with the poses that are found."""
        items = tuple(Further(file=f"{n}.png", capture=one.capture) for n, one in enumerate(self.shown[1:][:count], 1))
        if not items:
            return None
        return self.run("align.photographs", photo=self.shown[0].capture, further=FurtherPhotographs(items=items))

    def off(self, found: FurtherPhotographs) -> list[tuple[float, float]]:
        """Errors of the poses: [mm] and [deg]."""
        first = self.shown[0].world.camera_pose.matrix
        errors = []
        for one, view in zip(found.items, self.shown[1:], strict=False):
            apart = transforms.invert(first @ one.pose.matrix) @ view.world.camera_pose.matrix
            turned = float(np.degrees(transforms.angle(apart[:3, :3])))
            errors.append((1000.0 * float(np.linalg.norm(apart[:3, 3])), turned))
        return errors

    def shapes(self, further: FurtherPhotographs | None) -> dict[str, Shape]:
        """Object -> its shape."""
        found = self.run(
            "factorize.further",
            photograph=self.shot["photograph"],
            objects=self.objects,
            support=self.support,
            **({} if further is None else {"photographs": further}),
        )
        made = {}
        for name, one in found.items.items():
            more = {} if one.further is None else {"further": one.further}
            try:
                made[name] = self.run(
                    "factorize.mesh", view=one.view, measured=one.measured, support=self.support, **more
                )
            except DxbError as error:
                print(f"  {name}: {error}")
        return made

    def errors(self, made: dict[str, Shape]) -> dict[str, dict[str, float]]:
        """True object -> errors of its shape [mm]."""
        truth = self.shown[0].truth
        names = list(truth.objects)
        matrix = overlaps(
            truth.labels.labels,
            [truth.objects[name].label for name in names],
            self.objects.map.labels,
            len(self.objects.names),
        )
        pairs = {self.objects.names[column]: names[row] for row, column in metrics.match(matrix, FOUND)}
        place = truth.camera_pose.matrix @ transforms.invert(self.support.camera_pose.matrix)
        found = {}
        for name, shape in made.items():
            if name in pairs and shape.pose is not None:
                vertices = transforms.apply(place @ shape.pose.matrix, shape.mesh.vertices.astype(np.float64))
                true = truth.objects[pairs[name]].mesh
                found[pairs[name]] = _compared(vertices, shape.mesh.faces, true)
        return found

    def fill(self, further: FurtherPhotographs | None) -> dict[str, float]:
        """Errors of the background where objects hide it in the first photograph: PSNR [dB], and depth [mm]."""
        more = {} if further is None else {"further": further}
        made = self.run("background.static", **self.shot, support=self.support, instances=self.objects.map, **more)
        world = self.shown[0].world
        # The rule of the truth needs an object: it is put out of view, under the floor.
        name, thing = next(iter(world.objects.items()))
        pose = thing.pose.model_copy(update={"matrix": transforms.rigid(np.eye(3), np.array([0.0, 0.0, -50.0]))})
        bare = world.model_copy(update={"objects": {name: thing.model_copy(update={"pose": pose})}})
        empty = self.run("reference.truth", world=bare, options={"hidden": "leave_out"})
        hidden = self.objects.map.labels > 0
        apart = (made.image.pixels.astype(float) - empty.rgb.pixels)[hidden]
        depth = np.abs(made.depth.depth - empty.depth.depth)[hidden & (made.depth.depth > 0)]
        psnr = 10.0 * float(np.log10(255.0**2 / max(float(np.mean(apart**2)), 1e-9)))
        return {"PSNR [dB]": psnr, "depth [mm]": 1000.0 * float(depth.mean())}


def _compared(vertices: np.ndarray, faces: np.ndarray, true: Any) -> dict[str, float]:
    own, other = vertices, true.vertices.astype(np.float64)
    clouds = [metrics.sample_surface(one, each, POINTS, 0) for one, each in ((own, faces), (other, true.faces))]
    heights = [float(np.ptp(one[:, 2])) for one in (own, other)]
    flat = [sides(one * [1.0, 1.0, 1e-6])[:2] for one in (own, other)]
    chamfer, _ = metrics.chamfer_and_f(*clouds, 0.01)
    return {
        "height [mm]": 1000.0 * abs(heights[0] - heights[1]),
        "width [mm]": 1000.0 * float(np.abs(flat[0] - flat[1]).mean()),
        "Chamfer [mm]": 1000.0 * chamfer,
    }


def main() -> None:
    """A line per scene and number of photographs, then medians over objects and means over scenes."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--recipe", default="benchmark/stage_one")
    options.add_argument("--meshes", type=Path, default=catalogue.FOLDER, help="what `make meshes` wrote")
    options.add_argument("--first", type=int, default=0, help="index of the first scene")
    options.add_argument("--scenes", type=int, default=3, help="number of scenes")
    options.add_argument("--things", type=int, default=4, help="number of objects in each")
    given = options.parse_args()
    totals: dict[int, dict[str, list[float]]] = {count: defaultdict(list) for count in (1, 2, 3)}
    for scene in range(given.first, given.first + given.scenes):
        settings = {"draws.count": [given.things, given.things], "draws.contact": ["apart"]}
        shown = views(given.recipe, given.meshes, scene, 3, settings)
        with tempfile.TemporaryDirectory() as folder:
            bench = Bench(Path(folder), shown)
            _scene(bench, scene, totals)
    for count, values in totals.items():
        print(f"{count} photographs: " + ", ".join(_line(name, each) for name, each in values.items()))


def _scene(bench: Bench, scene: int, totals: dict[int, dict[str, list[float]]]) -> None:
    kept: dict[int, tuple[dict[str, dict[str, float]], dict[str, float]]] = {}
    for count in totals:
        try:
            further = bench.further(count - 1)
        except DxbError as error:
            print(f"scene {scene}, {count} photographs: {error}", flush=True)
            return
        if further is not None:
            print(f"scene {scene}: poses off by", bench.off(further), flush=True)
        kept[count] = bench.errors(bench.shapes(further)), bench.fill(further)
        print(f"scene {scene}, {count} photographs: {kept[count]}", flush=True)
    # Only scenes whose photographs can all be placed are compared, and of these the objects that all have.
    for count, (errors, fill) in kept.items():
        for name in set.intersection(*(set(each[0]) for each in kept.values())):
            for key, value in errors[name].items():
                totals[count][key].append(value)
        for key, value in fill.items():
            totals[count][key].append(value)


def _line(name: str, values: list[float]) -> str:
    return f"{name} median {statistics.median(values):.2f} mean {statistics.fmean(values):.2f} of {len(values)}"


if __name__ == "__main__":
    main()
