"""background.panorama by HY-Pano 2.0 (HY-World 2.0, Tencent 2026) in its own environment."""

from __future__ import annotations

import numpy as np
from pydantic import Field, NonNegativeInt

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.cameras.panorama import Panorama
from dextera_build.artifacts.objects.object import Support
from dextera_build.artifacts.scenes.scene import Background
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.geometry import transforms
from dextera_build.rule import Backend, Context, Options

from .register import register
from .sphere import level

BACKEND = Backend(
    summary="HY-Pano 2.0 with Qwen-Image-Edit generates everything outside the photograph",
    packages=("opencv-python-headless", "pillow"),
    extra="twin",
    command=("{python}", "hy_pano_program.py"),
    environment="venv:.envs/hy_pano",
    lock="envs/hy_pano.lock",
    server=True,
    gpu_gb=60.0,
    timeout_s=1800.0,
    weights=("qwen_image_edit", "hy_pano_2"),
    licence="Apache-2.0 (Qwen-Image-Edit), Tencent HY-World 2.0 Community License",
)


class HyPanoOptions(Options):
    """Options of backend `hy_pano` of background.panorama."""

    prompt: str = ""
    """Additional prompt about the place."""
    steps: int = Field(40, ge=1, le=200)
    """Number of sampling steps."""
    guidance: float = Field(7.5, ge=1.0, le=20.0)
    """Guidance scale of the prompts, the pipeline's `true_cfg_scale`."""
    least_correlation: float = Field(0.7, ge=0.0, le=1.0)
    """Minimum correlation of the photograph with its region of the panorama; below it, no pixel is marked as seen."""
    seed: NonNegativeInt = 0
    """Seed of the sampling."""


def widen(ctx: Context, background: Background, camera: Camera, support: Support, options: HyPanoOptions) -> Panorama:
    """The panorama generated from the cleaned photograph, 1920 x 960 px.

    The model regenerates the photograph and does not state its position. A level panorama with the photograph straight
    ahead is assumed; a registration with the known intrinsics corrects pitch and yaw, and `seen` are the pixels where
    panorama and photograph agree. If the registration fails, the assumed pose is kept and `seen` is left out.
    """
    made = ctx.outside("panorama", Image, image=background.image)
    pose = support.camera_pose.matrix
    turn = level(pose)
    found = register(made.pixels, background.image.pixels, camera, pose[:3, :3].T @ turn)
    ctx.metric("registration", found.correlation)
    seen = None
    if found.correlation >= options.least_correlation:
        seen, turn = found.seen, pose[:3, :3] @ found.camera_from_panorama
    else:
        ctx.log(f"the photograph was not found in the panorama: correlation {found.correlation:.2f}")
    placed = Pose(parent="world", child="camera", matrix=transforms.rigid(turn, np.array(pose[:3, 3])))
    return Panorama(image=made, pose=placed, seen=seen)
