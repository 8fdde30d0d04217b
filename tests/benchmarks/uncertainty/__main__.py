"""How often 90 % intervals of pose and scale hold the truth: `python -m tests.benchmarks.uncertainty --seeds 10`.

For every seed of the camera's noise, `twin/laptop_scene` is built, and each asset is compared with its true object in
the frame of the camera: the error is the change of x, y, yaw and log scale, about the asset's origin, that best lays
its surface on the true one. `registration` places the true mesh by `align.object` from a start that is a few
millimetres off, so that only the registration is judged; `twin` is the whole chain with the mesh made from
the photograph.

One JSON line per object and seed, then a table. Builds are in the store (`DXB_CACHE`), so a second run resumes.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from dextera_build.api import Project, Result
from dextera_build.artifacts.objects.object import Body, Link
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.geometry import kinematics, lie, metrics, transforms
from dextera_build.geometry.raycast import RayScene
from dextera_build.statistics import Z90
from dextera_build.testing import RuleRunner

TWIN = "twin/laptop_scene"
TRUTH = {"black_laptop": "laptop", "blue_mug": "mug", "yellow_box": "carton", "gray_bowl": "bowl"}
"""Name in the twin -> name in the reference world."""
ROUND = ("gray_bowl",)
"""Bodies without a yaw."""
QUANTITIES = ("x", "y", "yaw", "scale")
UNITS = np.array([0.001, 0.001, 0.001, 0.01, 0.01])
"""Steps of the comparison: x, y, z [m], yaw [rad], log scale."""
OFF_M, OFF_RAD = 0.003, 0.02
"""Standard deviations of the starts of `registration`."""


class Surface:
    """A closed mesh with samples on it.

    Args:
        vertices: (V, 3) [m].
        faces: (F, 3).
        seed: Of the samples.
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray, seed: int) -> None:
        self._scene = RayScene((vertices, faces))
        self.points = metrics.sample_surface(vertices, faces, 3000, seed)

    def distances(self, points: np.ndarray) -> np.ndarray:
        """Distance (N,) of points to the surface [m]."""
        return self._scene.distances(points).astype(np.float64)


def error(found: Surface, true: Surface, origin: np.ndarray) -> np.ndarray:
    """The change (5,) of x, y, z [m], yaw [rad] and log scale about `origin` that best lays `found` on `true`."""
    from scipy import optimize

    def apart(steps: np.ndarray) -> np.ndarray:
        change = steps * UNITS
        turn, scale = lie.rotation(np.array([0.0, 0.0, change[3]])), np.exp(change[4])
        there = scale * (found.points - origin) @ turn.T + origin + change[:3]
        back = (true.points - origin - change[:3]) @ turn / scale + origin
        return np.concatenate([true.distances(there), found.distances(back)]) * 1000.0

    def slopes(steps: np.ndarray) -> np.ndarray:
        return np.column_stack([(apart(steps + 0.05 * e) - apart(steps - 0.05 * e)) / 0.1 for e in np.eye(5)])

    # Distances have a kink at zero, and a start beside it.
    starts = [np.array([0.01, 0.01, 0.01, yaw, 0.01]) for yaw in (0.0, 3.0, -3.0)]
    ends = [optimize.least_squares(apart, start, jac=slopes, loss="soft_l1", max_nfev=30) for start in starts]
    return np.asarray(min(ends, key=lambda end: end.cost).x * UNITS)


