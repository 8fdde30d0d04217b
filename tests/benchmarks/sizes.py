"""Print heights and widths of bodies of drawn objects with true masks, on depth with smeared edges.

    make meshes
    python -m tests.benchmarks.sizes                          # meshes that the tables report
    python -m tests.benchmarks.sizes --recipe objects_learn   # meshes on which constants are chosen

Every mesh stands alone on the table of a random room. The depth is that of the drawn scenes; the support is found in
it. *Across* is the width that the camera sees from side to side, *along* the depth of the body, whose far end it hides.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dextera_build.artifacts.base import Collection, Folder
from dextera_build.artifacts.cameras.camera import Capture
from dextera_build.artifacts.objects.object import Shape, Support
from dextera_build.artifacts.objects.view import Instance, Traits
from dextera_build.artifacts.robots.noise import ColourNoise, DepthNoise
from dextera_build.artifacts.scenes.world import Thing
from dextera_build.errors import DxbError
from dextera_build.geometry import lie, transforms
from dextera_build.sim.render.sensor import measure_colour, measure_depth
from dextera_build.testing import RuleRunner
from rules.factorize.masks.cutting import Cutter, Said
from rules.factorize.measured import Measurements, Workspace
from tests import factories, object_views
from tests.benchmarks import catalogue, household, quick_scenes

NOISE = DepthNoise(edge_loss=0.5, smear=0.5, dark_loss=0.4, shine_loss=0.8)
"""That of `benchmark/drawn`."""
SIDES = ("height", "across", "along")


@dataclass(frozen=True)
class Drawn:
    """A photograph of one thing, and what is to be found."""

    name: str
    capture: Capture
    labels: np.ndarray  # (H, W) int32, 1 on the thing
    surface: np.ndarray  # (N, 3) its corners in the world of the truth [m]
    world_from_camera: np.ndarray  # (4, 4) in the same world


def draw(name: str, thing: Thing, seed: int) -> Drawn:
    """The thing on the table of a random room, as a depth camera shows it."""
    rng = np.random.default_rng([31, seed])
    room = quick_scenes.room(rng)
    pose = transforms.rigid(lie.about_z(rng.uniform(0.0, 2.0 * np.pi)), np.array([*rng.uniform(-0.08, 0.08, 2), 0.0]))
    parts = tuple(household.Piece((part.mesh,)).moved(pose)[0] for part in thing.parts.values())
    shot = quick_scenes.photograph([parts], room, rng)
    capture = factories.rgbd(
        measure_colour(shot.rgb, ColourNoise(), rng),
        measure_depth(shot.depth, shot.rgb, shot.camera.matrix(), NOISE, rng),
        shot.camera,
    )
    surface = np.concatenate([part.vertices for part in parts]).astype(np.float64)
    return Drawn(name, capture, shot.labels, surface, shot.support.camera_pose.matrix)


def things(recipe: str, meshes: Path, runner: RuleRunner) -> dict[str, Thing]:
    """The meshes of a recipe, as they stand."""
    return things_of(catalogue.entries(recipe), meshes, runner)


def things_of(entries: dict[str, dict[str, Any]], meshes: Path, runner: RuleRunner) -> dict[str, Thing]:
    """The meshes of these entries of a recipe, as they stand."""
    files = {
        path: (meshes / path).read_bytes()
        for entry in entries.values()
        for part in entry["parts"]
        for path in (part["file"], part.get("texture"))
        if path
    }
    found = runner.run("reference.catalogue", options={"entries": entries}, folder=Folder(files=files))
    assert isinstance(found, Collection)
    return dict(found.items)


def instance(runner: RuleRunner, drawn: Drawn) -> tuple[Instance, Support]:
    """The object with its true mask, over the support that is found in the depth."""
    given = factories.shot(drawn.capture)
    support = runner.run("align.support", **given)
    measured = drawn.capture.measured
    assert measured is not None
    photograph = drawn.capture.photograph
    space = Workspace(photograph, measured.depth.depth, support)
    # Reading is what labels a result; here nothing is labelled.
    depth = Measurements(None, space, "")  # type: ignore[arg-type]
    depth.taken = True
    said = Said("thing", Traits(category="object", body_type="rigid", material="plastic"), "rgbd")
    names = ("thing", *(f"before {number}" for number in range(2, int(drawn.labels.max()) + 1)))
    cut = Cutter(photograph, measured, support, depth).cut_out(drawn.labels, dict.fromkeys(names, said), [], 24)
    return cut.items["thing"], support


def extents(points: np.ndarray, world_from_camera: np.ndarray) -> np.ndarray:
    """Height, width across and width along the horizontal line of sight (3,) [m] of points (N, 3), z up."""
    ahead = np.median(points[:, :2], axis=0) - world_from_camera[:2, 3]
    ahead = ahead / np.linalg.norm(ahead)
    across = points[:, :2] @ np.array([-ahead[1], ahead[0]])
    return np.array([points[:, 2].max(), np.ptp(across), np.ptp(points[:, :2] @ ahead)])


def placed(shape: Shape) -> np.ndarray:
    """Corners (N, 3) of a body in the world of its support [m]."""
    assert shape.pose is not None
    return transforms.apply(shape.pose.matrix, shape.mesh.vertices.astype(np.float64))


def errors(recipe: str, meshes: Path, seed: int, limit: int) -> Iterator[tuple[str, str, np.ndarray, np.ndarray]]:
    """Name, family, true extents (3,) and errors (3,) [m] of every object."""
    with tempfile.TemporaryDirectory() as folder:
        runner = RuleRunner(Path(folder))
        for number, (name, thing) in enumerate(list(things(recipe, meshes, runner).items())[:limit]):
            drawn = draw(name, thing, 1000 * seed + number)
            try:
                seen, support = instance(runner, drawn)
                shape = runner.run("factorize.mesh", **object_views.sights(seen))
            except DxbError as error:
                print(f"| {name} | - | {error} |", flush=True)
                continue
            true = extents(drawn.surface, drawn.world_from_camera)
            yield name, shape.hypothesis, true, extents(placed(shape), support.camera_pose.matrix) - true


def main() -> None:
    """One row per object, and the means."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--recipe", default=catalogue.REPORTED, choices=(catalogue.REPORTED, catalogue.LEARNED))
    options.add_argument("--meshes", type=Path, default=catalogue.FOLDER, help="what `make meshes` wrote")
    options.add_argument("--seed", type=int, default=0, help="which photographs")
    options.add_argument("--limit", type=int, default=1000, help="number of meshes")
    given = options.parse_args()
    print("| object | family | true height, across, along [mm] | errors [mm] |\n|---|---|---|---|")
    rows = []
    for name, family, true, error in errors(given.recipe, given.meshes, given.seed, given.limit):
        sizes = " x ".join(f"{1000 * side:.0f}" for side in true)
        print(f"| {name} | {family} | {sizes} | {', '.join(f'{1000 * side:+.1f}' for side in error)} |", flush=True)
        rows.append(1000 * error)
    told = np.array(rows)
    draws = told[np.random.default_rng(0).integers(0, len(told), (2000, len(told)))].mean(axis=1)
    print("\n| quantity | objects | mean error [mm] | median error [mm] | median absolute error [mm] |")
    print("|---|---|---|---|---|")
    for column, side in enumerate(SIDES):
        low, high = np.quantile(draws[:, column], [0.025, 0.975])
        own = told[:, column]
        middle = f"{np.median(own):+.2f} | {np.median(np.abs(own)):.2f}"
        print(f"| {side} | {len(own)} | {own.mean():+.2f} [{low:+.2f}, {high:+.2f}] | {middle} |")


if __name__ == "__main__":
    main()
