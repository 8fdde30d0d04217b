"""Backend foundation_pose of align.track: FoundationPose in its own environment, with status from renders."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from pydantic import PositiveInt

from dextera_build.artifacts.cameras.rgbd_video import RgbdFrame
from dextera_build.geometry import kinematics
from dextera_build.rule import Backend, Context, Options
from dextera_build.tracking import judge, solve
from dextera_build.tracking import spread as errors
from dextera_build.tracking.colours import Colours
from dextera_build.tracking.frame import Frame
from dextera_build.tracking.judge import Gate
from dextera_build.tracking.model import Model, State
from dextera_build.tracking.tracked_object import Tracked

from .symmetry import turns

if TYPE_CHECKING:
    from dextera_build.artifacts.objects.object import Asset

    from .track import Job

BACKEND = Backend(
    summary="FoundationPose (Wen et al. 2024), each pose judged by its render",
    packages=("open3d", "opencv-python-headless", "scipy"),
    extra="twin",
    command=("{python}", "foundation_pose_program.py"),
    environment="venv:.envs/foundation_pose",
    lock="envs/foundation_pose.lock",
    gpu_gb=8.0,
    timeout_s=3600.0,
    licence="NVIDIA Source Code License (non-commercial)",
)
GATE = Gate(agreement=0.6, visible=0.15)
"""Less strict than for poses fitted to the depth."""


class FoundationPoseOptions(Options):
    """Options of backend `foundation_pose` of align.track."""

    register_iterations: PositiveInt = 5
    """Iterations of the refiner when an object is registered from its mask."""
    track_iterations: PositiveInt = 2
    """Iterations of the refiner per frame."""


def track(ctx: Context, job: Job, options: FoundationPoseOptions) -> list[dict[str, Tracked]]:
    """Poses of FoundationPose; it gives neither status nor covariance, so both come from the depth of each frame.

    Joint positions are constant, because it tracks rigid meshes. With masks, an object is registered in the first frame
    with its mask, and again after its mask was elsewhere for three frames; without masks, it starts at its placement.
    """
    meshes = {name: _whole(asset) for name, asset in job.assets.items()}
    for name, asset in job.assets.items():
        if all(link.mesh.texture is None for link in asset.body.links.values()):
            ctx.warn(f"the mesh of `{name}` has no texture, which FoundationPose compares with the picture")
    found = ctx.outside(
        "track",
        dict[str, np.ndarray],
        video=job.video,
        numbers=np.array(list(job.numbers), np.int64),
        vertices={name: vertices.astype(np.float32) for name, (vertices, _) in meshes.items()},
        faces={name: faces.astype(np.int32) for name, (_, faces) in meshes.items()},
        colours={name: _colours(asset) for name, asset in job.assets.items()},
        symmetries={name: turns(*mesh) for name, mesh in meshes.items()},
        starts=job.starts,
        masks=job.masks,
    )
    for name in meshes:
        ctx.check(
            found[name].shape == (len(job.numbers), 4, 4),
            f"the program gave {len(found[name])} poses of `{name}` for {len(job.numbers)} frames",
        )
    models = {name: Model({"base": mesh}) for name, mesh in meshes.items()}
    k = job.video.camera.matrix()
    frames = job.video.frames(job.numbers)
    return [
        {name: _judged(models[name], frame, k, found[name][place], asset) for name, asset in job.assets.items()}
        for place, frame in enumerate(frames)
    ]


def _judged(model: Model, seen: RgbdFrame, k: np.ndarray, pose: np.ndarray, asset: Asset) -> Tracked:
    """A pose with its status and covariance from the depth."""
    frame, state = Frame(seen.rgb, seen.depth, k, seen.stamp), State(pose.astype(np.float64), np.zeros(0))
    verdict, _ = judge.look(model, frame, state, Colours())
    fit = solve.fit(model, frame, state, Colours(), None, stages=(solve.FINE,))
    why = "outside the picture" if fit is None else judge.passes(fit, verdict, GATE)
    joints = np.array([joint.position for joint in asset.body.joints], np.float64)
    spread = np.diag(errors.UNKNOWN**2) if fit is None else fit.covariance
    if why:
        return Tracked("lost", None, None, joints, np.zeros(len(joints)), 0.0, why)
    return Tracked("tracked", state.pose, spread, joints, np.zeros(len(joints)), verdict.visible, "")


def _whole(asset: Asset) -> tuple[np.ndarray, np.ndarray]:
    """All links at their current joint positions, (V, 3) [m] and (F, 3)."""
    return kinematics.posed_surface(asset.body)


def _colours(asset: Asset) -> np.ndarray:
    """Colour of each vertex of `_whole`, (V, 3) uint8."""
    parts = []
    for name in sorted(asset.body.links):
        mesh = asset.body.links[name].mesh
        colours = np.zeros((len(mesh.vertices), 3))
        corner = np.eye(3)
        for place in range(3):
            colours[mesh.faces[:, place]] = mesh.paint(
                np.arange(len(mesh.faces)), np.tile(corner[place], (len(mesh.faces), 1))
            )
        parts.append(colours)
    return np.asarray(np.round(np.concatenate(parts) * 255), np.uint8)
