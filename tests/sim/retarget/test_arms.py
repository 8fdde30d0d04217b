"""Palms that follow wrists: relative to the clutch, and never by a jump."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.geometry import lie, transforms
from dextera_build.sim.retarget.arms import Palm, heading
from dextera_build.sim.retarget.options import Retargeting

START = transforms.rigid(lie.rotation(np.array([0.3, -0.2, 1.0])), np.array([0.5, 0.1, 0.4]))
WRIST = transforms.rigid(lie.rotation(np.array([1.0, 0.5, -0.7])), np.array([-2.0, 3.0, 1.1]))


def moved(pose: np.ndarray, by: tuple[float, float, float], turn: tuple[float, float, float]) -> np.ndarray:
    """A pose moved and turned in the axes of its frame."""
    return transforms.rigid(lie.rotation(np.array(turn)) @ pose[:3, :3], pose[:3, 3] + np.array(by))


def test_the_palm_moves_and_turns_as_the_wrist_does() -> None:
    palm = Palm(START, Retargeting())
    palm.next(WRIST)
    target, held = palm.next(moved(WRIST, (0.01, -0.02, 0.03), (0.0, 0.0, 0.2)))
    assert not held
    assert target == pytest.approx(moved(START, (0.01, -0.02, 0.03), (0.0, 0.0, 0.2)))


def test_a_heading_turns_motion_and_a_scale_lengthens_it() -> None:
    palm = Palm(START, Retargeting(heading_rad=np.pi / 2, arm_scale=2.0))
    palm.next(WRIST)
    target, _ = palm.next(moved(WRIST, (0.01, 0.0, 0.0), (0.2, 0.0, 0.0)))
    assert target == pytest.approx(moved(START, (0.0, 0.02, 0.0), (0.0, 0.2, 0.0)))


def test_a_head_that_looks_along_an_axis_has_the_heading_of_that_axis() -> None:
    ahead = np.array([[0.0, 0, -1], [-1, 0, 0], [0, 1, 0]])  # -Z ahead is +x of the room
    for angle in (-2.0, 0.0, 0.7, 3.0):
        found = heading(lie.about_z(angle) @ ahead)
        assert lie.about_z(found) @ lie.about_z(angle) == pytest.approx(np.eye(3))


def test_the_reference_is_taken_anew_at_every_clutch() -> None:
    palm = Palm(START, Retargeting())
    palm.next(WRIST)
    first, _ = palm.next(moved(WRIST, (0.05, 0.0, 0.0), (0.0, 0.0, 0.0)))
    assert palm.next(None)[0] == pytest.approx(first)
    away = moved(WRIST, (-1.0, 0.5, 0.2), (0.0, 1.0, 0.0))
    target, held = palm.next(away)
    assert held
    assert target == pytest.approx(first)
    target, held = palm.next(moved(away, (0.0, 0.04, 0.0), (0.0, 0.0, 0.0)))
    assert not held
    assert target == pytest.approx(moved(first, (0.0, 0.04, 0.0), (0.0, 0.0, 0.0)))


@pytest.mark.parametrize(
    ("by", "turn", "jumps"),
    [
        ((0.059, 0.0, 0.0), (0.0, 0.0, 0.0), False),
        ((0.0, 0.061, 0.0), (0.0, 0.0, 0.0), True),
        ((0.0, 0.0, 0.0), (np.radians(24.5), 0.0, 0.0), False),
        ((0.0, 0.0, 0.0), (0.0, np.radians(25.5), 0.0), True),
    ],
)
def test_a_jump_is_not_followed(by, turn, jumps) -> None:
    palm = Palm(START, Retargeting())
    palm.next(WRIST)
    target, held = palm.next(moved(WRIST, by, turn))
    assert held == jumps
    assert target == pytest.approx(START if jumps else moved(START, by, turn))
    after, held = palm.next(moved(moved(WRIST, by, turn), (0.01, 0.0, 0.0), (0.0, 0.0, 0.0)))
    assert not held
    assert after == pytest.approx(moved(target, (0.01, 0.0, 0.0), (0.0, 0.0, 0.0)))


def test_the_wrist_of_a_room_turned_as_a_whole_moves_the_palm_alike() -> None:
    """With the heading that undoes the turn: nothing depends on where the operator stands."""
    turn = transforms.rigid(lie.about_z(1.2), np.array([4.0, -1.0, 0.3]))
    plain, turned = Palm(START, Retargeting(heading_rad=0.0)), Palm(START, Retargeting(heading_rad=-1.2))
    random = np.random.default_rng(3)
    wrist = WRIST
    for _ in range(20):
        wrist = moved(wrist, tuple(random.normal(0, 0.01, 3)), tuple(random.normal(0, 0.05, 3)))
        assert turned.next(turn @ wrist)[0] == pytest.approx(plain.next(wrist)[0])
