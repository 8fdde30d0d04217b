"""MuJoCo rendering through a calibrated camera: colour, image-plane depth, segmentation.

The camera (OpenCV axes, integer pixel centres, any principal point) is passed to the renderer directly, so a model
needs no camera of its own. `camera_spec` writes the same camera into a model.

The package `dextera_build.sim` selects EGL unless `MUJOCO_GL` is set.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Any, Self

import mujoco
import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.tasks.task import View
from dextera_build.geometry.cameras import GL_FROM_CV

SAMPLES = 4
"""Default samples per pixel; fixed, because the image depends on it."""


class Eye:
    """A camera in one MuJoCo model; a context manager, because it holds a GL context.

    Args:
        model: Compiled model; its off-screen buffer size and sample count are set here.
        camera: Intrinsics [px].
        world_from_camera: (4, 4) T_world_camera, OpenCV axes, in the model's world frame [m].
        shadows: Draw shadows and reflections in colour renders.
        geomgroups: Groups of drawn geoms; None keeps MuJoCo's default (0, 1, 2).
        samples: Samples per pixel for antialiasing; one takes less than half the time of four.
    """

    def __init__(
        self,
        model: Any,
        camera: Camera,
        world_from_camera: np.ndarray,
        *,
        shadows: bool = False,
        geomgroups: tuple[int, ...] | None = None,
        samples: int = SAMPLES,
    ) -> None:
        model.vis.global_.offwidth = max(model.vis.global_.offwidth, camera.width)
        model.vis.global_.offheight = max(model.vis.global_.offheight, camera.height)
        model.vis.quality.offsamples = samples if samples > 1 else 0  # 0 in MuJoCo is one sample in OpenGL
        self._model, self._camera, self._pose = model, camera, np.asarray(world_from_camera, np.float64)
        self._shadows = shadows
        self._option = mujoco.MjvOption()
        if geomgroups is not None:
            self._option.geomgroup[:] = [int(group in geomgroups) for group in range(len(self._option.geomgroup))]
        _use_chosen_platform()
        quality, shadow_px = model.vis.quality, model.vis.quality.shadowsize
        quality.shadowsize = shadow_px if shadows else 0  # the map of shadows takes a third of the time of a context
        try:
            self._renderer = mujoco.Renderer(model, camera.height, camera.width)
        finally:
            quality.shadowsize = shadow_px
        self._drawn = np.array(model.mesh_vert)
        self.overlay: Callable[[Any], None] | None = None
        """Adds shapes to every `mjvScene` before it is drawn; see `ghosts`."""

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Free the GL context."""
        self._renderer.close()

    def look_from(self, world_from_camera: np.ndarray) -> None:
        """Move the camera to (4, 4) T_world_camera."""
        self._pose = np.asarray(world_from_camera, np.float64)

    def rgb(self, data: Any) -> np.ndarray:
        """Colours (H, W, 3) uint8 sRGB of the state in `data` (after `mj_forward`)."""
        self._look(data)
        flags = self._renderer.scene.flags
        for flag in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION):
            flags[flag] = self._shadows
        return np.array(self._renderer.render())

    def depth(self, data: Any) -> np.ndarray:
        """Image-plane z (H, W) float32 [m]; 0 if empty."""
        self._look(data)
        self._renderer.enable_depth_rendering()
        depth = np.array(self._renderer.render())
        self._renderer.disable_depth_rendering()
        far = self._model.vis.map.zfar * self._model.stat.extent
        depth[depth >= far * (1.0 - 1e-4)] = 0.0
        return depth

    def segmentation(self, data: Any) -> np.ndarray:
        """Geom ids (H, W) int32; -1 without a geom."""
        self._look(data)
        self._renderer.enable_segmentation_rendering()
        pairs = np.array(self._renderer.render())
        self._renderer.disable_segmentation_rendering()
        return _geoms(pairs)

    def _upload(self) -> None:
        """Copy resized meshes to the GPU, which has their size at the creation of the camera."""
        model = self._model
        if np.array_equal(self._drawn, model.mesh_vert):
            return
        changed = (self._drawn != model.mesh_vert).any(axis=1)
        for mesh, (start, count) in enumerate(zip(model.mesh_vertadr, model.mesh_vertnum, strict=True)):
            if changed[start : start + count].any():
                mujoco.mjr_uploadMesh(model, self._renderer._mjr_context, mesh)
        self._drawn = np.array(model.mesh_vert)

    def _look(self, data: Any) -> None:
        self._upload()
        self._renderer.update_scene(data, scene_option=self._option)
        if self.overlay is not None:
            self.overlay(self._renderer.scene)
        rotation, place = self._pose[:3, :3], self._pose[:3, 3]
        camera = self._camera
        for eye in self._renderer.scene.camera:
            near = eye.frustum_near
            # The image spans 0..W in continuous coordinates, with the centre of pixel 0 at 0.5.
            left, right = -(camera.cx + 0.5) / camera.fx, (camera.width - camera.cx - 0.5) / camera.fx
            up, down = (camera.cy + 0.5) / camera.fy, -(camera.height - camera.cy - 0.5) / camera.fy
            eye.pos[:] = place
            eye.forward[:], eye.up[:] = rotation[:, 2], -rotation[:, 1]
            eye.frustum_center = near * (left + right) / 2
            eye.frustum_width = near * (right - left) / 2
            eye.frustum_bottom, eye.frustum_top = near * down, near * up


