"""Collision boxes: what things stand on carries them, and no box is without volume."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.objects.view import InstanceMap
from dextera_build.artifacts.scenes.scene import Background, SupportBox
from dextera_build.geometry import lie
from dextera_build.rule import Context
from rules.background import static_planes
from rules.background.fixtures import _parted, room_boxes, support_boxes
from rules.background.levels import Level
from rules.background.shell import Room
from rules.background.static import StaticOptions, static
from tests.rules.background.test_furnished import THINGS, photographed

SECOND = {"second table": ((0.3, 0.75, -0.03), (0.9, 1.15, 0.0), (168, 140, 110))}
CARRIED = ((0.5, 0.85, 0.0), (0.6, 0.95, 0.12), (200, 60, 40))
VASE = ((-0.5, 0.85, 0.15), (-0.38, 0.97, 0.4), (60, 120, 60))


def built(things: dict[str, tuple[tuple[float, ...], ...]], thing: int, path: Path) -> Background:
    capture, index, table = photographed(things)
    instances = InstanceMap(labels=(index == thing).astype(np.int32), fixed=np.zeros(index.shape, bool))
    context = Context(static_planes, static_planes.PlanesOptions(), scratch=path)
    return static(context, capture.photograph, table, instances, capture.measured, options=StaticOptions())


def under(boxes: tuple[SupportBox, ...], points: np.ndarray) -> np.ndarray:
    """Boxes (B, N) that hold the points (N, 2) between their sides."""
    found = []
    for box in boxes:
        local = (points - box.centre[:2]) @ lie.about_z(-box.yaw)[:2, :2].T
        found.append((np.abs(local) <= box.half_size[:2]).all(axis=1))
    return np.array(found)


def tops(boxes: tuple[SupportBox, ...]) -> np.ndarray:
    return np.array([box.centre[2] + box.half_size[2] for box in boxes])


@pytest.mark.medium
def test_what_stands_on_another_table_of_the_same_height_is_carried(tmp_path: Path) -> None:
    made = built({**THINGS, **SECOND, "carried": CARRIED}, len(THINGS) + 1, tmp_path)
    corners = np.array([[x, y] for x in (0.51, 0.59) for y in (0.86, 0.94)])
    level = np.abs(tops(made.boxes)) < 1e-6
    assert under(made.boxes, corners)[level].any(axis=0).all()
    assert not under(made.boxes[:1], corners).any(), "the first table ends before it"


def test_what_is_between_two_levels_keeps_its_collision() -> None:
    """The front of a cupboard of .9 m with two shelves: nothing between the shelves collided."""
    y, z = np.meshgrid(np.linspace(0.0, 0.5, 60), np.linspace(0.02, 0.9, 100))
    front = np.column_stack([np.full(y.size, 1.0), y.ravel(), z.ravel()])
    shelves = [Level(np.array([0.9, 0.0]), np.array([1.2, 0.5]), height) for height in (0.3, 0.6)]
    low, high, eye = np.array([0.9, 0.0, 0.0]), np.array([1.2, 0.5, 0.95]), np.zeros(3)
    parts = list(_parted(front, low, high, eye, shelves))
    ends = [(round(float(least[2]), 1), round(float(most[2]), 1)) for least, most in parts]
    assert ends == [(0.0, 0.3), (0.3, 0.6), (0.6, 0.9)]


@pytest.mark.medium
def test_what_rises_above_a_level_keeps_its_collision(tmp_path: Path) -> None:
    made = built({**THINGS, "vase": VASE}, -2, tmp_path)
    high = under(made.boxes, np.array([[-0.44, 0.87]]))[:, 0] & (tops(made.boxes) < 0.5)
    assert tops(made.boxes)[high].max() == pytest.approx(0.4, abs=0.03)
    assert all(min(box.half_size) >= 0.001 for box in made.boxes)


def test_places_of_things_off_the_support_are_carried_at_its_level() -> None:
    room = Room(0.3, np.array([-2.0, -2.0, -0.8]), np.array([2.0, 2.0, 2.0]), (False,) * 5)
    box = SupportBox(name="support", centre=(0.0, 0.0, -0.025), half_size=(0.2, 0.2, 0.025), yaw=0.3)
    feet = np.array([[0.5, 0.1], [0.52, 0.12], [0.05, 0.05]])
    boxes = tuple(support_boxes(np.zeros((0, 3)), feet, box, room))
    assert under(boxes, feet).any(axis=0).tolist() == [True, True, False]
    assert tops(boxes) == pytest.approx(0.0)
    assert not {each.name for each in boxes} & {"support", *(each.name for each in room_boxes(room))}
    assert support_boxes(np.zeros((0, 3)), feet[2:], box, room) == []
