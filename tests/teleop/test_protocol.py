"""Frames of hands: what they become, and what is refused."""

from __future__ import annotations

import json
import struct

import numpy as np
import pytest

from dextera_build.geometry import hands, human_hand, lie, quaternions
from dextera_build.sim.experts.live_operator import Refused
from dextera_build.teleop import posture, protocol
from tests.teleop import pages


def at_one_point() -> np.ndarray:
    """Joints (2, 25, 7) as a device may send them before it sees a hand."""
    found = np.zeros((2, 25, 7))
    found[..., 6] = 1
    return found


def test_a_frame_becomes_hands_in_the_base_frame_with_z_up():
    sent = pages.opened()
    frame = protocol.frame(pages.joints(sent, 7), 3.0, 0.0)
    message = frame.message
    assert (message.number, message.arrived, frame.page_ms, frame.measured) == (7, 3.0, 12.5, True)
    # WebXR: half a metre ahead is -z, up is y, right is x; base: x ahead, y left, z up.
    np.testing.assert_allclose(message.positions[:, 0], [[0.5, 0.2, 1.2], [0.5, -0.2, 1.2]], atol=1e-6)
    np.testing.assert_allclose(message.head[:3], [0, 0, 1.6], atol=1e-6)
    ahead = quaternions.to_matrix(message.head[3:].astype(np.float64)) @ [0, 0, -1.0]
    np.testing.assert_allclose(ahead, [1, 0, 0], atol=1e-6)
    assert message.pinch.tolist() == [0.5, 0.25]
    assert message.clutch.all()
    assert message.positions.dtype == message.rotations.dtype == np.float32


def test_a_heading_turns_everything_about_the_vertical():
    plain, turned = (protocol.frame(pages.joints(pages.opened()), 0.0, angle).message for angle in (0.0, np.pi / 2))
    turn = lie.about_z(np.pi / 2)
    np.testing.assert_allclose(turned.positions, plain.positions @ turn.T, atol=1e-6)
    was, now = (quaternions.to_matrix(each.rotations[1, 0].astype(np.float64)) for each in (plain, turned))
    np.testing.assert_allclose(now, turn @ was, atol=1e-6)


def test_a_lost_hand_has_no_numbers_and_no_clutch():
    message = protocol.frame(pages.joints(np.full((2, 25, 7), np.nan), tracking=0), 0.0, 0.0).message
    assert np.isnan(message.positions).all()
    assert np.isnan(message.rotations).all()
    assert not message.clutch.any()


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "has 0 bytes"),
        (pages.joints(np.zeros((2, 21, 7)), count=21), "a hand has 21 joints instead of 25"),
        (pages.joints(pages.opened())[:-4], "bytes instead of"),
        (pages.joints(np.full((2, 25, 7), np.nan)), "the left hand is tracked, but has numbers that are not finite"),
        (pages.joints(1e9 * pages.opened()), "farther away than 100 m"),
        (pages.joints(np.zeros((2, 25, 7))), "no unit quaternions"),
        (pages.joints(at_one_point()), "the wrist and the knuckles of the left hand lie on one line"),
        (pages.joints(np.linspace(0, 0.2, 25)[None, :, None] + at_one_point()), "of the left hand lie on one line"),
        (pages.head(1, 9, 25, 0), "is unknown"),
        (pages.head(1, 0, 25, 0, tracking=7), "is unknown"),
    ],
)
def test_what_is_no_frame_is_refused(data: bytes, words: str):
    with pytest.raises(Refused, match=words):
        protocol.frame(data, 0.0, 0.0)


@pytest.mark.parametrize("text", ["", "[]", "7", "{", '"start"', 3000 * "["])
def test_what_is_no_command_is_refused(text: str):
    with pytest.raises(Refused, match="a command is a JSON object"):
        protocol.command(text)


def test_a_state_is_json_and_numbers_that_a_page_can_map():
    data = protocol.state({"told": "grün"}, np.arange(3.0), np.array([[4.0, np.nan]]))
    (length,) = struct.unpack_from("<I", data)
    assert length % 4 == 0
    assert json.loads(data[4 : 4 + length]) == {"told": "grün"}
    np.testing.assert_array_equal(np.frombuffer(data[4 + length :], "<f4"), [0, 1, 2, 4, np.nan])


def test_one_number_closes_a_hand_at_its_wrist():
    wrist = np.array([[0.1, 0.2, 0.3, 0, 0, 0, 1.0], [0, 0, 0, 0, np.sqrt(0.5), 0, np.sqrt(0.5)]])
    opened, closed = (posture.joints(wrist, np.full(2, share)) for share in (0.0, 1.0))
    np.testing.assert_allclose(opened[:, 0, :3], wrist[:, :3])
    plain, _ = human_hand.Hand().joints(human_hand.open_angles(), "left")
    np.testing.assert_allclose(opened[0, :, :3], plain + wrist[0, :3], atol=1e-12)
    # Left and right bend to their own palms, and thumb and fingers meet.
    assert hands.curl(closed[1, :, :3]) > 0.02
    assert hands.curl(closed[0, :, :3]) < -0.02
    assert (hands.pinch_distance(closed[..., :3]) < 0.3 * hands.pinch_distance(opened[..., :3])).all()
    np.testing.assert_allclose(np.linalg.norm(closed[..., 3:], axis=-1), 1)
    np.testing.assert_allclose(hands.finger_lengths(closed[..., :3]), posture.lengths(), atol=1e-9)