def _use_chosen_platform() -> None:
    # MuJoCo reads `MUJOCO_GL` once; if it was imported before this package, no platform is set.
    if os.environ.get("MUJOCO_GL") == "egl":
        from mujoco.egl import GLContext
        from mujoco.rendering.classic import gl_context

        gl_context.GLContext = GLContext


def stock(
    model: Any, data: Any, cameras: Sequence[str | Any], height: int, width: int
) -> tuple[list[np.ndarray], np.ndarray]:
    """The scene as rendered by `mujoco.Renderer` with default flags.

    Args:
        model: Compiled model.
        data: A state after `mj_forward`.
        cameras: Names of cameras of the model, or `mjvCamera`.
        height: Rows [px]; at most those of the model's off-screen buffer.
        width: Columns [px].

    Returns:
        Colours (H, W, 3) uint8 sRGB from each camera, and geom ids (H, W) int32 from the first, -1 without a geom.
    """
    _use_chosen_platform()
    with mujoco.Renderer(model, height, width) as renderer:
        pictures = []
        for camera in cameras:
            renderer.update_scene(data, camera)
            pictures.append(np.array(renderer.render()))
        renderer.update_scene(data, cameras[0])
        renderer.enable_segmentation_rendering()
        return pictures, _geoms(np.array(renderer.render()))


def _geoms(pairs: np.ndarray) -> np.ndarray:
    """Geom ids (H, W) int32 of a segmentation's pairs of id and type; -1 without a geom."""
    return np.where(pairs[..., 1] == int(mujoco.mjtObj.mjOBJ_GEOM), pairs[..., 0], -1).astype(np.int32)


def through(model: Any, view: View) -> Eye:
    """The camera of `view` as used by policies and films."""
    return Eye(model, view.camera, view.camera_pose.matrix, samples=view.samples)


def render_rgb(
    model: Any, data: Any, camera: Camera, world_from_camera: np.ndarray, *, shadows: bool = False
) -> np.ndarray:
    """Colours (H, W, 3) uint8 sRGB; see `Eye` for the arguments."""
    with Eye(model, camera, world_from_camera, shadows=shadows) as eye:
        return eye.rgb(data)


def render_depth(model: Any, data: Any, camera: Camera, world_from_camera: np.ndarray) -> np.ndarray:
    """Image-plane z (H, W) float32 [m], 0 if empty; see `Eye` for the arguments."""
    with Eye(model, camera, world_from_camera) as eye:
        return eye.depth(data)


def render_segmentation(model: Any, data: Any, camera: Camera, world_from_camera: np.ndarray) -> np.ndarray:
    """Geom ids (H, W) int32, -1 without a geom; see `Eye` for the arguments."""
    with Eye(model, camera, world_from_camera) as eye:
        return eye.segmentation(data)


def bodies_of(model: Any, geoms: np.ndarray) -> np.ndarray:
    """Body ids (H, W) int32 of a segmentation's geom ids; -1 without a geom."""
    owner = np.append(np.asarray(model.geom_bodyid, np.int32), np.int32(-1))
    return np.asarray(owner[geoms])


def owners_of(model: Any, geoms: np.ndarray, names: tuple[str, ...]) -> np.ndarray:
    """For a segmentation's geom ids, the index in `names` of the world's child that each belongs to, (H, W) int32.

    It is -1 without a geom, and for other children.
    """
    roots = np.append(np.asarray(model.body_rootid), -1)[bodies_of(model, geoms)]
    owner = np.full(geoms.shape, -1, np.int32)
    for number, name in enumerate(names):
        owner[roots == model.body(name).id] = number
    return owner


def camera_spec(parent: Any, name: str, camera: Camera, world_from_camera: np.ndarray) -> Any:
    """Add the camera to a spec body (`MjsBody`) whose frame is the world's, and return the `MjsCamera`.

    The sensor is written as a pixel of one micrometre; MuJoCo's principal point is an offset of the image centre
    with y up (from 3.6 on).
    """
    pixel_m = 1e-6
    sensor = (camera.width * pixel_m, camera.height * pixel_m)
    offset = (camera.width / 2 - camera.cx - 0.5, camera.height / 2 - camera.cy - 0.5)
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, (world_from_camera @ GL_FROM_CV)[:3, :3].flatten())
    return parent.add_camera(
        name=name,
        pos=world_from_camera[:3, 3],
        quat=quaternion,
        resolution=(camera.width, camera.height),
        sensor_size=sensor,
        focal_pixel=(camera.fx, camera.fy),
        principal_pixel=offset,
    )
