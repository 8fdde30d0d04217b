"""Primitive `pick_and_place`: an object is picked up and rests, released, at a target pose or inside a container."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np
from pydantic import model_validator

from dextera_build.artifacts.tasks.task import Cavity
from dextera_build.errors import did_you_mean, listing
from dextera_build.geometry import transforms
from dextera_build.sim.primitives import base, poses
from dextera_build.sim.primitives.base import Past, Setting, UnfitError, lengths
from dextera_build.sim.primitives.stages import DONE, HOLD, MOVE, REACH, clamp, holding, near
from dextera_build.sim.primitives.state import TaskState

DROP_M = 0.08
"""Distance from the release at which an object was dropped or thrown rather than placed [m]."""
OVER_M = 0.02
"""Height above a container's rim from which an object may still be released into it [m]."""
PUSHED_M = 0.02
"""Distance in contact with a hand that does not hold it at which an object was pushed [m]."""
TIPPED_RAD = 0.5
"""Lean of a container above which it was tipped over [rad]."""
SKIN_M = 0.004
"""Tolerance of points outside a cavity, for soft contacts and sampled shapes [m]."""
WAITS, CARRIED, LET_GO = 0, 1, 2
"""Stages: not picked up; held by hands alone; released."""


class PlaceGoal(poses.PoseGoal):
    """The object was picked up, and rests released at a target pose, or inside a container."""

    primitive: str = "pick_and_place"
    into: str = ""
    """Body of the container whose cavity must contain the whole object; empty: the target pose applies."""


class Options(poses.Options):
    """Options of a placement: a target pose, or a container."""

    into: str = ""
    """Label of the container; empty: the target pose applies."""

    @model_validator(mode="after")
    def _aimed(self) -> Options:
        placed = self.by_m is not None or self.to_m is not None
        if not self.into and not placed:
            raise ValueError("there is no target; set `into`, `by_m` or `to_m`")
        if self.into and (placed or self.turn_deg is not None):
            raise ValueError("`into` and a pose both give a target; leave one of them out")
        return self

    @property
    def containers(self) -> tuple[str, ...]:
        """The container."""
        return (self.into,) if self.into else ()

    def fitted(self, joints: Sequence[str]) -> Options:
        """A target pose instead of a container."""
        return self.model_copy(update={"into": "", "by_m": (0.1, 0.0, 0.0)}) if self.into else self

    def goal(self, setting: Setting) -> PlaceGoal:
        """The target pose, or the container's body."""
        if not self.into:
            place, quaternion = self.place(setting), self.quaternion(setting)
            return PlaceGoal(place_m=place, quaternion=quaternion, tolerance=self.tolerance())
        names = [name for name in setting.objects if name != setting.object]
        others = listing(names, most=20)
        if self.into not in setting.objects or self.into == setting.object:
            raise UnfitError(
                f"the scene has no container `{self.into}`",
                objects=others,
                hint=did_you_mean(self.into, names) or "set `into` to one of the other objects",
            )
        if setting.objects[self.into].cavity is None:
            raise UnfitError(
                f"`{self.into}` is no container: nothing stays in it",
                objects=others,
                hint="set `by_m` or `to_m` for a place on it, or `into` to another object",
            )
        return PlaceGoal(into=self.into, tolerance=self.tolerance())


