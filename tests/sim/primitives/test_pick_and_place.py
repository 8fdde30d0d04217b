"""What looks like a placement to a judge who only looks where the object is in the end."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.tasks.task import Cavity, TaskObject, TaskSpec
from dextera_build.geometry import cavities
from dextera_build.sim.primitives.catalogue import of
from dextera_build.sim.primitives.pick_and_place.primitive import PlaceGoal, inside
from dextera_build.sim.primitives.poses import Tolerance
from tests import factories
from tests.sim.primitives.traces import AWAY, FREE, HALF_M, HOLD, POKE, SET, Trace, about, box

NEAR = Tolerance(position_m=0.02, rotation_rad=0.2)
THERE = (0.3, 0.0, HALF_M)
TASK = TaskSpec(name="PlaceBox", object="box", goal=PlaceGoal(place_m=THERE, tolerance=NEAR))
INTO = TaskSpec(name="PlaceBoxInTray", object="box", goal=PlaceGoal(into="tray", tolerance=NEAR))
TRAY = factories.pose(0.3, 0.0, 0.0, yaw=0.6)
"""T_world_tray; its floor is 10 mm above its origin."""
LAID = (0.3, 0.0, HALF_M + 0.01)


def tray(wall: float = 0.06) -> TaskObject:
    """A tray of 160 mm by its rim, with a handle beside it that its hull would take in."""
    n, thick = 40, 0.01
    cells = np.full((n, n), 0.0, np.float32)
    rim = cells.copy()
    cells[5:30, 5:35] = thick
    rim[5:30, 5:35] = wall
    cavity = Cavity(corner_m=(-0.1, -0.1), cell_m=0.2 / n, floor_m=cells, rim_m=rim)
    return box().model_copy(update={"cavity": cavity})


def carried(end: tuple[float, float, float], limbs: tuple[str, ...] = ("right",), **grasps: object) -> Trace:
    """The box in the hand, up, over and down to `end`."""
    trace = Trace(limbs, {"tray": TRAY}).stay(2)
    hand = grasps or {"right": HOLD}
    return trace.go((0.0, 0.0, 0.2), 20, **hand).go((end[0], end[1], 0.2), 20, **hand).go(end, 20, **hand)


def naive(trace: Trace, end: tuple[float, float, float]) -> bool:
    """The last place is the target."""
    return bool(np.linalg.norm(trace.states[-1].place[0] - end) <= 0.02)


def test_an_honest_placement_counts() -> None:
    assert carried(THERE).stay(3, right=SET).stay(12).succeeds(TASK)
    assert carried(LAID).stay(3, right=SET).stay(12).succeeds(INTO, tray=tray())


def test_letting_go_a_little_above_counts() -> None:
    low = (0.3, 0.0, HALF_M + 0.03)
    assert carried(low).go(THERE, 2, right=FREE).stay(12).succeeds(TASK)


CHEATS = {
    "pushed": Trace().stay(2).go(THERE, 60, right=POKE).stay(20),
    "picked up, then pushed": Trace().go((0, 0, 0.1), 10, right=HOLD).go((0, 0, HALF_M), 10, right=HOLD)
    .stay(2).go(THERE, 40, right=POKE).stay(20),
    "pinned against the table": carried(THERE).stay(20, right=POKE),
    "still in the hand": carried(THERE).stay(20, right=SET),
    "hovering in the hand": carried(THERE).stay(20, right=HOLD),
    "hovering": carried(THERE).stay(20, right=FREE),
    "dropped from above": carried((0.3, 0.0, 0.3)).go(THERE, 5, right=FREE).stay(20),
    "thrown": carried((0.1, 0.0, 0.1)).go((0.2, 0.0, 0.1), 2, right=FREE).go(THERE, 3, right=FREE).stay(20),
    "slid away": carried((0.15, 0.0, HALF_M)).go(THERE, 20).stay(20),
    "teleported": Trace().stay(2).go((0, 0, 0.1), 10, right=HOLD).go(THERE, 1).stay(20),
    "too short": carried(THERE).stay(8),
}  # fmt: skip


@pytest.mark.parametrize("name", CHEATS)
def test_what_is_not_a_placement_is_refused(name: str) -> None:
    assert naive(CHEATS[name], THERE)
    assert not CHEATS[name].succeeds(TASK)


def test_reasons_say_what_was_missing() -> None:
    assert CHEATS["pushed"].verdict(TASK)[1] == "the object was not picked up"
    assert CHEATS["dropped from above"].verdict(TASK)[1] == "the object was dropped"
    assert CHEATS["still in the hand"].verdict(TASK)[1] == "the object was not released"
    assert CHEATS["teleported"].verdict(TASK)[1] == "the object jumped"
    assert carried((0.1, 0.0, HALF_M)).stay(12).verdict(TASK)[1] == "the object is not at its target"
    assert carried((0.1, 0.0, HALF_M)).stay(12).verdict(INTO, tray=tray())[1] == "the object is not inside"


@pytest.mark.parametrize(
    ("end", "after"),
    [
        (LAID, {"right": HOLD}),
        (LAID, {"right": FREE}),
        ((0.3, 0.0, 0.05), {"right": AWAY}),
    ],
    ids=["hovering in the hand", "hovering", "on the rim"],
)
def test_what_is_not_inside_is_refused(end: tuple[float, float, float], after: dict[str, object]) -> None:
    trace = carried(end).stay(20, **after)
    assert naive(trace, LAID) or end[2] > LAID[2]
    assert not trace.succeeds(INTO, tray=tray())


def test_dropping_into_the_container_from_above_is_refused() -> None:
    trace = carried((0.3, 0.0, 0.3)).go(LAID, 5, right=FREE).stay(20)
    assert naive(trace, LAID)
    assert trace.verdict(INTO, tray=tray()) == (False, "the object was dropped")


def test_letting_go_at_the_rim_counts_however_deep_the_container_is() -> None:
    deep = tray(wall=0.16)
    at_rim = (0.3, 0.0, HALF_M + 0.16)
    assert carried(at_rim).go(LAID, 4, right=FREE).stay(12).succeeds(INTO, tray=deep)
    above = (0.3, 0.0, HALF_M + 0.22)
    assert not carried(above).go(LAID, 5, right=FREE).stay(12).succeeds(INTO, tray=deep)


def test_beside_the_wall_is_not_inside_though_the_hull_holds_it() -> None:
    beside = tuple((TRAY @ [0.075, 0.0, HALF_M, 1.0])[:3].tolist())
    assert not carried(beside).stay(20).succeeds(INTO, tray=tray())


def test_a_container_that_was_tipped_over_holds_nothing() -> None:
    trace = carried(LAID).stay(12)
    tipped = TRAY.copy()
    tipped[:3, :3] = tipped[:3, :3] @ about(0, 1.0)
    for state in trace.states[1:]:
        state.others["tray"] = tipped[None]  # type: ignore[index]
    assert not trace.succeeds(INTO, tray=tray())


def test_a_placement_by_the_wrong_hand_is_refused() -> None:
    task = TASK.model_copy(update={"limbs": ("left",)})
    hands = ("left", "right")
    wrong = carried(THERE, hands, right=HOLD).stay(12)
    assert naive(wrong, THERE)
    assert not wrong.succeeds(task)
    assert carried(THERE, hands, left=HOLD).stay(12).succeeds(task)


def test_the_room_of_a_bowl_is_that_below_its_rim() -> None:
    vertices, faces = _bowl(radius=0.08, height=0.06)
    found = cavities.find(vertices, faces)
    assert found is not None
    corner, cell, floor, rim = found
    room = float((rim - floor).sum()) * cell**2
    # A frustum of radii 75 and 45 mm over 55 mm, without the columns that its wall crosses.
    truth = np.pi * 0.055 / 3 * (0.075**2 + 0.075 * 0.045 + 0.045**2)
    assert 0.8 * truth < room < truth
    cavity = Cavity(corner_m=corner, cell_m=cell, floor_m=floor.astype(np.float32), rim_m=rim.astype(np.float32))
    low = factories.box_corners((-0.02, -0.02, 0.006), (0.02, 0.02, 0.04)).astype(np.float64)
    assert inside(cavity, low)
    assert not inside(cavity, low + np.array([0.0, 0.0, 0.03]))
    assert not inside(cavity, low + np.array([0.06, 0.0, 0.0]))
    assert not inside(cavity, low * np.nan)


def test_a_smaller_container_holds_less() -> None:
    room = tray().cavity
    assert room is not None
    points = factories.box_corners((-0.06, -0.06, 0.015), (0.04, 0.06, 0.05)).astype(np.float64)
    assert inside(room, points)
    assert inside(room.sized(1.1), points * 1.1)
    assert not inside(room.sized(0.7), points)
    small = tray().sized(0.5)
    assert small.cavity is not None
    assert small.cavity.cell_m == pytest.approx(room.cell_m / 2)
    assert np.allclose(small.points, tray().points / 2)
    assert tray().sized(1.0).points is not None


def test_a_box_and_a_plate_are_no_containers() -> None:
    corners = factories.box_corners((-0.05, -0.05, 0.0), (0.05, 0.05, 0.05)).astype(np.float64)
    faces = np.array([[0, 2, 1], [1, 2, 3], [4, 5, 6], [5, 7, 6], [0, 1, 4], [1, 5, 4], [2, 6, 3], [3, 6, 7]])
    assert cavities.find(corners, faces) is None


def test_a_hole_in_the_wall_lets_the_room_run_out() -> None:
    vertices, faces = _bowl(radius=0.08, height=0.06)
    whole, broken = (cavities.find(vertices, each) for each in (faces, _without_a_slab(vertices, faces)))
    assert whole is not None
    rest = 0.0 if broken is None else float((broken[3] - broken[2]).sum())
    assert rest < 0.2 * float((whole[3] - whole[2]).sum())


def test_a_start_inside_is_not_fair() -> None:
    primitive = of(INTO, {"box": box(), "tray": tray()})
    boxes = np.array([factories.pose(*LAID), factories.pose(0.0, 0.0, HALF_M)])
    assert primitive.fair({"box": boxes, "tray": np.array([TRAY, TRAY])}).tolist() == [False, True]
    assert primitive.others() == ("tray",)


def _bowl(radius: float, height: float) -> tuple[np.ndarray, np.ndarray]:
    asset = factories.bowl_asset(radius=radius, height=height)
    mesh = next(iter(asset.body.links.values())).mesh
    return mesh.vertices.astype(np.float64), mesh.faces


def _without_a_slab(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Without what stands on one side, above the floor."""
    middles = vertices[faces].mean(axis=1)
    side = (np.abs(np.arctan2(middles[:, 1], middles[:, 0])) < 0.5) & (np.linalg.norm(middles[:, :2], axis=1) > 0.045)
    return faces[~side]
