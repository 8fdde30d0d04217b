"""Theta of scene alignment: the pose of a camera in a generated scene G, and the length of a unit of G in metres.

The paper's Eq. 1 has theta = (T_G_C, s_G). A point X of G is at Y = T_C_G X in the unit of G, and at s_G Y in metres:
the scale is applied before the motion. A picture of G depends on T_C_G only, so colours and pixels carry no information
on s_G; only measured depth does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.geometry import lie, transforms


@dataclass(frozen=True)
class ScenePose:
    """Theta. Steps (7,) are a shift and a rotation vector [rad], both about the camera's axes, and log s_G."""

    camera_from_scene: np.ndarray  # (4, 4) T_C_G, OpenCV axes, in the unit of G
    scale: float  # s_G [m per unit of G]

    @property
    def scene_from_camera(self) -> np.ndarray:
        """T_G_C (4, 4) in the unit of G, for renderers."""
        return transforms.invert(self.camera_from_scene)

    @property
    def matrix(self) -> np.ndarray:
        """(4, 4) rigid motion [m] that follows the scale: X_C = matrix @ [s_G X_G, 1]."""
        return transforms.rigid(self.camera_from_scene[:3, :3], self.scale * self.camera_from_scene[:3, 3])

    def seen(self, points: np.ndarray) -> np.ndarray:
        """Points (N, 3) of G in the axes of the camera, in the unit of G."""
        return transforms.apply(self.camera_from_scene, points)

    def moved(self, step: np.ndarray, unit: float) -> ScenePose:
        """Theta after a step (7,), whose shift is in `unit` units of G: Y' = Exp(step[3:6]) Y + unit step[:3]."""
        motion = lie.motion(np.concatenate([unit * step[:3], step[3:6]]), np.zeros(3))
        return ScenePose(motion @ self.camera_from_scene, self.scale * float(np.exp(step[6])))

    def step_to(self, other: ScenePose, unit: float) -> np.ndarray:
        """The step (7,) that leads to `other`."""
        motion = other.camera_from_scene @ transforms.invert(self.camera_from_scene)
        twist = lie.between(np.eye(4), motion)
        return np.array([*twist[:3] / unit, *twist[3:], np.log(other.scale / self.scale)])

    def covariance(self, of_steps: np.ndarray, unit: float) -> np.ndarray:
        """Covariance (7, 7) as in `artifacts.pose.Similarity`, from that of steps.

        With matrix = [R t] and t = s tau, a step changes t by w x t + s unit v + l t, R by w and log s by l.
        """
        jacobian = lie.adjoint(self.matrix[:3, 3], 7)
        jacobian[:3, :3] *= self.scale * unit
        spread = jacobian @ of_steps @ jacobian.T
        return np.asarray((spread + spread.T) / 2)


def flow(seen: np.ndarray, k: np.ndarray, unit: float) -> np.ndarray:
    """Pixel motion with a step: (..., 2, 7) [px] for points (..., 3) in the axes of the camera, in the unit of G."""
    x, y, z = np.moveaxis(seen, -1, 0)
    found = np.zeros((*seen.shape[:-1], 2, 7))
    for axis, focal in enumerate((k[0, 0], k[1, 1])):
        aside, near = focal / z, -focal * seen[..., axis] / z**2  # derivative by the point: along the axis, along z
        # A rotation w moves the point by w x Y, and d(w x Y) . g = w . (Y x g).
        found[..., axis, axis] = unit * aside
        found[..., axis, 2] = unit * near
        found[..., axis, 3] = y * near
        found[..., axis, 4] = -x * near
        found[..., axis, 4 - axis] += (z if axis == 0 else -z) * aside
        found[..., axis, 5] = -y * aside if axis == 0 else x * aside
    return found


def nearing(seen: np.ndarray, scale: float, unit: float) -> np.ndarray:
    """Change of metric depths s_G Y_z with a step: (N, 7) [m] for points (N, 3) in the axes of the camera."""
    found = np.zeros((len(seen), 7))
    found[:, 2] = scale * unit
    found[:, 3], found[:, 4] = scale * seen[:, 1], -scale * seen[:, 0]
    found[:, 6] = scale * seen[:, 2]
    return found