def rows(seeds: int) -> Iterator[dict[str, Any]]:
    """Errors and stated deviations of every object, seed and kind."""
    project = Project.find()
    runner = RuleRunner(Path(tempfile.mkdtemp()))
    for seed in range(seeds):
        settings = {"reference/laptop_scene:capture.seed": seed}
        nodes = ("body.asset", "support", "named", "reference/laptop_scene:truth")
        built = project.build(TWIN, *nodes, settings=settings)
        if not built.ok:
            raise SystemExit(str(built.errors))
        truth: Any = built.artifact("reference/laptop_scene:truth")
        support: Any = built.artifact("support")
        named: Any = built.artifact("named")
        world = (support.camera_pose @ truth.camera_pose.inverse()).matrix
        for name, true_name in TRUTH.items():
            mesh = truth.objects[true_name].mesh
            vertices = transforms.apply(world, mesh.vertices.astype(np.float64))
            alone = _placed(runner, named.items[name], world, mesh, seed)
            for kind, made in (("twin", _twin(built, name)), ("registration", alone)):
                body, pose, scale, scale_sigma = made
                surface, faces = kinematics.posed_surface(body)
                placed = transforms.apply(pose.matrix, scale * surface)
                off = error(Surface(placed, faces, 0), Surface(vertices, mesh.faces, 1), pose.matrix[:3, 3])
                sigma = [*np.sqrt(np.diag(pose.covariance))[[0, 1, 5]], scale_sigma]
                yield {"kind": kind, "object": name, "seed": seed, "error": off[[0, 1, 3, 4]].tolist(), "sigma": sigma}


def _twin(built: Result, name: str) -> tuple[Body, Pose, float, float]:
    asset: Any = built.artifact(f"body[{name}].asset")
    return asset.body, asset.pose, 1.0, asset.scale_sigma


def _placed(runner: RuleRunner, seen: Any, world: np.ndarray, mesh: Mesh, seed: int) -> tuple[Body, Pose, float, float]:
    """The true mesh, in an upright frame at the middle of its base, placed from a start that is off."""
    random = np.random.default_rng([seed, len(mesh.vertices)])
    vertices = transforms.apply(world, mesh.vertices.astype(np.float64))
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    middle = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    own = transforms.rigid(world[:3, :3], middle)
    local = transforms.apply(transforms.invert(own), vertices)
    local[:, 2] -= local[:, 2].min()
    yaw = np.arctan2(world[1, 0], world[0, 0]) + random.normal(0.0, OFF_RAD)
    place = np.array([*(middle[:2] + random.normal(0.0, OFF_M, 2)), 0.0])
    start = transforms.rigid(lie.rotation(np.array([0.0, 0.0, yaw])), place)
    body = Body(
        links={"base": Link(mesh=Mesh(vertices=local.astype(np.float32), faces=mesh.faces))},
        pose=Pose(parent="world", child="object", matrix=start),
    )
    placed = runner.run(
        "align.object", body=body, view=seen.view, measured=seen.measured, options={"icp": {"guess_scale_sigma": 0.1}}
    )
    return body, placed.pose, placed.scale, placed.scale_sigma


def table(found: list[dict[str, Any]]) -> str:
    """Coverage of the 90 % interval, root mean square error, and the same over the stated deviation."""
    lines = ["| made by | object | quantity | in the 90 % interval | rms error | stated deviation | ratio |"]
    lines.append("|" + "---|" * 7)
    for kind in ("registration", "twin"):
        for name in TRUTH:
            mine = [row for row in found if (row["kind"], row["object"]) == (kind, name)]
            errors, sigmas = (np.array([row[what] for row in mine]) for what in ("error", "sigma"))
            for at, quantity in enumerate(QUANTITIES):
                if quantity == "yaw" and name in ROUND:
                    continue
                inside = int((np.abs(errors[:, at]) <= Z90 * sigmas[:, at]).sum())
                rms, sigma = (float(np.sqrt(np.mean(np.square(a[:, at])))) for a in (errors, sigmas))
                factor, unit = {"yaw": (180.0 / np.pi, "deg"), "scale": (100.0, "%")}.get(quantity, (1000.0, "mm"))
                lines.append(
                    f"| {kind} | {name} | {quantity} | {inside}/{len(mine)} | {factor * rms:.2f} {unit} | "
                    f"{factor * sigma:.2f} {unit} | {rms / sigma:.1f} |"
                )
    return "\n".join(lines)


def main() -> None:
    """Print the rows and the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=10)
    found = []
    for row in rows(parser.parse_args().seeds):
        print(json.dumps(row), flush=True)
        found.append(row)
    print(table(found), file=sys.stderr)


if __name__ == "__main__":
    main()
