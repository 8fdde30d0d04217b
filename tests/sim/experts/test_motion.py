"""Motions of scripted hands."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dextera_build.geometry import lie, transforms
from dextera_build.sim.control.operator import BASE
from dextera_build.sim.experts.drive import _Labels
from dextera_build.sim.experts.motion import Leg, between, follow, minimum_jerk, sample
from tests import factories

ANGLE = st.floats(-3.1, 3.1)


@given(ANGLE, ANGLE, ANGLE)
def test_rotation_vectors_and_rotations_are_inverse(x: float, y: float, z: float) -> None:
    turn = lie.rotation(np.array([x, y, z]))
    assert np.allclose(turn @ turn.T, np.eye(3), atol=1e-9)
    assert np.allclose(lie.rotation(lie.rotation_vector(turn)), turn, atol=1e-6)


def test_a_half_turn_has_an_axis() -> None:
    turn = lie.rotation(np.array([0.0, np.pi, 0.0]))
    assert np.allclose(lie.rotation(lie.rotation_vector(turn)), turn, atol=1e-6)


def test_minimum_jerk_rests_at_both_ends() -> None:
    parts = np.linspace(0, 1, 1001)
    way = np.array([minimum_jerk(part) for part in parts])
    assert way[0] == 0.0
    assert way[-1] == pytest.approx(1.0)
    speed = np.gradient(way, parts)
    assert abs(speed[0]) < 1e-3
    assert abs(speed[-1]) < 1e-3
    assert (np.diff(way) >= 0).all()


def test_between_goes_straight_and_the_short_way_round() -> None:
    first, last = factories.pose(0.0, 0.0, 0.0, yaw=3.0), factories.pose(0.2, 0.0, 0.1, yaw=-3.0)
    middle = between(first, last, 0.5)
    assert np.allclose(middle[:3, 3], [0.1, 0.0, 0.05])
    assert transforms.angle(first[:3, :3].T @ middle[:3, :3]) == pytest.approx(np.pi - 3.0, abs=1e-6)


def test_a_sampled_plan_ends_its_legs_where_they_say_and_jumps_nowhere() -> None:
    start, end = factories.pose(0.0, 0.0, 0.2), factories.pose(0.3, 0.1, 0.2, yaw=0.5)
    legs = [
        Leg(end, np.ones(2), 1.0, "approach", arc_m=0.1),
        Leg(end, np.zeros(2), 0.5, "grasp", "box", True),
    ]
    commands = list(sample("arm", start, np.zeros(2), legs, 20.0))
    assert len(commands) == 30
    assert np.allclose(commands[19].aims["arm"].palm, end)
    assert np.allclose(commands[19].aims["arm"].fingers, 1.0)
    assert [commands[19].contact, commands[20].contact] == [False, True]
    heights = np.array([command.aims["arm"].palm[2, 3] for command in commands])
    assert heights.max() == pytest.approx(0.3, abs=1e-3)
    places = np.array([start[:3, 3], *(command.aims["arm"].palm[:3, 3] for command in commands)])
    assert np.linalg.norm(np.diff(places, axis=0), axis=1).max() < 0.05


def test_limbs_that_do_the_same_share_a_segment_and_others_have_their_own() -> None:
    here = np.eye(4)
    takes = [Leg(here, np.zeros(1), 0.1, "grasp", "box", True), Leg(here, np.zeros(1), 0.1, "lift", "box", True)]
    waits = [Leg(here, np.zeros(1), 0.1, "stay", BASE, False), takes[1]]
    hands = {"left": (here, np.zeros(1)), "right": (here, np.zeros(1))}
    labels = _Labels()
    commands = list(follow({"left": takes, "right": waits}, hands, 20.0))
    for command in commands:
        labels.add(command)
    assert [command.contact for command in commands] == [True] * 4
    found = [(each.name, each.first, each.last, each.frame, each.limbs) for each in labels.segments()]
    assert found == [
        ("grasp", 0, 2, "box", ("left",)),
        ("stay", 0, 2, BASE, ("right",)),
        ("lift", 2, 4, "box", ("left", "right")),
    ]