class Primitive(base.Primitive[PlaceGoal]):
    """The object was carried by a hand alone, released near its final position, and is at its target.

    Pushing, throwing and dropping fail, as does an object that is still held or not at rest.
    """

    goal_type = PlaceGoal
    stages = ("touched", "grasped", "carried", "at its target", "released")

    def holds(self, start: TaskState, now: TaskState, past: Past) -> np.ndarray:
        """Whether the object rests at its target after it was carried, and no hand touches it."""
        rests = (past.stage == LET_GO) & ~now.touched() & now.supported
        return np.asarray(rests & self._there(start, now)) if rests.any() else rests

    def follow(self, past: Past, start: TaskState, now: TaskState) -> Past:
        """The stage; an object that fell, flew or was pushed after it was carried must be picked up again."""
        fault = base.faulted(past.fault, {"the object jumped": base.jumped(past.before, now)})
        held, touched = now.grasp(self.task.limbs), now.touched()
        carried = held.alone | ((past.stage == CARRIED) & held.valid)
        if not (carried | (past.stage != WAITS)).any():
            return Past(now, past.stage, fault, past.mark)
        near_release = lengths(now.place - past.mark) <= np.where(touched, PUSHED_M, self._fall_m)
        kept = np.where(touched & (past.stage == CARRIED), CARRIED, LET_GO)
        left = np.where((past.stage != WAITS) & near_release, kept, WAITS)
        mark = np.where(carried[:, None], now.place, past.mark)
        return Past(now, np.where(carried, CARRIED, left), fault, mark)

    def reached(self, start: TaskState, now: TaskState, past: Past) -> np.ndarray:
        """Touched by a hand, between opposing fingers, held by hands alone, then at its target, then released there."""
        carried = past.stage != WAITS
        there = carried & self._there(start, now) if carried.any() else carried
        grasped = now.grasp(self.task.limbs).held
        return base.furthest(now.touched(), grasped, carried, there, there & self.holds(start, now, past))

    @property
    def near_m(self) -> float:
        """The tolerance of the position."""
        return self.goal.tolerance.position_m

    def drawn(self, across_m: np.ndarray, turn_rad: float) -> PlaceGoal | None:
        """Another target pose."""
        return self.goal.moved(across_m, turn_rad)

    def missing(self, start: TaskState, now: TaskState, past: Past) -> np.ndarray:
        """The reason: the object was not carried, is not released, or is not at its target."""
        there = "the object is not inside" if self.goal.into else "the object is not at its target"
        released = np.where((past.stage == CARRIED) | now.touched(), "the object was not released", there)
        unheld = np.where(np.isnan(past.mark[:, 0]), "the object was not picked up", "the object was dropped")
        return np.where(past.stage == WAITS, unheld, released)

    def value(self, reach_m: np.ndarray, start: TaskState, now: TaskState, success: np.ndarray) -> np.ndarray:
        """Value of the stages: reach, hold, move to the target; an object released at its target has the full value."""
        grasp = now.grasp(self.task.limbs)
        moved = np.zeros(len(reach_m))
        if grasp.held.any():
            moved = np.where(grasp.held, clamp(1.0 - self._left(start, now), 0.0, 0.9), 0.0)
        going = REACH * near(reach_m) + HOLD * holding(grasp) + MOVE * moved
        rests = self._there(start, now) & now.supported
        return np.where(rests, REACH + HOLD + MOVE + DONE * success, going)

    def fair(self, places: Mapping[str, np.ndarray]) -> np.ndarray:
        """Whether the object is not at its target yet."""
        pose = places[self.task.object]
        if self.goal.into:
            return ~self._inside(pose, places[self.goal.into])
        return ~poses.reached(self.goal, pose)

    def target(self) -> tuple[float, float, float] | None:
        """The target position, or the container."""
        if not self.goal.into:
            return self.goal.place_m
        x, y, z = self.objects[self.goal.into].pose.matrix[:3, 3].tolist()
        return x, y, z

    def others(self) -> tuple[str, ...]:
        """The container."""
        return (self.goal.into,) if self.goal.into else ()

    @cached_property
    def _fall_m(self) -> float:
        """Allowed distance after the release: into a container from its rim, for any depth [m]."""
        cavity = self.objects[self.goal.into].cavity if self.goal.into else None
        return DROP_M if cavity is None else max(DROP_M, float((cavity.rim_m - cavity.floor_m).max()) + OVER_M)

    def _there(self, start: TaskState, now: TaskState) -> np.ndarray:
        if not self.goal.into:
            return poses.reached(self.goal, now.world_from_object)
        container = now.others[self.goal.into]
        inside = self._inside(now.world_from_object, container)
        if not inside.any():
            return inside
        return inside & (poses.turned(container, start.others[self.goal.into]) <= TIPPED_RAD)

    def _left(self, start: TaskState, now: TaskState) -> np.ndarray:
        if not self.goal.into:
            return poses.left(self.goal, start.world_from_object, now.world_from_object)
        before, after = (lengths(state.place - state.others[self.goal.into][:, :3, 3]) for state in (start, now))
        return np.asarray(np.fmin(2.0, after / np.maximum(before, 1e-6)))

    def _inside(self, pose: np.ndarray, container: np.ndarray) -> np.ndarray:
        """Whether the object with poses (N, 4, 4) is in the cavity of the container with others (N, 4, 4), (N,)."""
        found = lengths(pose[:, :3, 3] - container[:, :3, 3]) <= self._near_m
        for world in np.flatnonzero(found) if found.any() else ():
            found[world] = self._contained(transforms.invert(container[world]) @ pose[world])
        return found

    @cached_property
    def _near_m(self) -> float:
        """Distance between both origins beyond which the first point of the object is not in the cavity [m]."""
        cavity, first = self.objects[self.goal.into].cavity, self.objects[self.task.object].points[0]
        if cavity is None:
            return -1.0
        corner, size = np.array(cavity.corner_m), cavity.cell_m * np.array(cavity.rim_m.shape)
        across = np.maximum(np.abs(corner), np.abs(corner + size)) + 2 * cavity.cell_m
        up = float(max(np.abs(cavity.rim_m).max(), np.abs(cavity.floor_m).max())) + SKIN_M
        return float(np.linalg.norm([*across, up]) + np.linalg.norm(first))

    def _contained(self, container_from_object: np.ndarray) -> bool:
        """Whether the object with a pose (4, 4) in the container's frame is in the cavity."""
        cavity, points = self.objects[self.goal.into].cavity, self.objects[self.task.object].points
        assert cavity is not None
        # The object is usually elsewhere, and then one of its points suffices.
        if not _beside(cavity, transforms.apply(container_from_object, points[0].astype(np.float64))):
            return False
        return inside(cavity, transforms.apply(container_from_object, points.astype(np.float64)))


def _beside(cavity: Cavity, point: np.ndarray) -> bool:
    """Whether a point (3,) in the container's frame [m] has a grid column next to it; False on NaN."""
    x, y = ((point[:2] - cavity.corner_m) / cavity.cell_m).tolist()
    rows, columns = cavity.rim_m.shape
    return bool(-1 <= x < rows + 1 and -1 <= y < columns + 1)


def inside(cavity: Cavity, points: np.ndarray) -> bool:
    """Whether all points (P, 3) in the container's frame [m] are in its cavity; False on NaN.

    A point next to a wall is also tested with the nearest columns, because walls are as thick as their columns.
    """
    rooms = cavity.rim_m - cavity.floor_m > 0
    cells = np.floor((points[:, :2] - cavity.corner_m) / cavity.cell_m)
    if not np.isfinite(points).all():
        return False
    found = np.zeros(len(points), bool)
    for across in (-1, 0, 1):
        for along in (-1, 0, 1):
            row, column = (cells + np.array([across, along])).astype(int).T
            there = (row >= 0) & (row < rooms.shape[0]) & (column >= 0) & (column < rooms.shape[1])
            row, column = np.where(there, row, 0), np.where(there, column, 0)
            above = points[:, 2] >= cavity.floor_m[row, column] - SKIN_M
            below = points[:, 2] <= cavity.rim_m[row, column] + SKIN_M
            found |= there & rooms[row, column] & above & below
    return bool(found.all())
