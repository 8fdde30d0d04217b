"""Print how bodies with legs, compartments and loops are completed, from drawn photographs with true masks.

    python -m tests.benchmarks.openings                    # bodies that the tables report
    python -m tests.benchmarks.openings --half chosen      # bodies on which constants are chosen
    python -m tests.benchmarks.openings --meshes NAME ...  # foreign meshes that `make meshes` fetched
    python -m tests.benchmarks.openings --hidden           # a carton hides half of every body

Every body stands alone on the table of a random room, as in `tests.benchmarks.sizes`. *Overlap* is the intersection
over the union of the volumes. *Filled* is the share of the free space within the convex hull of the true body that
the completed body fills.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dextera_build.artifacts.objects.object import Shape
from dextera_build.artifacts.objects.view import Instance
from dextera_build.artifacts.robots.noise import ColourNoise
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.errors import DxbError
from dextera_build.geometry import lie, metrics, open3d_core, solids, transforms
from dextera_build.sim.render.sensor import measure_colour, measure_depth
from dextera_build.testing import RuleRunner
from rules.factorize.shapes.families.names import HYPOTHESES
from tests import factories, object_views
from tests.benchmarks import catalogue, household, open_bodies, quick_scenes, sizes

BEFORE = tuple(name for name in HYPOTHESES if name not in ("compartments", "legged", "prism"))
"""The families without those with openings."""
POINTS = 40_000
"""Points at which volumes are compared."""


@dataclass(frozen=True)
class Subject:
    """A body to photograph."""

    name: str
    parts: tuple[Mesh, ...]
    closed: Mesh
    """Its closed surface."""

    def moved(self, pose: np.ndarray) -> Subject:
        """The body after a rigid (4, 4) motion."""
        parts = household.Piece((*self.parts, self.closed)).moved(pose)
        return Subject(self.name, parts[:-1], parts[-1])


def drawn_bodies(half: str, seed: int, count: int) -> Iterator[Subject]:
    """`count` bodies of every kind of a half; no body of one half is in the other."""
    kinds = open_bodies.CHOSEN if half == "chosen" else open_bodies.CHOSEN | open_bodies.REPORTED
    for number, (name, make) in enumerate(kinds.items()):
        for copy in range(count):
            rng = np.random.default_rng([int(half == "chosen"), seed, number, copy])
            solid = make(rng)
            mesh = object_views.mesh(solid).model_copy(update={"colour": household.colour(rng)})
            yield Subject(f"{name} {copy}", (mesh,), mesh)


def foreign(names: list[str], meshes: Path, runner: RuleRunner) -> Iterator[Subject]:
    """The named meshes that `make meshes` fetched."""
    for recipe in (catalogue.REPORTED, catalogue.LEARNED):
        chosen = {name: entry for name, entry in catalogue.entries(recipe).items() if name in names}
        for name, thing in sizes.things_of(chosen, meshes, runner).items():
            yield Subject(name, tuple(part.mesh for part in thing.parts.values()), thing.surface)


def draw(subject: Subject, seed: int, *, hidden: bool) -> sizes.Drawn:
    """The body on the table of a random room, as a depth camera shows it, half of it behind a carton if `hidden`."""
    rng = np.random.default_rng([31, seed])
    room = quick_scenes.room(rng)
    pose = transforms.rigid(lie.about_z(rng.uniform(0.0, 2.0 * np.pi)), np.array([*rng.uniform(-0.08, 0.08, 2), 0.0]))
    stood = subject.moved(pose)
    shot = quick_scenes.photograph([stood.parts, *([_carton(stood, rng)] if hidden else [])], room, rng)
    camera_pose = shot.support.camera_pose.matrix
    capture = factories.rgbd(
        measure_colour(shot.rgb, ColourNoise(), rng),
        measure_depth(shot.depth, shot.rgb, shot.camera.matrix(), sizes.NOISE, rng),
        shot.camera,
    )
    corners = stood.closed.vertices.astype(np.float64)
    return sizes.Drawn(subject.name, capture, shot.labels, corners, camera_pose)


def _carton(stood: Subject, rng: np.random.Generator) -> tuple[Mesh, ...]:
    """A carton that stands before one half of a body, for a camera somewhere along -y."""
    low, high = stood.closed.vertices.min(axis=0), stood.closed.vertices.max(axis=0)
    half = float(high[0] - low[0]) / 2
    size = (half, 0.03, float(0.02 + 0.5 * high[2] + 0.7 * (high[1] - low[1])))
    side = float(low[0]) + half * (0.5 if rng.uniform() < 0.5 else 1.5)
    box = object_views.mesh(solids.box(size, (side, float(low[1]) - 0.02, size[2] / 2)))
    return (box.model_copy(update={"colour": household.colour(rng)}),)


@dataclass(frozen=True)
class Found:
    """A completed body beside the true one."""

    chamfer_m: float
    overlap: float
    filled: float

    @staticmethod
    def of(shape: Shape, closed: Mesh) -> Found:
        """Compare a shape with the closed surface of the body in the same world."""
        assert shape.pose is not None
        made = transforms.apply(shape.pose.matrix, shape.mesh.vertices.astype(np.float64))
        true = closed.vertices.astype(np.float64)
        samples = [
            metrics.sample_surface(points, mesh.faces, 10_000, seed)
            for seed, (points, mesh) in enumerate([(made, shape.mesh), (true, closed)])
        ]
        chamfer = metrics.chamfer_and_f(*samples, 0.01)[0]
        every = np.concatenate([made, true])
        points = np.random.default_rng(0).uniform(every.min(axis=0), every.max(axis=0), (POINTS, 3))
        in_made, in_true = inside(points, made, shape.mesh.faces), inside(points, true, closed.faces)
        hull = solids.manifold(true, closed.faces).hull().to_mesh64()
        free = inside(points, np.asarray(hull.vert_properties)[:, :3], np.asarray(hull.tri_verts)) & ~in_true
        overlap = (in_made & in_true).sum() / (in_made | in_true).sum()
        return Found(chamfer, float(overlap), float((in_made & free).sum() / max(free.sum(), 1)))


def inside(points: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Which points (N, 3) a closed surface encloses."""
    o3d = open3d_core.loaded()
    scene = o3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(
        o3d.core.Tensor(vertices.astype(np.float32)), o3d.core.Tensor(np.ascontiguousarray(faces, np.uint32))
    )
    asked = o3d.core.Tensor(points.astype(np.float32))
    return np.asarray(scene.compute_occupancy(asked, nsamples=3).numpy()) > 0.5


