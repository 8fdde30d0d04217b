"""How often the stated 95 % region of a tracked pose holds the truth: `python -m tests.benchmarks.tracking.coverage`.

Each draw is the last frame of a short sequence: three foreign meshes, at random places, standing or carried
about, before a camera that stands or moves, sometimes with a hand before them. Poses start a few millimetres off.
Position, rotation and both together are judged against chi-squared quantiles. Other seeds draw other sequences.

`--mesh-mm 1.5` gives the tracker meshes that are bent by so much (standard deviation of a smooth field without rigid
motion), and states it to the tracker. `--keep FOLDER` stores rendered frames for another run.
"""

from __future__ import annotations

import argparse
import itertools
import sys
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.cameras.rgbd_video import RgbdFrame
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.geometry import convex, lie, metrics, transforms
from dextera_build.statistics import wilson
from dextera_build.tracking.model import Model
from dextera_build.tracking.tracker import Tracker
from tests.benchmarks.tracking import sequences, things
from tests.benchmarks.tracking.scene import Actor, Sequence, before, frames, standing
from tests.benchmarks.tracking.scene import Path as Way

FRAMES, RATE = 4, 30.0
LENS = Camera(width=400, height=300, fx=600.0, fy=600.0, cx=199.5, cy=149.5)
"""The camera of the other benchmark, without the outer parts of its pictures."""
WAVES = 6
"""Waves of which the field that bends a mesh is the sum, along each axis."""


@dataclass(frozen=True)
class Draw:
    """A pose that was called `tracked`, beside the true one."""

    name: str
    kind: str  # `standing` or `moving`, with the camera's
    seen: float  # part of it that is seen
    deviation: np.ndarray  # (6,) twist from the true pose
    stated: np.ndarray  # (6, 6) covariance


def sequence(meshes: Mapping[str, Mesh], random: np.random.Generator, name: str) -> Sequence:
    """Three things and perhaps a hand before a camera, none inside another one."""
    while True:
        made = _sequence(meshes, random, name)
        if all(_apart(made.actors, time) for time in (0.0, made.seconds)):
            return made


def _apart(actors: Mapping[str, Actor], time: float) -> bool:
    hulls = [_hull(actor.links["base"], actor.path(time)) for actor in actors.values()]
    return all(one.overlap(other)[0] <= 0.0 for one, other in itertools.combinations(hulls, 2))


def _hull(mesh: Mesh, pose: np.ndarray) -> convex.Convex:
    """The convex hull by its corners that are farthest along many directions."""
    ways = np.random.default_rng(0).normal(size=(60, 3))
    corners = mesh.vertices[np.unique((mesh.vertices @ ways.T).argmax(axis=0))]
    return convex.Convex(transforms.apply(pose, corners.astype(np.float64)))


def _sequence(meshes: Mapping[str, Mesh], random: np.random.Generator, name: str) -> Sequence:
    chosen = random.choice(sorted(meshes), 3, replace=False)
    sides = random.permutation([-1.0, 0.0, 1.0])
    actors = {each: Actor({"base": meshes[each]}, _way(random, side)) for each, side in zip(chosen, sides, strict=True)}
    if random.uniform() < 0.3:
        reach = random.uniform(-0.1, 0.1)
        turn = things.turned((1, 0, 0), random.uniform(0, 40))
        hand = transforms.rigid(np.eye(3), np.array([reach, -0.12, random.uniform(0.08, 0.14)])) @ turn
        actors["hand"] = Actor({"base": things.hand()}, lambda time: hand, tracked=False)
    return Sequence(name, actors, _camera(random), FRAMES / RATE, RATE, LENS)


def _way(random: np.random.Generator, side: float) -> Way:
    x, y, yaw = (
        side * random.uniform(0.11, 0.17) + random.normal(0, 0.01),
        random.uniform(-0.08, 0.08),
        random.uniform(-180, 180),
    )
    if random.uniform() < 0.4:
        return lambda time: standing(x, y, yaw)
    speed, turn = random.normal(0, 0.15, 3), random.normal(0, 1.0, 3)
    tilt = things.turned((1.0, 0.3, 0.0), random.uniform(-40, 40))

    def path(time: float) -> np.ndarray:
        spun = things.turned((turn[0], turn[1], turn[2]), np.degrees(np.linalg.norm(turn)) * time)
        return standing(x, y, yaw, 0.1) @ transforms.rigid(np.eye(3), speed * time) @ spun @ tilt

    return path


def _camera(random: np.random.Generator) -> Way:
    away, pitch, heading = random.uniform(0.5, 1.0), random.uniform(25, 60), random.uniform(-60, 60)
    if random.uniform() < 0.5:
        return lambda time: before(away, pitch, heading)
    drift = random.normal(0, 1, 3)
    return lambda time: before(
        away + 0.1 * drift[0] * time, pitch + 10 * drift[1] * time, heading + 15 * drift[2] * time
    )


