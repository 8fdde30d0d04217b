"""Up of foreign meshes whose files tell it: `python -m tests.benchmarks.registration.canonical --meshes FOLDER`.

Each mesh is turned by one of the 24 rotations of its axes, and backend `geometry` of `align.canonical` says which axis
is up, without a photograph. A symmetric body whose found up a symmetry turns into the true one counts as right.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np
import yaml

from dextera_build.artifacts.geometry import Mesh
from dextera_build.artifacts.object import Body, Link
from dextera_build.geometry import kinematics, registration
from dextera_build.geometry import symmetry as symmetries
from dextera_build.statistics import Rate
from rules.align.bodies import Surface
from rules.align.canonical_geometry import GeometryOptions, choose

from . import scenes


def judged(parts: tuple[Mesh, ...], number: int) -> tuple[bool, bool]:
    """Whether up was decided, and whether it is right."""
    turn = registration.cube_rotations()[number % 24]
    links = {f"part_{k}": mesh for k, mesh in enumerate(parts)}
    moved = {
        name: Link(mesh=mesh.model_copy(update={"vertices": (mesh.vertices @ turn.T).astype(np.float32)}))
        for name, mesh in links.items()
    }
    body = Body(links=moved)
    vertices, faces = kinematics.posed_surface(body)
    surface = Surface(body, vertices, faces)
    context: object = None  # the backend asks nothing of it
    chosen = choose(context, surface, None, GeometryOptions())  # type: ignore[arg-type]
    true = turn @ np.array([0.0, 0.0, 1.0])
    group = symmetries.find(vertices, faces, surface.distances)
    right = any(float((one @ chosen.up) @ true) > 0.9 for one in group.turns()) or group.is_ball
    return "up" not in chosen.undecided, bool(right)


def main() -> None:
    """Judge every mesh, print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--meshes", type=Path, required=True, help="the folder that `make meshes` writes")
    arguments = parser.parse_args()
    library = scenes.things(arguments.meshes, Path(tempfile.mkdtemp()))
    entries = yaml.safe_load(scenes.RECIPE.read_text())["nodes"]["read"]["entries"]
    rows: dict[str, list[tuple[bool, bool]]] = {}
    for number, (name, parts) in enumerate(sorted(library.items())):
        found = judged(parts, 7 * number)
        rows.setdefault(str(entries[name].get("up", "z")), []).append(found)
        print(f"{name}: {'decided' if found[0] else 'undecided'}, {'right' if found[1] else 'wrong'}", flush=True)
    rows["all"] = [row for mine in rows.values() for row in mine]
    print("| up in the file | n | decided | right of the decided | right of all |\n|---|---|---|---|---|")
    for up, mine in rows.items():
        decided = [right for clear, right in mine if clear]
        everyone = Rate(sum(right for _, right in mine), len(mine))
        print(f"| {up} | {len(mine)} | {len(decided)} | {Rate(sum(decided), len(decided))} | {everyone} |")


if __name__ == "__main__":
    main()
