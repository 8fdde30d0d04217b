"""Scene alignment where the truth is known: rooms of painted walls with meshes that others made.

    make meshes
    python -m tests.benchmarks.scene_alignment --worlds 20
    python -m tests.benchmarks.scene_alignment --stress

A scene of unknown scale is a mesh of one noisy RGB-D picture of a room, and aligned with another one of it.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.cameras.camera import Capture, Measured, Photograph
from dextera_build.artifacts.cameras.image import DepthImage, Image
from dextera_build.artifacts.scenes.scene_fit import SceneFit
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.errors import RuleError
from dextera_build.geometry import raycast, transforms
from dextera_build.geometry.lie import rotation
from dextera_build.testing import RuleRunner
from rules.evaluate import other_view
from tests.benchmarks import catalogue
from tests.rules.align import painted

STAND = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
"""Rotation from z up to the room's axes, in which y points down."""
FLOOR = 0.7
"""Height of the painted floor in these axes [m]."""
CUT = 0.06
"""Triangles whose corners' depths differ by more than this part join two surfaces."""
OWN = transforms.rigid(rotation(np.array([-0.3, 0.0, 0.0])), np.array([0.0, -0.35, 0.0]))
"""T_room_camera of the picture that the scene is made from: it looks down at the things."""


@dataclass(frozen=True)
class Shot:
    """How a picture is taken, beside its place."""

    noise: float = 1.0
    gamma: float = 1.0
    gain: float = 1.0
    seed: int = 0