def bent(mesh: Mesh, sigma_m: float, random: np.random.Generator) -> Mesh:
    """The mesh, bent by a smooth random field with a standard deviation per axis [m], without its rigid part."""
    vertices = mesh.vertices.astype(np.float64)
    size = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    waves = random.normal(0, 1, (3, WAVES, 3)) * 2 * np.pi / (0.8 * size)
    phases = random.uniform(0, 2 * np.pi, (3, WAVES))

    def field(points: np.ndarray) -> np.ndarray:
        parts = np.sin(np.einsum("np,awp->naw", points, waves) + phases)
        return np.asarray(sigma_m * np.sqrt(2 / WAVES) * parts.sum(axis=2))

    spread = metrics.sample_surface(vertices, mesh.faces, 2000, seed=0)
    _, rigid = transforms.umeyama(spread + field(spread), spread, with_scale=False)
    return mesh.model_copy(update={"vertices": transforms.apply(rigid, vertices + field(vertices)).astype(np.float32)})


def drawn(meshes: Mapping[str, Mesh], seed: int, number: int, mesh_m: float, keep: Path | None) -> Iterator[Draw]:
    """Track one sequence; its tracked objects in the last frame."""
    random = np.random.default_rng((seed, number))
    made = sequence(meshes, random, f"{seed}_{number}")
    shown = list(_shown(made, (seed, number), keep))
    actors = {name: actor for name, actor in made.actors.items() if actor.tracked}
    models = {}
    for name, actor in actors.items():
        mesh = actor.links["base"]
        mesh = bent(mesh, mesh_m, random) if mesh_m else mesh
        models[name] = Model({"base": (mesh.vertices, mesh.faces)}, mesh_sigma_m=mesh_m)
    tracker = Tracker(models, LENS.matrix())
    start = {name: transforms.invert(made.camera(0.0)) @ actor.path(0.0) for name, actor in actors.items()}
    off = np.array([0.002, 0.002, 0.002, 0.01, 0.01, 0.01])
    tracker.start({name: lie.retract(pose, random.normal(0, off)) for name, pose in start.items()})
    for frame in shown:
        found = tracker.step(frame.rgb, frame.depth, frame.stamp)
    time = shown[-1].stamp
    for name, actor in actors.items():
        each = found[name]
        if each.status != "tracked" or each.pose is None or each.covariance is None:
            continue
        truth = transforms.invert(made.camera(time)) @ actor.path(time)
        stands = "standing" if np.array_equal(actor.path(0.0), actor.path(time)) else "moving"
        still = ", camera stands" if np.array_equal(made.camera(0.0), made.camera(time)) else ", camera moves"
        yield Draw(name, stands + still, each.visible, lie.between(truth, each.pose), each.covariance)


def _shown(made: Sequence, seed: tuple[int, int], keep: Path | None) -> Iterator[RgbdFrame]:
    if keep is None:
        yield from (frame for frame, _ in frames(made, seed=seed[0] * 1000 + seed[1]))
        return
    keep.mkdir(parents=True, exist_ok=True)
    file = keep / f"{made.name}.npz"
    if not file.exists():
        film = [frame for frame, _ in frames(made, seed=seed[0] * 1000 + seed[1])]
        rgb, depth = (
            np.stack([f.rgb for f in film]),
            np.stack([np.round(1e3 * f.depth).astype(np.uint16) for f in film]),
        )
        np.savez_compressed(file, rgb=rgb, depth=depth, stamps=np.array([f.stamp for f in film]))
    stored = np.load(file)
    for rgb, depth, stamp in zip(stored["rgb"], stored["depth"], stored["stamps"], strict=True):
        yield RgbdFrame(float(stamp), rgb, depth.astype(np.float32) / 1000)


def table(draws: list[Draw]) -> list[str]:
    """Rows of the table: which poses, how many, and the parts of them inside the regions."""
    lines = ["| poses | n | position | rotation | both |", "| --- | --- | --- | --- | --- |"]
    kinds = sorted({each.kind for each in draws})
    groups = [(kind, [each for each in draws if each.kind == kind]) for kind in kinds]
    groups += [("symmetric", [each for each in draws if each.name in sequences.ROUND])]
    groups += [("less than half seen", [each for each in draws if each.seen < 0.5])]
    for kind, group in [*groups, ("all", draws)]:
        cells = " | ".join(_cell(group, part) for part in (slice(0, 3), slice(3, 6), slice(0, 6)))
        lines.append(f"| {kind} | {len(group)} | {cells} |")
    return lines


def _cell(draws: list[Draw], part: slice) -> str:
    from scipy import stats

    limit = float(stats.chi2.ppf(0.95, part.stop - part.start))
    hits = sum(
        float(each.deviation[part] @ np.linalg.solve(each.stated[part, part], each.deviation[part])) <= limit
        for each in draws
    )
    low, high = wilson(hits, len(draws))
    return f"{hits / max(len(draws), 1):.3f} [{low:.2f} {high:.2f}]"


def main(arguments: list[str]) -> None:
    """Draw, track, count, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=120)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--mesh-mm", type=float, default=0.0)
    parser.add_argument("--keep", type=Path)
    chosen = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as scratch:
        meshes = things.foreign(Path(scratch), sequences.NAMES)
    draws: list[Draw] = []
    for number in range(chosen.count):
        draws += drawn(meshes, chosen.seed, number, 1e-3 * chosen.mesh_mm, chosen.keep)
    print("\n".join(table(draws)))


if __name__ == "__main__":
    main(sys.argv[1:])
