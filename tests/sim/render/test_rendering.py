"""The calibrated camera in MuJoCo: known points must land where K X / Z says."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.tasks.task import View
from dextera_build.geometry import cameras, transforms
from dextera_build.sim.model.sizes import Sizes
from dextera_build.sim.render import rendering
from tests import factories

CAMERA = Camera(width=200, height=160, fx=230.0, fy=215.0, cx=93.0, cy=88.0)
POINTS = np.array([[0.0, 0.0, 0.0], [0.25, 0.1, 0.05], [-0.2, 0.15, 0.1], [0.1, -0.2, -0.05]])


def look(eye: tuple[float, float, float]) -> np.ndarray:
    """T_world_camera of a camera at `eye` that looks at the origin."""
    place = np.array(eye)
    forward = -place / np.linalg.norm(place)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return transforms.rigid(np.stack([right, np.cross(forward, right), forward], axis=1), place)


def probes(points: np.ndarray, pose: np.ndarray) -> tuple[object, object]:
    """A model of small spheres at `points`, with the camera in it, and its state."""
    spec = mujoco.MjSpec()
    for point in points:
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.02, 0, 0], pos=point)
    rendering.camera_spec(spec.worldbody, "capture", CAMERA, pose)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def centres(ids: np.ndarray, count: int) -> np.ndarray:
    """Mean (column, row) of each geom's pixels."""
    return np.array([np.argwhere(ids == geom)[:, ::-1].mean(axis=0) for geom in range(count)])


@pytest.fixture(scope="module")
def pose() -> np.ndarray:
    return look((0.6, -0.8, 0.7))


def test_probe_spheres_project_where_the_intrinsics_say(pose: np.ndarray) -> None:
    model, data = probes(POINTS, pose)
    wanted = cameras.project(transforms.apply(transforms.invert(pose), POINTS), CAMERA.matrix())
    found = centres(rendering.render_segmentation(model, data, CAMERA, pose), len(POINTS))
    assert np.abs(found - wanted).max() < 0.3


def test_the_camera_in_the_model_agrees_with_the_one_given_directly(pose: np.ndarray) -> None:
    model, data = probes(POINTS, pose)
    direct = rendering.render_segmentation(model, data, CAMERA, pose)
    with mujoco.Renderer(model, CAMERA.height, CAMERA.width) as renderer:
        renderer.update_scene(data, camera="capture")
        renderer.enable_segmentation_rendering()
        named = np.where(renderer.render()[..., 1] >= 0, renderer.render()[..., 0], -1)
    assert np.abs(centres(direct, len(POINTS)) - centres(named, len(POINTS))).max() < 0.1


def test_depth_is_image_plane_z_and_zero_where_nothing_is(pose: np.ndarray) -> None:
    spec = mujoco.MjSpec()
    facing = transforms.invert(pose)
    place = transforms.apply(pose, np.array([0.0, 0.0, 1.2]))
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, facing[:3, :3].T.flatten())
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.3, 0.1, 0.1], pos=place, quat=quaternion)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    depth = rendering.render_depth(model, data, CAMERA, pose)
    assert depth[0, 0] == 0.0
    seen = depth[80:95, 60:120]
    np.testing.assert_allclose(seen, 1.1, atol=1e-3)


def test_the_same_scene_gives_the_same_bytes(pose: np.ndarray) -> None:
    model, data = probes(POINTS, pose)
    first = rendering.render_rgb(model, data, CAMERA, pose, shadows=True)
    second = rendering.render_rgb(model, data, CAMERA, pose, shadows=True)
    assert first.tobytes() == second.tobytes()
    assert first.std() > 1.0


def test_eyes_with_and_without_shadows_share_a_model(pose: np.ndarray) -> None:
    spec = mujoco.MjSpec()
    spec.worldbody.add_light(pos=[0.0, 0.0, 1.0], dir=[0.0, 0.0, -1.0])
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[1.0, 1.0, 0.1])
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.05, 0, 0], pos=[0.0, 0.0, 0.2])
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    plain, shaded, again = (
        rendering.render_rgb(model, data, CAMERA, pose, shadows=shadows).astype(int) for shadows in (False, True, False)
    )
    assert np.array_equal(plain, again)
    assert (plain - shaded).max() > 20


def test_one_sample_per_pixel_keeps_colours_apart_and_four_blend_them(pose: np.ndarray) -> None:
    model, data = probes(POINTS, pose)
    behind = rendering.render_segmentation(model, data, CAMERA, pose) < 0
    blended = {}
    for samples in (1, 4):
        with rendering.through(
            model, View(camera=CAMERA, camera_pose=factories.placed(pose, "camera"), samples=samples)
        ) as eye:
            blended[samples] = np.any(eye.rgb(data)[behind] != 0, axis=-1).sum()
    assert blended[1] == 0
    assert blended[4] > 20


def test_a_camera_draws_a_resized_mesh_at_its_size(pose: np.ndarray) -> None:
    spec = mujoco.MjSpec()
    spec.add_mesh(name="rock", uservert=[0, 0, 0, 0.2, 0, 0, 0, 0.2, 0, 0, 0, 0.2])
    body = spec.worldbody.add_body(name="thing")
    body.add_freejoint()
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="rock")
    model = spec.compile()
    data = mujoco.MjData(model)
    sizes = Sizes(["thing"], model)
    with rendering.Eye(model, CAMERA, pose) as eye:
        seen = []
        for scale in (1.0, 0.5, 1.0):
            sizes.put({"thing": scale})
            mujoco.mj_forward(model, data)
            seen.append(int((eye.segmentation(data) >= 0).sum()))
    assert seen[0] == seen[2]
    assert seen[1] == pytest.approx(seen[0] / 4, rel=0.15)
