"""Hands from MediaPipe's landmarks, projected from an articulated hand; no human hand was filmed."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dextera_build.geometry import hands, human_hand, lie, quaternions
from dextera_build.teleop import posture
from dextera_build.teleop.landmarks import FACING, Landmarks, rotations_of
from dextera_build.teleop.protocol import AHEAD

WIDTH, HEIGHT, VIEW_RAD, LENGTH_M = 640, 480, float(np.radians(60)), 0.19
FOCAL_PX = 0.5 * WIDTH / np.tan(0.5 * VIEW_RAD)
UPRIGHT = np.array([[-1.0, 0, 0], [0, 0, 1], [0, 1, 0]])
"""Rotation of a wrist into the camera's axes: fingers up, the palm towards the camera."""


def held(side: str, place: tuple[float, float, float], closed: float = 0.0, turn: np.ndarray | None = None) -> Any:
    """Joints (25, 3) and rotations (25, 3, 3) of a hand before the camera, in its axes."""
    angles = human_hand.open_angles() * (1 - closed) + closed * np.deg2rad(posture.CLOSED_DEG)
    points, turns = human_hand.Hand(LENGTH_M).joints(angles, side)
    frame = (np.eye(3) if turn is None else turn) @ UPRIGHT
    return points @ frame.T + place, frame @ turns


def landmarks(
    points: np.ndarray, side: str, sure: float = 0.98, noise_px: float = 0.0, seed: int = 0
) -> dict[str, Any]:
    """What MediaPipe says of a hand: its points in the picture, and in space of a hand of another size."""
    seen = points[list(hands.MEDIAPIPE)]
    image = FOCAL_PX * seen[:, :2] / seen[:, 2:] + [0.5 * WIDTH, 0.5 * HEIGHT]
    image += np.random.default_rng(seed).normal(0, noise_px, image.shape)
    return {"side": side, "sure": sure, "image": image.tolist(), "world": (0.83 * (seen - seen.mean(axis=0))).tolist()}


def reader() -> Landmarks:
    return Landmarks(WIDTH, HEIGHT, VIEW_RAD, LENGTH_M)


@pytest.mark.parametrize("side", hands.SIDES)
@pytest.mark.parametrize("closed", [0.0, 0.7])
def test_a_hand_before_the_camera_is_found_where_it_is(side: str, closed: float):
    turn = lie.rotation(np.array([0.3, -0.5, 0.4]))
    points, _ = held(side, (0.08, 0.05, 0.55), closed, turn)
    message = reader().message([landmarks(points, side)], 1.0, 2.0, 0.0)
    hand = hands.SIDES.index(side)
    to_base = AHEAD @ FACING
    known = list(hands.MEDIAPIPE)
    np.testing.assert_allclose(message.positions[hand, known], (points @ to_base.T)[known], atol=0.004)
    assert np.isnan(message.positions[1 - hand]).all()
    assert message.tracking.tolist() == [2 * (hand == 0), 2 * (hand == 1)]
    wrist = quaternions.to_matrix(message.rotations[hand, 0].astype(np.float64))
    off = lie.rotation_vector(wrist.T @ to_base @ hands.palm_frame(points, side))
    assert np.linalg.norm(off) < 0.02
    # Inferred: the metacarpals lie in the palm, and bones of the fingers point along -Z.
    assert np.linalg.norm(message.positions[hand] - points @ to_base.T, axis=1).max() < 0.02
    bone = message.positions[hand, 8] - message.positions[hand, 7]
    frame = quaternions.to_matrix(message.rotations[hand, 7].astype(np.float64))
    np.testing.assert_allclose(-frame[:, 2], bone / np.linalg.norm(bone), atol=1e-3)
    assert np.isfinite(message.rotations[hand]).all()
    assert np.isnan(message.head).all()


def test_a_hand_towards_the_camera_goes_ahead_in_the_base():
    """The operator faces the camera, as the robot would face away from it."""
    near, far = (
        reader().message([landmarks(held("right", place)[0], "right")], 1.0, 2.0, 0.0).positions[1, 0]
        for place in ((0.0, 0.0, 0.4), (0.0, 0.0, 0.6))
    )
    assert near[0] - far[0] == pytest.approx(0.2, abs=0.01)
    # Left in the picture is the operator's right, which is the base's -y.
    left, right = (
        reader().message([landmarks(held("right", place)[0], "right")], 1.0, 2.0, 0.0).positions[1, 0]
        for place in ((-0.1, 0.0, 0.5), (0.1, 0.0, 0.5))
    )
    assert right[1] - left[1] == pytest.approx(0.2, abs=0.01)


def test_the_distance_is_as_wrong_as_the_stated_length_and_a_pixel_moves_it_by_its_share_of_the_palm():
    points, _ = held("right", (0.0, 0.0, 0.5))
    wrong = Landmarks(WIDTH, HEIGHT, VIEW_RAD, 1.1 * LENGTH_M)
    assert wrong.message([landmarks(points, "right")], 1.0, 2.0, 0.0).positions[1, 0, 0] == pytest.approx(
        -1.1 * points[0, 2], rel=0.02
    )
    places = np.array(
        [
            reader().message([landmarks(points, "right", noise_px=1.0, seed=seed)], 1.0, 2.0, 0.0).positions[1, 0]
            for seed in range(60)
        ]
    )
    palm_px = FOCAL_PX * np.linalg.norm(points[9] - points[0]) / 0.5
    depth, across = places[:, 0].std(), places[:, 1:].std(axis=0).max()
    assert 0.2 < depth / (0.5 / palm_px) < 3.0
    assert across < 0.5 * depth


def test_a_doubtful_side_does_not_change_a_hand():
    found = reader()
    points, _ = held("right", (0.0, 0.0, 0.5))
    for number, (side, sure) in enumerate((("right", 0.97), ("left", 0.55), ("left", 0.6))):
        assert found.message([landmarks(points, side, sure)], number / 30, 0.0, 0.0).tracking.tolist() == [0, 2]
    mirrored, _ = held("left", (0.0, 0.0, 0.5))
    assert found.message([landmarks(mirrored, "left", 0.95)], 0.1, 0.0, 0.0).tracking.tolist() == [2, 0]
    both = [landmarks(points, "right"), landmarks(mirrored, "left")]
    assert found.message(both, 0.2, 0.0, 0.0).tracking.tolist() == [2, 2]
    assert found.message([], 0.3, 0.0, 0.0).tracking.tolist() == [0, 0]


def test_a_thumb_at_the_little_finger_opens_the_clutch():
    points, _ = held("right", (0.0, 0.0, 0.5))
    touching = points.copy()
    touching[hands.TIPS[0]] = touching[hands.TIPS[4]] + [0.0, 0.0, 0.01]
    for hand, closed in ((points, True), (touching, False)):
        assert reader().message([landmarks(hand, "right")], 1.0, 2.0, 0.0).clutch.tolist() == [False, closed]


def test_rotations_of_an_open_hand_are_those_of_the_articulated_hand():
    points, turns = held("right", (0.0, 0.0, 0.5), 0.0)
    off = [lie.rotation_vector(one.T @ other) for one, other in zip(rotations_of(points, "right"), turns, strict=True)]
    # Bones agree; the thumb's pad looks sideways, which no point shows.
    assert np.linalg.norm(np.array(off)[5:], axis=1).max() < 0.25
