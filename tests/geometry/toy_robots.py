"""Robots of tubes and a box as points on their visible side, with errors that a real one has against its model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.geometry import cameras, lie, transforms
from dextera_build.geometry.robot_pairs import Surface

LENGTHS = (0.30, 0.32, 0.28)
RADIUS = 0.06
CAMERA = cameras.look_at(np.array([1.5, 0.4, 0.8]), np.array([0.1, 0.0, 0.5]))
"""T_base_camera (4, 4)."""
JOINTS = 4
Shape = dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]
"""Component -> points (N, 3) and normals (N, 3) in the frame of their link, and the links (N,)."""


@dataclass(frozen=True)
class Faults:
    """What differs between the robot and its model."""

    shape_scale: float = 1.0
    """The arm's surface is this many times as large, about the base; the hand is where the joints say."""
    cover_m: float = 0.0
    """The arm's surface is so far outside its model, along the normals."""
    length_scale: float = 1.0
    """The arm's links are this many times as long, so that the hand moves with them."""
    joint_rad: float = 0.0
    """Standard deviation of each joint's zero, the same in all poses."""
    encoder_rad: float = 0.0
    """Standard deviation of each joint in each pose."""
    depth_m: float = 0.001
    """Standard deviation of the depth of a point."""


@dataclass(frozen=True)
class Scene:
    """A simulated capture."""

    poses: list[dict[str, Surface]]
    error: np.ndarray  # (4, 4) the true dT
    hands: np.ndarray  # (2, poses, 3) in the camera frame: the model's at the wrong calibration, and the robot's

    def hand_error(self, found: np.ndarray) -> float:
        """Mean distance [m] of the model's hand, after the correction (4, 4), from where the robot has it."""
        return float(np.linalg.norm(transforms.apply(found, self.hands[0]) - self.hands[1], axis=1).mean())


def capture(
    seed: int, count: int = 5, *, faults: Faults | None = None, size: float = 1.0, hand_points: int = 400
) -> Scene:
    """A robot in `count` poses with 20 times as many points on the arm as on the hand.

    Args:
        seed: Of poses and errors.
        count: Number of poses.
        faults: Of the robot against its model.
        size: Error of the calibration; 1 is about 15 mm and 1.5 deg.
        hand_points: Of the model in each pose.
    """
    draw, faults = np.random.default_rng(seed), faults or Faults()
    error = transforms.rigid(lie.rotation(0.015 * size * draw.normal(size=3)), 0.009 * size * draw.normal(size=3))
    right, wrong = transforms.invert(CAMERA), transforms.invert(error) @ transforms.invert(CAMERA)
    offsets = faults.joint_rad * draw.normal(size=JOINTS)
    poses, hands = [], []
    for _ in range(count):
        joints = draw.uniform([-0.8, -0.5, -1.2, -1.0], [0.8, 0.7, 1.2, 1.0])
        now = joints + offsets + faults.encoder_rad * draw.normal(size=JOINTS)
        model, real = _shape(hand_points, draw), _shape(2 * hand_points, draw)
        pose = {}
        for name in ("arm", "hand"):
            points, normals = _posed(model[name], joints)
            seen, seen_normals = _posed(real[name], now, faults.length_scale)
            seen = seen * faults.shape_scale + faults.cover_m * seen_normals if name == "arm" else seen
            front = _faces(wrong, points, normals, 0.1)
            drift = np.stack(
                [_posed(model[name], joints + step)[0] - points for step in 1e-4 * np.eye(JOINTS)], axis=-1
            )
            pose[name] = Surface(
                model=transforms.apply(wrong, points[front]),
                normals=normals[front] @ wrong[:3, :3].T,
                link=model[name][2][front],
                seen=_measured(transforms.apply(right, seen[_faces(right, seen, seen_normals, 0.0)]), faults, draw),
                drift=np.einsum("ij,njq->niq", wrong[:3, :3], drift[front]) / 1e-4,
            )
        poses.append(pose)
        palm = (np.array([[0.0, 0.0, 0.1]]), np.array([[0.0, 0.0, 1.0]]), np.array([3]))
        places = _posed(palm, joints)[0], _posed(palm, now, faults.length_scale)[0]
        hands.append([transforms.apply(wrong, places[0])[0], transforms.apply(right, places[1])[0]])
    return Scene(poses, error, np.array(hands).transpose(1, 0, 2))


def _measured(points: np.ndarray, faults: Faults, draw: np.random.Generator) -> np.ndarray:
    return np.asarray(points + points / points[:, 2:] * (faults.depth_m * draw.normal(size=len(points)))[:, None])


def _faces(from_base: np.ndarray, points: np.ndarray, normals: np.ndarray, least: float) -> np.ndarray:
    places = transforms.apply(from_base, points)
    cosine = -((normals @ from_base[:3, :3].T) * places).sum(axis=1) / np.linalg.norm(places, axis=1)
    return np.asarray(cosine > least)


def _posed(
    shape: tuple[np.ndarray, np.ndarray, np.ndarray], joints: np.ndarray, scale: float = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    """Points and normals in the base's frame; links 0, 1, 2 are the arm, 3 and above the hand."""
    points, normals, links = shape
    frame = transforms.rigid(lie.rotation(np.array([0.0, 0.0, joints[0]])), np.zeros(3))
    placed, turned = np.empty_like(points), np.empty_like(normals)
    for number, length in enumerate((*LENGTHS, 0.0)):
        if number < len(LENGTHS):
            frame = frame @ transforms.rigid(lie.rotation(np.array([0, joints[number + 1], 0])), np.zeros(3))
        own = links == number if number < len(LENGTHS) else links >= number
        stretch = np.array([1.0, 1.0, scale]) if number < len(LENGTHS) else np.ones(3)
        placed[own] = transforms.apply(frame, points[own] * stretch)
        turned[own] = normals[own] @ frame[:3, :3].T
        frame = frame @ transforms.rigid(np.eye(3), np.array([0.0, 0.0, scale * length]))
    return placed, turned


def _shape(count: int, draw: np.random.Generator) -> Shape:
    arm = [_tube(length, RADIUS - 0.01 * i, 20 * count // 3, i, draw) for i, length in enumerate(LENGTHS)]
    fingers = []
    for finger in range(3):
        points, normals, links = _tube(0.08, 0.009, count // 6, 4 + finger, draw)
        fingers.append((points + np.array([0.03 * (finger - 1), 0.0, 0.1]), normals, links))
    return {"arm": _joined(arm), "hand": _joined([_palm(count // 2, draw), *fingers])}


def _joined(parts: list[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    points, normals, links = (np.concatenate(each) for each in zip(*parts, strict=True))
    return points, normals, links


def _tube(
    length: float, radius: float, count: int, link: int, draw: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    turn, height = draw.uniform(0, 2 * np.pi, count), draw.uniform(0, length, count)
    normal = np.stack([np.cos(turn), np.sin(turn), np.zeros(count)], axis=1)
    return radius * normal + np.outer(height, [0.0, 0.0, 1.0]), normal, np.full(count, link)


def _palm(count: int, draw: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    face = draw.integers(0, 6, count)
    normal = np.eye(3)[face // 2] * (2.0 * (face % 2) - 1)[:, None]
    inside = np.where(normal != 0, normal, draw.uniform(-1, 1, (count, 3)))
    return inside * [0.045, 0.02, 0.05] + [0.0, 0.0, 0.05], normal, np.full(count, 3)
