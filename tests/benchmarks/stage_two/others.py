"""Registration by packages that are not in the lock file: small_gicp for objects, roboreg for the robot.

`pip install --no-deps --target FOLDER small_gicp roboreg`, then `PYTHONPATH=FOLDER`. Of roboreg only its point-cloud
registration is imported, which needs torch alone: the rest of the package wants CUDA (nvdiffrast) and SAM 2.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from types import ModuleType

import numpy as np

from dextera_build.artifacts.cameras.calibration import Calibration
from dextera_build.artifacts.objects.object import Body, Placement
from dextera_build.artifacts.objects.view import Seen
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.robots.robot_views import RobotViews
from dextera_build.geometry import cameras, robot_mask, transforms
from dextera_build.geometry.registration import ScaledPose
from dextera_build.sim.model import tessellate
from dextera_build.sim.model.forward import Kinematics
from dextera_build.sim.model.robot import CONTACT_GROUP
from dextera_build.sim.render.robot_view import RobotRenderer
from rules.align.object import boxed

SEEN_POINTS, MODEL_POINTS = 2000, 5000
"""Points of each picture that roboreg gets; the second is its own default."""
REACH_M = {True: 0.1, False: 0.05}
"""Largest distance of a pair from its own start, which is its default, and from the markers' [m]."""


def optional(name: str) -> ModuleType | None:
    """A module, or None and a line that says how to get it."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        package = name.partition(".")[0]
        print(f"{package} is left out ({error}): `pip install --no-deps --target FOLDER {package}`, PYTHONPATH=FOLDER")
        return None


def gicp(body: Body, seen: Seen, small_gicp: ModuleType) -> Placement:
    """small_gicp's GICP, which is rigid, at the scale of the boxes from their 24 rotations; the best by inliers."""
    model, points = boxed.model_points(body), boxed.seen_points(seen)
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    ends = []
    for start in boxed.upright(model, points):
        done = small_gicp.align(
            start.scale * model,
            points,
            np.linalg.inv(start.pose),
            registration_type="GICP",
            downsampling_resolution=size / 200,
            max_correspondence_distance=0.25 * size,
            max_iterations=60,
        )
        ends.append((-done.num_inliers, done.error, start.scale, np.linalg.inv(done.T_target_source)))
    _, _, scale, pose = min(ends, key=lambda end: end[:2])
    return boxed.judged(body, seen, ScaledPose(scale, np.asarray(pose)), "small_gicp").placement


def hydra(
    views: RobotViews, robot: RobotModel, marked: Calibration, module: ModuleType, *, centroids: bool
) -> Calibration:
    """The robust point-to-plane ICP of roboreg over all pictures, from the markers' pose or its own start.

    The robot's pixels are found as by `align.robot_camera`; roboreg's own way is SAM 2.
    """
    import torch

    draw = np.random.default_rng(0)
    observed, reference, normals = [], [], []
    first = next(iter(views.captures.values())).photograph.camera
    renderer = RobotRenderer(robot, first)
    camera_base = transforms.invert(marked.pose.matrix)
    assert views.joints is not None
    for row, capture in zip(views.joints.positions, views.captures.values(), strict=True):
        assert capture.measured is not None
        joints = dict(zip(views.joints.names, row.tolist(), strict=True))
        drawn, depth = renderer.view(joints, camera_base), capture.measured.depth.depth.astype(np.float64)
        mine = robot_mask.near(drawn.depth, drawn.labels, depth, 0.04, 12) > 0
        points = cameras.backproject(depth, first.matrix())[mine & (depth > 0)]
        observed.append(_tensor(draw.permutation(points)[:SEEN_POINTS]))
        for into, values in zip((reference, normals), surface(robot, joints, draw), strict=True):
            into.append(_tensor(values))
    start = module.centroid_alignment(observed, reference) if centroids else _tensor(marked.pose.matrix)
    with torch.no_grad():
        found = module.point_to_plane_robust_icp(
            start, observed, reference, normals, max_correspondence_distance=REACH_M[centroids], max_outer_iterations=50
        )
    matrix = found.extrinsics.numpy().astype(np.float64)
    left, _, right = np.linalg.svd(matrix[:3, :3])
    pose = marked.pose.model_copy(update={"matrix": transforms.rigid(left @ right, matrix[:3, 3]), "covariance": None})
    return marked.model_copy(update={"pose": pose})


def surface(robot: RobotModel, joints: Mapping[str, float], draw: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 3) of the robot's whole drawn surface in its base [m], by area, and their normals (N, 3)."""
    kinematics = Kinematics(robot)
    kinematics.pose(joints)
    model, data = kinematics.model, kinematics.data
    made = tessellate.surfaces(model, data)
    corners = np.concatenate(
        [
            made[geom].vertices[made[geom].faces]
            for geom in range(model.ngeom)
            if model.geom_group[geom] != CONTACT_GROUP
        ]
    )
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(across, axis=1)
    picked = draw.choice(len(corners), MODEL_POINTS, p=area / area.sum())
    weights = draw.dirichlet(np.ones(3), MODEL_POINTS)
    root = data.body("base")
    back = transforms.invert(transforms.rigid(root.xmat.reshape(3, 3), root.xpos))
    points = transforms.apply(back, (corners[picked] * weights[..., None]).sum(axis=1))
    return points, (across[picked] / area[picked, None]) @ back[:3, :3].T


def _tensor(values: np.ndarray) -> object:
    import torch

    return torch.tensor(np.ascontiguousarray(values), dtype=torch.float32)
