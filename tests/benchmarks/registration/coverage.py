"""How often the stated 95 % region of a placement holds the truth: `python -m tests.benchmarks.registration.coverage`.

No picture is drawn: rays against four known solids give depth and mask, and the faults of a depth camera are added,
as in the views of the other program. Each draw starts a few millimetres off, with a scale that is a few per cent off,
so that only the last registration and its covariance are judged: position and rotation (6 numbers, jointly), and log
scale.
"""

from __future__ import annotations

import argparse
import json
import sys

import numpy as np
from scipy import stats
from scipy.spatial.transform import Rotation

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.objects.object import Body, Link
from dextera_build.artifacts.robots.noise import DepthNoise
from dextera_build.geometry import kinematics, lie, raycast, registration, solids, transforms
from dextera_build.geometry.registration import ScaledPose, Search
from dextera_build.sim.render import sensor
from dextera_build.statistics import wilson
from rules.align.object import polish, spread
from rules.align.object.icp_options import IcpOptions
from rules.align.object.model_view import ModelView, seen_points
from tests import factories, object_views

from . import scenes

LENS = Camera(width=320, height=240, fx=400.0, fy=400.0, cx=159.5, cy=119.5)
SOLIDS = {
    "box": solids.box((0.12, 0.06, 0.08), (0.0, 0.0, 0.04)),
    "bracket": object_views.bracket(),
    "mug": object_views.mug(),
    "laptop": object_views.laptop(1.9)[0],
}


def draw(number: int, seed: int) -> tuple[str, float, float]:
    """Name, squared error over the covariance of position and rotation, error of the log scale over its deviation."""
    random = np.random.default_rng([seed, number])
    name = list(SOLIDS)[number % len(SOLIDS)]
    mesh = object_views.mesh(SOLIDS[name])
    pose = factories.pose(*random.normal(0.0, 0.03, 2), 0.0, random.uniform(0.0, 6.28))
    away, height = random.uniform(0.45, 1.0), np.radians(random.uniform(20.0, 65.0))
    eye = factories.look_at((0.0, -away * np.cos(height), away * np.sin(height)), (0.0, 0.0, 0.04))
    k = LENS.matrix()
    surfaces = [raycast.posed(mesh.vertices.astype(np.float64), mesh.faces, pose), object_views.TABLE]
    shot = raycast.render(surfaces, k, eye, 240, 320)
    rgb = np.full((240, 320, 3), 0.6)
    noise = DepthNoise(edge_loss=0.5, smear=0.5)
    depth = sensor.measure_depth(shot.depth, rgb, k, noise, random)
    mask = scenes.ragged(shot.index == 0, random)
    seen = scenes.cropped((np.uint8(255 * rgb), depth), mask, np.zeros(mask.shape, bool), eye, LENS)
    body = Body(links={"base": Link(mesh=mesh)})
    vertices, faces = kinematics.posed_surface(body)
    model = ModelView(vertices, faces, seen)
    off = transforms.rigid(lie.rotation(random.normal(0.0, 0.02, 3)), random.normal(0.0, 0.003, 3))
    start = ScaledPose(float(np.exp(random.normal(0.0, 0.03))), pose @ off)
    options = IcpOptions()
    search = Search(lie.FREE, start.scale, options.start_scale_sigma, model.noise_m, options.iterations)
    near = registration.icp(start, model.coarser(seen, 3000).visible, seen_points(seen, 800), search)
    found = polish.polished(model, near, options.start_scale_sigma, lie.FREE)
    size = found.scale * float(np.linalg.norm(np.ptp(vertices, axis=0)))
    stated = spread.covariance(model, found, size, options.start_scale_sigma, lie.FREE)
    turn = Rotation.from_matrix(found.pose[:3, :3] @ pose[:3, :3].T).as_rotvec()
    error = np.concatenate([found.pose[:3, 3] - pose[:3, 3], turn])
    surprise = float(error @ np.linalg.solve(stated[:6, :6], error))
    return name, surprise, float(np.log(found.scale) / np.sqrt(stated[6, 6]))


def main() -> None:
    """Draw, count, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=320)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    found = []
    for number in range(arguments.count):
        found.append(draw(number, arguments.seed))
        print(json.dumps(found[-1]), file=sys.stderr, flush=True)
    limit = float(stats.chi2.ppf(0.95, 6))
    print("| solid | n | pose in its 95 % region | scale in its 95 % interval |\n|---|---|---|---|")
    for name in (*SOLIDS, "all"):
        mine = [row for row in found if name in (row[0], "all")]
        poses, scales = sum(row[1] <= limit for row in mine), sum(abs(row[2]) <= 1.96 for row in mine)
        cells = [f"{hits / len(mine):.1%} ({_interval(hits, len(mine))})" for hits in (poses, scales)]
        print(f"| {name} | {len(mine)} | {' | '.join(cells)} |")


def _interval(hits: int, count: int) -> str:
    low, high = wilson(hits, count)
    return f"{low:.1%}-{high:.1%}"


if __name__ == "__main__":
    main()