@dataclass(frozen=True)
class Pair:
    """What is made of one photograph without and with the families that have openings."""

    name: str
    shapes: tuple[Shape, Shape]
    found: tuple[Found, Found]


def completed(subjects: list[Subject], seed: int, *, hidden: bool) -> Iterator[Pair]:
    """The completed bodies of every photograph that has them."""
    with tempfile.TemporaryDirectory() as folder:
        runner = RuleRunner(Path(folder))
        for number, subject in enumerate(subjects):
            drawn = draw(subject, 1000 * seed + number, hidden=hidden)
            closed = Mesh(vertices=drawn.surface.astype(np.float32), faces=subject.closed.faces)
            try:
                seen, support = sizes.instance(runner, drawn)
                # From the support's own world to that of the truth.
                here = drawn.world_from_camera @ transforms.invert(support.camera_pose.matrix)
                before, after = (_shape(runner, seen, names, here) for names in (BEFORE, HYPOTHESES))
            except DxbError as error:
                print(f"| {subject.name} | - | {error} |", flush=True)
                continue
            yield Pair(subject.name, (before, after), (Found.of(before, closed), Found.of(after, closed)))


def _shape(runner: RuleRunner, seen: Instance, names: tuple[str, ...], here: np.ndarray) -> Shape:
    given = object_views.sights(seen)
    shape: Shape = runner.run("factorize.mesh", options={"primitives": {"hypotheses": names}}, **given)
    assert shape.pose is not None
    return shape.model_copy(update={"pose": shape.pose.model_copy(update={"matrix": here @ shape.pose.matrix})})


def main() -> None:
    """One row per body, and the means."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--half", default="reported", choices=("chosen", "reported"))
    options.add_argument("--count", type=int, default=2, help="number of bodies of every kind")
    options.add_argument("--seed", type=int, default=0, help="which photographs")
    options.add_argument("--hidden", action="store_true", help="a carton stands before each body")
    options.add_argument("--folder", type=Path, default=catalogue.FOLDER, help="what `make meshes` wrote")
    options.add_argument("--meshes", nargs="*", default=[], help="names of foreign meshes, instead of bodies")
    options.add_argument("--kinds", nargs="*", default=[], help="kinds of bodies, instead of all")
    given = options.parse_args()
    subjects = [
        one
        for one in drawn_bodies(given.half, given.seed, given.count)
        if not given.kinds or one.name.split()[0] in given.kinds
    ]
    if given.meshes:
        with tempfile.TemporaryDirectory() as folder:
            subjects = list(foreign(given.meshes, given.folder, RuleRunner(Path(folder))))
    print("| body | family before | now | Chamfer-L1 before, now [mm] | overlap | filled |\n|---|---|---|---|---|---|")
    rows = []
    for pair in completed(subjects, given.seed, hidden=given.hidden):
        values = np.array([[1000 * one.chamfer_m, one.overlap, one.filled] for one in pair.found])
        families = " | ".join(shape.hypothesis for shape in pair.shapes)
        figures = f"{values[0, 0]:.1f}, {values[1, 0]:.1f} | {values[0, 1]:.2f}, {values[1, 1]:.2f}"
        print(f"| {pair.name} | {families} | {figures} | {values[0, 2]:.2f}, {values[1, 2]:.2f} |", flush=True)
        rows.append(values)
    told = np.array(rows)
    draws = told[np.random.default_rng(0).integers(0, len(told), (2000, len(told)))].mean(axis=1)
    low, high = np.quantile(draws, [0.025, 0.975], axis=0)
    for side, name in enumerate(("before", "now")):
        means = " | ".join(
            f"{told[:, side, one].mean():.2f} [{low[side, one]:.2f}, {high[side, one]:.2f}]" for one in range(3)
        )
        print(f"| mean of {len(told)}, {name} | | | {means} |")


if __name__ == "__main__":
    main()
