"""Up of foreign meshes whose files tell it: `python -m tests.benchmarks.registration.canonical --meshes FOLDER`.

Each mesh is turned by one of the 24 rotations of its axes, and backend `geometry` of `align.canonical` says which axis
is up, without a photograph. A symmetric body whose found up a symmetry turns into the true one counts as right. The
meshes are those of `benchmark/objects`; `--choose` prints the weights and the least lead that are best on the others,
those of `benchmark/objects_learn`, and judges nothing.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import minimize
from scipy.special import logsumexp

from dextera_build.artifacts.objects.object import Body, Link
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.geometry import canonical as geometry
from dextera_build.geometry import kinematics, registration
from dextera_build.geometry import symmetry as symmetries
from dextera_build.statistics import Rate
from rules.align.canonical.bodies import Surface
from tests.benchmarks import catalogue

from . import scenes

LEADS = (0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.7, 1.0)
SURE = 0.9
"""Least part of the decided that is right, from which a lead suffices."""


@dataclass(frozen=True)
class Known:
    """A turned mesh: each judgement of its six directions, and which of them are right."""

    judgements: dict[str, np.ndarray]  # (6,) each
    right: np.ndarray  # (6,) bool

    def judged(self, weights: dict[str, float]) -> tuple[float, bool]:
        """The lead of the best direction, and whether it is right."""
        total = np.sum([weights[name] * values for name, values in self.judgements.items()], axis=0)
        first, second = np.sort(total)[::-1][:2]
        return float(first - second), bool(self.right[int(np.argmax(total))])


def known(parts: tuple[Mesh, ...], number: int) -> Known:
    """Judge the directions of a mesh that is turned by rotation `number`."""
    turn = registration.cube_rotations()[number % 24]
    links = {
        f"part_{k}": Link(mesh=mesh.model_copy(update={"vertices": (mesh.vertices @ turn.T).astype(np.float32)}))
        for k, mesh in enumerate(parts)
    }
    body = Body(links=links)
    vertices, faces = kinematics.posed_surface(body)
    surface = Surface(body, vertices, faces)
    true = turn @ np.array([0.0, 0.0, 1.0])
    group = symmetries.find(vertices, faces, surface.distances)
    right = [any(float((one @ up) @ true) > 0.9 for one in group.turns()) for up in geometry.DIRECTIONS]
    samples = geometry.sample(vertices, faces, surface.paint)
    return Known(geometry.judgements(samples, surface.cast), np.array(right) | group.is_ball)


def choose(meshes: list[Known]) -> None:
    """Print the weights under which the right directions are likeliest, and the least lead that is `SURE`.

    The model is a conditional logit: the probability of a direction grows exponentially with its weighted sum.
    """
    names = list(meshes[0].judgements)
    values = np.array([[mesh.judgements[name] for name in names] for mesh in meshes])  # (meshes, names, 6)
    right = np.array([mesh.right for mesh in meshes])

    def loss(weights: np.ndarray) -> float:
        odds = np.einsum("mnd,n->md", values, weights)
        chosen = logsumexp(np.where(right, odds, -np.inf), axis=1) - logsumexp(odds, axis=1)
        return -float(chosen.mean())

    found = minimize(loss, np.ones(len(names)), bounds=[(0.0, None)] * len(names)).x
    best = dict(zip(names, found / found[names.index("stands")], strict=True))
    judged = [mesh.judged(best) for mesh in meshes]
    print({name: round(float(weight), 2) for name, weight in best.items()})
    print(f"{Rate(sum(one for _, one in judged), len(judged))} right")
    for lead in LEADS:
        decided = [one for found_lead, one in judged if found_lead >= lead]
        print(f"lead {lead}: {Rate(sum(decided), len(decided))} of the decided are right")
        if sum(decided) >= SURE * len(decided):
            return


def table(rows: dict[str, list[tuple[float, bool]]]) -> None:
    """Print one row per axis that is up in the files."""
    print("| up in the file | n | decided | right of the decided | right of all |\n|---|---|---|---|---|")
    for up, mine in rows.items():
        decided = [right for lead, right in mine if lead >= geometry.CLEAR]
        everyone = Rate(sum(right for _, right in mine), len(mine))
        print(f"| {up} | {len(mine)} | {len(decided)} | {Rate(sum(decided), len(decided))} | {everyone} |")


def main() -> None:
    """Judge every mesh, print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--meshes", type=Path, required=True, help="the folder that `make meshes` writes")
    parser.add_argument("--choose", action="store_true", help="choose on the other meshes")
    given = parser.parse_args()
    entries = catalogue.entries(catalogue.LEARNED if given.choose else catalogue.REPORTED)
    library = scenes.things(given.meshes, Path(tempfile.mkdtemp()))
    mine = {name: known(library[name], 7 * number) for number, name in enumerate(sorted(library)) if name in entries}
    if given.choose:
        choose(list(mine.values()))
        return
    rows: dict[str, list[tuple[float, bool]]] = {}
    for name, mesh in mine.items():
        rows.setdefault(str(entries[name].get("up", "z")), []).append(mesh.judged(geometry.WEIGHTS))
    rows["all"] = [row for some in rows.values() for row in some]
    table(rows)


if __name__ == "__main__":
    main()
