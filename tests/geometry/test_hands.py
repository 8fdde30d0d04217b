"""Joints of a hand: the order of WebXR, lengths, and frames on a hand laid out by hand."""

import numpy as np
import pytest

from dextera_build.geometry import hands, lie


def flat_right() -> np.ndarray:
    """A right hand with its palm down: fingers along -z, thumb at -x, back of the hand up (+y) [m]."""
    points = np.zeros((25, 3))
    for finger, chain in enumerate(hands.CHAINS):
        across = -0.045 + 0.02 * finger
        for place, joint in enumerate(chain):
            points[joint] = (across, 0.0, -0.03 * (place + 1))
    return points


def bent(points: np.ndarray, angle: float) -> np.ndarray:
    """The four fingers turned about their knuckles towards the palm by an angle [rad]."""
    found = points.copy()
    for chain in hands.CHAINS[1:]:
        turn = lie.about(np.array([-1.0, 0.0, 0.0]), angle)
        found[list(chain[2:])] = (points[list(chain[2:])] - points[chain[1]]) @ turn.T + points[chain[1]]
    return found


def test_joints_tips_and_landmarks_are_where_webxr_and_mediapipe_put_them():
    assert len(hands.JOINTS) == len(hands.PARENTS) == 25
    assert [hands.JOINTS[tip] for tip in hands.TIPS] == [
        *("thumb-tip", "index-finger-tip", "middle-finger-tip", "ring-finger-tip", "pinky-finger-tip")
    ]
    assert hands.TIPS == (4, 9, 14, 19, 24)
    assert [hands.MEDIAPIPE.index(tip) for tip in hands.TIPS] == [4, 8, 12, 16, 20]
    assert all(parent < joint for joint, parent in enumerate(hands.PARENTS))


def test_lengths_are_kept_by_bending_and_scale_with_the_hand():
    flat, curled = flat_right(), bent(flat_right(), 1.0)
    np.testing.assert_allclose(hands.bone_lengths(curled), hands.bone_lengths(flat), atol=1e-12)
    np.testing.assert_allclose(hands.finger_lengths(flat), [0.06, 0.09, 0.09, 0.09, 0.09])
    assert hands.hand_size(curled) == pytest.approx(float(hands.hand_size(flat)))
    assert hands.hand_size(2 * flat) == pytest.approx(2 * float(hands.hand_size(flat)))


def test_the_palm_has_the_axes_of_the_wrist_and_turns_with_the_hand():
    turn = lie.rotation(np.array([0.4, -1.1, 0.7]))
    right = bent(flat_right(), 0.6)
    middle = right[hands.KNUCKLES[2]] / np.linalg.norm(right[hands.KNUCKLES[2]])
    frame = hands.palm_frame(right, "right")
    np.testing.assert_allclose(frame[:, 1], [0, 1, 0], atol=1e-9)
    np.testing.assert_allclose(-frame[:, 2], middle, atol=1e-9)
    assert np.linalg.det(frame) == pytest.approx(1)
    np.testing.assert_allclose(hands.palm_frame(right @ turn.T, "right"), turn @ frame, atol=1e-9)
    np.testing.assert_allclose(hands.palm_frame(hands.mirrored(right), "left")[:, 1], [0, 1, 0], atol=1e-9)


@pytest.mark.parametrize("angle", [0.2, 0.8, 1.5])
def test_bent_fingers_tell_a_right_hand_from_a_left_one(angle):
    turn = lie.rotation(np.array([0.4, -1.1, 0.7]))
    both = np.stack([hands.mirrored(bent(flat_right(), angle)), bent(flat_right(), angle)]) @ turn.T
    left, right = hands.curl(both)
    assert right > 0.01
    assert left == pytest.approx(-right)


def test_the_pinch_is_the_distance_of_two_tips():
    points = flat_right()
    assert hands.pinch_distance(points) == pytest.approx(np.hypot(0.02, 0.03))
    assert hands.pinch_distance(points, "pinky") == pytest.approx(np.hypot(0.08, 0.03))
