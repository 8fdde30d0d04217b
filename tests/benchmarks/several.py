"""Print errors of shapes and fills made from one, two and three photographs of drawn scenes.

    python -m tests.benchmarks.several --scenes 4

Things of `household` stand apart on a table of `quick_scenes`; neighbouring photographs are 40 degrees apart, with the
noise, smear and gaps of a stereo camera. All use the masks of the first photograph. The poses of the others are found,
not given.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera, Capture, Measured, Photograph
from dextera_build.artifacts.cameras.further import Further, FurtherPhotographs
from dextera_build.artifacts.cameras.image import DepthImage, Image
from dextera_build.artifacts.objects.object import Shape
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.errors import DxbError
from dextera_build.geometry import cameras, metrics, transforms
from dextera_build.sim.render.sensor import measure_colour, measure_depth
from dextera_build.testing import RuleRunner
from rules.benchmark.instances import overlaps
from rules.factorize.household import sides
from rules.reference.sensor import ColourNoiseOptions, DepthNoiseOptions
from tests.benchmarks import household, quick_scenes

FOUND = 0.5
"""Smallest IoU of a mask with an object's."""
POINTS = 5000
"""Number of points per surface."""
CAMERA = Camera(width=640, height=480, fx=614.4, fy=614.4, cx=319.5, cy=239.5)
HEADINGS = (-40.0, 0.0, 40.0)
"""Headings of the photographs [deg]."""
KINDS = (household.carton, household.can, household.bowl, household.mug, household.bottle, household.book)
SPOTS = ((-0.16, -0.04), (0.0, 0.08), (0.16, -0.05), (0.02, -0.14))
"""Places of the things on the table [m]."""


@dataclass(frozen=True)
class View:
    """A drawn photograph with its truth."""

    capture: Capture
    pose: np.ndarray  # (4, 4) T_world_camera
    labels: np.ndarray  # (H, W) int32
    empty: np.ndarray  # (H, W, 3) sRGB 0..255 without things
    far: np.ndarray  # (H, W) depth [m] without things


def drawn(seed: int, count: int) -> tuple[list[View], list[tuple[Mesh, ...]]]:
    """The photographs of a scene with so many things, and the things, posed."""
    rng = np.random.default_rng(seed)
    around = quick_scenes.room(rng)
    things = []
    for number, (x, y) in enumerate(SPOTS[:count]):
        piece = KINDS[(seed + number) % len(KINDS)](rng)
        turn = quick_scenes.about(2, rng.uniform(0.0, 2.0 * np.pi))
        low = min(float(part.vertices[:, 2].min()) for part in piece.parts)
        things.append(piece.moved(transforms.rigid(turn, np.array([x, y, -low]))))
    pitch, distance = np.radians(rng.uniform(32.0, 45.0)), float(rng.uniform(0.65, 0.85))
    found = []
    for degrees in HEADINGS:
        pose = cameras.look_down(np.array([0.0, 0.0, 0.03]), distance, float(np.radians(degrees)), float(pitch), 0.0)
        room, light = list(around.surfaces), (around.lamps, around.ambient)
        parts = [quick_scenes.surface(part) for own in things for part in own]
        owners = [label for label, own in enumerate(things, start=1) for _ in own]
        rgb, depth, labels = quick_scenes.shoot(parts + room, np.array(owners + [0] * len(room)), *light, CAMERA, pose)
        empty, far, _ = quick_scenes.shoot(room, np.zeros(len(room), int), *light, CAMERA, pose)
        depth = np.where(np.isfinite(depth), depth, 0.0)
        noise = DepthNoiseOptions(edge_loss=0.5, smear=0.5, dark_loss=0.4, shine_loss=0.8)
        measured = measure_depth(depth, rgb, CAMERA.matrix(), noise, rng)
        pixels = measure_colour(rgb, ColourNoiseOptions(), rng)
        photograph = Photograph(rgb=Image(pixels=pixels), camera=CAMERA)
        capture = Capture(photograph=photograph, measured=Measured(depth=DepthImage(depth=measured)))
        found.append(View(capture, pose, labels, 255.0 * empty, np.where(np.isfinite(far), far, 0.0)))
    return found, things


class Bench:
    """Rules on one scene."""

    def __init__(self, folder: Path, seed: int, count: int) -> None:
        self.run = RuleRunner(folder).run
        shown, self.things = drawn(seed, count)
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
        first = self.shown[0].pose
        errors = []
        for one, view in zip(found.items, self.shown[1:], strict=False):
            apart = transforms.invert(first @ one.pose.matrix) @ view.pose
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
        """True thing -> errors of its shape [mm]."""
        numbers = range(1, len(self.things) + 1)
        matrix = overlaps(self.shown[0].labels, list(numbers), self.objects.map.labels, len(self.objects.names))
        pairs = {self.objects.names[column]: row for row, column in metrics.match(matrix, FOUND)}
        place = self.shown[0].pose @ transforms.invert(self.support.camera_pose.matrix)
        found = {}
        for name, shape in made.items():
            if name in pairs and shape.pose is not None:
                vertices = transforms.apply(place @ shape.pose.matrix, shape.mesh.vertices.astype(np.float64))
                found[str(pairs[name])] = _compared(vertices, shape.mesh.faces, self.things[pairs[name]])
        return found

    def fill(self, further: FurtherPhotographs | None) -> dict[str, float]:
        """Errors of the background where objects hide it in the first photograph: PSNR [dB], and depth [mm]."""
        more = {} if further is None else {"further": further}
        made = self.run("background.static", **self.shot, support=self.support, instances=self.objects.map, **more)
        hidden = self.objects.map.labels > 0
        apart = (made.image.pixels.astype(float) - self.shown[0].empty)[hidden]
        depth = np.abs(made.depth.depth - self.shown[0].far)[hidden & (made.depth.depth > 0)]
        psnr = 10.0 * float(np.log10(255.0**2 / max(float(np.mean(apart**2)), 1e-9)))
        return {"PSNR [dB]": psnr, "depth [mm]": 1000.0 * float(depth.mean())}


def _compared(vertices: np.ndarray, faces: np.ndarray, true: tuple[Mesh, ...]) -> dict[str, float]:
    own, other = vertices, np.concatenate([part.vertices for part in true]).astype(np.float64)
    starts = np.cumsum([0, *(len(part.vertices) for part in true)])
    corners = np.concatenate([part.faces + start for part, start in zip(true, starts, strict=False)])
    clouds = [metrics.sample_surface(one, each, POINTS, 0) for one, each in ((own, faces), (other, corners))]
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
    options.add_argument("--first", type=int, default=0, help="seed of the first scene")
    options.add_argument("--scenes", type=int, default=4, help="number of scenes")
    options.add_argument("--things", type=int, default=len(SPOTS), help="number of things in each")
    given = options.parse_args()
    totals: dict[int, dict[str, list[float]]] = {count: defaultdict(list) for count in (1, 2, 3)}
    for seed in range(given.first, given.first + given.scenes):
        with tempfile.TemporaryDirectory() as folder:
            _scene(Bench(Path(folder), seed, given.things), seed, totals)
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