def main() -> None:
    """Print a table."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--meshes", type=Path, default=catalogue.FOLDER, help="what `make meshes` wrote")
    options.add_argument("--worlds", type=int, default=0, help="number of drawn rooms")
    options.add_argument("--stress", action="store_true", help="errors against what makes it hard")
    given = options.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        runner = RuleRunner(Path(folder))
        things = textured(runner, given.meshes)
        if given.worlds:
            worlds(runner, things, given.worlds)
        if given.stress:
            stress(runner, things)


def textured(runner: RuleRunner, meshes: Path) -> list[raycast.Surface]:
    """Surfaces of the things of `benchmark/objects` that have a texture, z up, on the ground [m]."""
    entries = {
        name: entry
        for name, entry in catalogue.entries().items()
        if len(entry["parts"]) == 1 and "texture" in entry["parts"][0]
    }
    files = [path for entry in entries.values() for part in entry["parts"] for path in (part["file"], part["texture"])]
    folder = Folder(files={path: (meshes / path).read_bytes() for path in files})
    found = runner.run("reference.catalogue", folder=folder, options={"entries": entries})
    surfaces = []
    for thing in found.items.values():
        mesh = next(iter(thing.parts.values())).mesh
        texture = mesh.texture and mesh.texture.pixels
        surfaces.append(raycast.Surface(mesh.vertices, mesh.faces, mesh.uv, texture, mesh.colour))
    return surfaces


def room(things: list[raycast.Surface], index: int, moved: float = 0.0) -> list[raycast.Surface]:
    """A painted room with eight things, half as large again as they are; `moved` shifts one of them [m]."""
    random = np.random.default_rng(index)
    walls = painted.room(index)
    assert walls.texture is not None
    found = [raycast.Surface(walls.vertices, walls.faces, walls.uv, walls.texture.pixels)]
    for number, chosen in enumerate(random.choice(len(things), 8, replace=False)):
        place = np.array([random.uniform(-0.8, 0.8), FLOOR, random.uniform(1.3, 2.6)])
        place[0] += moved if number == 0 else 0.0
        turn = STAND @ rotation(np.array([0.0, 0.0, random.uniform(0, 2 * np.pi)]))
        thing = things[chosen]
        vertices = transforms.apply(transforms.rigid(turn, place), 1.5 * thing.vertices.astype(float))
        found.append(raycast.Surface(vertices, thing.faces, thing.uv, thing.texture, thing.colour))
    return found


def shot(surfaces: list[raycast.Surface], pose: np.ndarray, how: Shot) -> Capture:
    """What an RGB-D camera at `pose` (T_room_camera) takes."""
    random, camera = np.random.default_rng(how.seed), painted.CAMERA
    fine = camera.scaled(2.0)
    seen = raycast.render(surfaces, fine.matrix(), pose, fine.height, fine.width)
    colours = raycast.shade(surfaces, seen).reshape(camera.height, 2, camera.width, 2, 3).mean(axis=(1, 3)) / 255.0
    colours = how.gain * colours**how.gamma + how.noise * 3 / 255 * random.normal(size=colours.shape)
    exact = raycast.render(surfaces, camera.matrix(), pose, camera.height, camera.width).depth
    depth = np.where(exact > 0, exact + how.noise * 0.002 * exact**2 * random.normal(size=exact.shape), 0.0)
    rgb = np.round(255 * colours.clip(0, 1)).astype(np.uint8)
    return Capture(
        photograph=Photograph(rgb=Image(pixels=rgb), camera=camera),
        measured=Measured(depth=DepthImage(depth=depth.astype(np.float32))),
    )


def sheet(given: Capture, factor: float) -> Mesh:
    """The measured pixels as a mesh in the camera's axes, cut at edges, at `factor` lengths a metre.

    A Gaussian for each pixel would hide those behind it, so that pictures of slanted surfaces shift by half a pixel.
    """
    assert given.measured is not None
    depth = given.measured.depth.depth.astype(float)
    own = other_view.Own(given.photograph.rgb.pixels, depth, depth < 0, painted.CAMERA.matrix())
    whole = other_view.sheet(own)
    assert whole.uv is not None
    far = whole.vertices[:, 2][whole.faces]
    kept = np.ptp(far, axis=1) < CUT * far.min(axis=1)
    return Mesh(
        vertices=(factor * whole.vertices).astype(np.float32),
        faces=whole.faces[kept].astype(np.int32),
        uv=whole.uv[kept].astype(np.float32),
        texture=given.photograph.rgb,
    )


def aligned(
    runner: RuleRunner, first: Capture, second: Capture, true: np.ndarray, factor: float
) -> tuple[SceneFit | None, tuple[float, float, float]]:
    """The fit and its errors: camera [mm], angle [deg], scale [%]; None where it was refused."""
    options: dict[str, Any] = {"refuse": False}
    try:
        fit: SceneFit = runner.run(
            "align.scene", backend="sift", capture=second, scene=sheet(first, factor), options=options
        )
    except RuleError:
        return None, (np.nan, np.nan, np.nan)
    motion = fit.motion
    camera = transforms.invert(motion.matrix)[:3, 3] / (motion.scale * factor)
    turn = motion.matrix[:3, :3] @ true[:3, :3]
    place = 1000 * float(np.linalg.norm(camera - true[:3, 3]))
    return fit, (place, float(np.degrees(transforms.angle(turn))), 100 * (motion.scale * factor - 1))


def worlds(runner: RuleRunner, things: list[raycast.Surface], count: int) -> None:
    """Rooms, viewpoints and scales by draw."""
    print("| world | baseline | camera [mm] | angle [deg] | scale [%] | stated [mm] | pairs | believed |")
    print("|---|---|---|---|---|---|---|---|")
    rows = []
    for index in range(count):
        random = np.random.default_rng(1000 + index)
        pose = away(random.uniform(0.1, 0.6), random)
        factor = float(np.exp(random.uniform(-1.2, 1.2)))
        surfaces = room(things, index)
        first, second = shot(surfaces, OWN, Shot(seed=index)), shot(surfaces, OWN @ pose, Shot(seed=index + 500))
        fit, errors = aligned(runner, first, second, pose, factor)
        rows.append((*errors, fit is not None and not fit.doubts))
        print(row(f"{index} | {np.linalg.norm(pose[:3, 3]):.2f} m", fit, errors), flush=True)
    good = np.array([each[:3] for each in rows if each[3]])
    print(f"{len(good)} of {count} believed: median {np.median(np.abs(good), axis=0).round(3)}, ", end="")
    print(f"largest {np.abs(good).max(axis=0).round(3)} (mm, deg, % of scale)")


def away(baseline: float, random: np.random.Generator) -> np.ndarray:
    """T_own_camera of a camera that went aside and still looks at the middle of the room."""
    side = random.choice([-1.0, 1.0])
    place = baseline * np.array([side * 0.95, -0.15, random.uniform(-0.2, 0.2)])
    yaw = -np.arctan2(place[0], 2.2) + random.normal(0, 0.05)
    return transforms.rigid(rotation(np.array([random.normal(0, 0.04), yaw, random.normal(0, 0.05)])), place)


def row(label: str, fit: SceneFit | None, errors: tuple[float, float, float]) -> str:
    """One line of a table."""
    if fit is None:
        return f"| {label} | - | - | - | - | - | refused |"
    assert fit.motion.covariance is not None
    stated = 1000 * np.sqrt(np.trace(fit.motion.covariance[:3, :3]))
    numbers = " | ".join(f"{value:.2f}" for value in errors)
    return f"| {label} | {numbers} | {stated:.1f} | {fit.evidence.inliers} | {'no' if fit.doubts else 'yes'} |"


def stress(runner: RuleRunner, things: list[raycast.Surface]) -> None:
    """One thing at a time is made worse; in one room."""
    print("| case | room | camera [mm] | angle [deg] | scale [%] | stated [mm] | pairs | believed |")
    print("|---|---|---|---|---|---|---|---|")
    for label, baseline, how, moved in cases():
        for index in (100,):
            random = np.random.default_rng(index)
            pose = away(baseline, random)
            first = shot(room(things, index), OWN, Shot(seed=index))
            second = shot(room(things, index, moved), OWN @ pose, how)
            fit, errors = aligned(runner, first, second, pose, 0.37)
            print(row(f"{label} | {index}", fit, errors), flush=True)


def cases() -> Iterator[tuple[str, float, Shot, float]]:
    """Name, baseline [m], how the second picture is taken, how far a thing was moved [m]."""
    yield from ((f"baseline {each:g} m", each, Shot(seed=1), 0.0) for each in (0.2, 0.5, 0.9, 1.3, 1.8))
    yield from ((f"gamma {each:g}", 0.3, Shot(gamma=each, seed=1), 0.0) for each in (0.5, 2.0))
    yield from ((f"exposure x {each:g}", 0.3, Shot(gain=each, seed=1), 0.0) for each in (0.3, 1.6))
    yield from ((f"noise x {each:g}", 0.3, Shot(noise=each, seed=1), 0.0) for each in (4.0, 10.0))
    yield "a thing moved by 20 cm", 0.3, Shot(seed=1), 0.2


if __name__ == "__main__":
    main()
