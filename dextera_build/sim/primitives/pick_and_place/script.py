"""Scripted operators of primitive `pick_and_place`: grasp, carry, set down, release; with one hand or several."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dextera_build.artifacts.tasks.task import Cavity
from dextera_build.geometry import lie, quaternions, transforms
from dextera_build.sim.control.operator import BASE, FREE, State
from dextera_build.sim.experts.candidates import Expert, Search, grasps, together
from dextera_build.sim.experts.grasp import Grasp
from dextera_build.sim.experts.motion import Leg, Plan, shifted
from dextera_build.sim.experts.reach import Reach
from dextera_build.sim.experts.rehearse import Candidate
from dextera_build.sim.experts.scripted import Taking
from dextera_build.sim.experts.squeeze import PRESS_M, Squeeze
from dextera_build.sim.primitives.pick_and_place.primitive import PlaceGoal
from dextera_build.sim.runtime.environment import Environment

OVER_M = 0.08
"""Height at which the object is carried above its start and its target [m]."""
SPARE_M = 0.006
"""Height above its support at which the object is released [m]."""
BELOW_M = 0.08
"""Maximum depth below the rim of a container to which an object is lowered; fingers stay above the rim [m]."""
FINGER_M = 0.015
"""Thickness of a fingertip below its centre, with a clearance [m]."""
BESIDE_M = 0.026
"""Distance of the centres of fingertips from other objects when an object is released among them [m]."""
HIGHER_M = (0.0, 0.006, 0.012, 0.018, 0.024, 0.030, 0.036, 0.042)
"""Heights by which a release is raised until the fingertips are clear of other objects [m]."""
WALL_M = 0.012
"""Sufficient distance from a container's walls when an object is released [m]."""
TURNS = np.radians([0, 15, -15, 30, -30, 45, -45, 60, -60, 75, -75, 90, -90])
"""Rotations about the vertical in which an object may be put into a container, preferred first."""
SECONDS = (0.8, 1.4, 0.9, 0.5, 0.6, 0.7)
"""Durations: lift, carry, lower, open, retreat, rest [s]."""


class Target:
    """Release pose of an object: at its goal, or over the cavity of its container.

    Args:
        environment: The task; only its data are used.
    """

    def __init__(self, environment: Environment) -> None:
        task, bundle = environment.task, environment.bundle
        self._goal: PlaceGoal = environment.primitive.goal
        self._base_from_world = bundle.base_pose.inverse().matrix
        self._up = self._base_from_world[:3, 2].copy()
        self._points = bundle.objects[task.object].points.astype(np.float64)
        self._cavity = bundle.objects[self._goal.into].cavity if self._goal.into else None

    @property
    def frame(self) -> str:
        """The frame in which the release is the same in every episode: the container, or the robot's base."""
        return self._goal.into or BASE

    def pose(self, state: State, base: np.ndarray) -> np.ndarray:
        """T_base_object (4, 4) at its goal or on the rim; with the orientation at `base` (4, 4) if that fits."""
        found = base.copy()
        if self._goal.quaternion is not None:
            found[:3, :3] = self._base_from_world[:3, :3] @ quaternions.to_matrix(np.array(self._goal.quaternion))
        if self._cavity is not None:
            return self._over(state.objects[self._goal.into], found)
        assert self._goal.place_m is not None
        found[:3, 3] = (self._base_from_world @ [*self._goal.place_m, 1.0])[:3] + self._up * SPARE_M
        return found

    def lowered(self, pose: np.ndarray, below_m: float) -> np.ndarray:
        """T_base_object (4, 4) at release: below the rim of a container, else at `pose` (4, 4).

        Args:
            pose: At its goal or on the rim.
            below_m: Maximum depth below the rim [m].
        """
        if self._cavity is None:
            return pose
        half = 0.5 * float((self._cavity.rim_m - self._cavity.floor_m).max())
        return shifted(pose, -self._up * min(below_m, half))

    def _over(self, container: np.ndarray, found: np.ndarray) -> np.ndarray:
        """The pose at the height of the rim, with the centre of the footprint over that of the cavity."""
        assert self._cavity is not None
        columns, rim = _columns(self._cavity)
        middle = transforms.apply(container, np.array([*columns.mean(axis=0), rim]))
        best, most = found, -np.inf
        for turn in TURNS:
            turned = found.copy()
            turned[:3, :3] = lie.rotation(self._up * turn) @ found[:3, :3]
            footprint = self._points @ turned[:3, :3].T
            centre = (footprint.min(axis=0) + footprint.max(axis=0)) / 2
            lowest = float((footprint @ self._up).min())
            turned[:3, 3] = middle - (centre - self._up * (centre @ self._up)) + self._up * (SPARE_M - lowest)
            inside = transforms.apply(transforms.invert(container) @ turned, self._points)[:, :2]
            room = min(WALL_M, -_outside(inside, columns, self._cavity.cell_m))
            if room > most + 1e-3:
                best, most = turned, room
        return best


class Place(Taking):
    """Grasps the task's object, and sets it down at its target or in a container.

    Args:
        environment: The task; only its data are used.
        reach: Kinematics of a limb.
        grasp: The grasp to execute.
    """

    def __init__(self, environment: Environment, reach: Reach, grasp: Grasp) -> None:
        super().__init__(environment, reach)
        things = environment.bundle.objects
        points = things[self._object].points
        self._others = {name: each.points.astype(float) for name, each in things.items() if name != self._object}
        tips = [[reach.fingers.tip(role, way) for role in reach.fingers.roles] for way in (grasp.closed, grasp.open)]
        # Fingertips, closed and open, in the palm's frame (2 F, 3).
        self._tips = np.concatenate(tips)
        free = float(transforms.apply(grasp.palm, np.array(tips[0]))[:, 2].min() - points[:, 2].min()) - FINGER_M
        self._below = float(np.clip(free, 0.0, BELOW_M))
        self._target = Target(environment)
        self.grasp = grasp

    def taking(self, state: State) -> Plan:
        """The grasp, and the lift above start and target."""
        grasp, base = self.grasp, state.objects[self._object]
        height = float((self._target.pose(state, base)[:3, 3] - base[:3, 3]) @ self._up)
        raised = shifted(base @ grasp.palm, self._up * (max(0.0, height) + OVER_M))
        legs = grasp.taking(self._object, base, self._up)
        return {self._reach.limb: [*legs, self._held(raised, grasp.closed, SECONDS[0], "lift")]}

    def going_on(self, state: State, base: np.ndarray, last: Mapping[str, Leg], held: Mapping[str, np.ndarray]) -> Plan:
        """The path to the target and the retreat."""
        grasp, limb, there = self.grasp, self._reach.limb, self._target.frame
        laid = self._target.lowered(self._target.pose(state, base), self._below) @ held[limb]
        laid = laid if there != BASE else self._among(state, laid)
        above = shifted(laid, self._up * float((last[limb].palm[:3, 3] - laid[:3, 3]) @ self._up))
        away = laid[:3, :3] @ grasp.palm[:3, :3].T @ grasp.away
        back = shifted(laid, away + self._up * 0.03)
        _, carry, lower, let, retreat, rest = SECONDS
        legs = [
            self._held(above, grasp.closed, carry, "carry", FREE),
            self._held(laid, grasp.closed, lower, "lower", there),
            self._held(laid, grasp.open, let, "release", there),
            self._held(back, grasp.open, retreat, "retreat", there),
            self._held(back, grasp.open, rest, "retreat", there),
        ]
        return {limb: legs}

    def _among(self, state: State, palm: np.ndarray) -> np.ndarray:
        """The palm (4, 4) at release, raised until its fingertips are clear of other objects, such as a bowl."""
        points = [transforms.apply(state.objects[name], each) for name, each in self._others.items()]
        found = palm
        for height in HIGHER_M:
            found = shifted(palm, self._up * height)
            tips = transforms.apply(found, self._tips)
            near = (np.linalg.norm(each[:, None] - tips, axis=2).min() for each in points)
            if min(near, default=np.inf) > BESIDE_M:
                break
        return found


class PlaceTogether(Taking):
    """Takes the task's object between two hands, and sets it down at its target or in a container.

    Args:
        environment: The task; only its data are used.
        reach: Kinematics of both limbs.
        squeeze: Contact poses of the hands.
    """

    def __init__(self, environment: Environment, reach: Reach, squeeze: Squeeze) -> None:
        super().__init__(environment, reach)
        self._target = Target(environment)
        self.squeeze = squeeze

    def taking(self, state: State) -> Plan:
        """The hands at both sides, and the lift above start and target."""
        base = state.objects[self._object]
        height = float((self._target.pose(state, base)[:3, 3] - base[:3, 3]) @ self._up)
        return self.squeeze.lifting(self._object, base, self._up, max(0.0, height) + OVER_M)

    def going_on(self, state: State, base: np.ndarray, last: Mapping[str, Leg], held: Mapping[str, np.ndarray]) -> Plan:
        """The path to the target, and the opening of the hands."""
        target, there = self._target.pose(state, base), self._target.frame
        _, carry, lower, let, retreat, rest = SECONDS
        plan = {}
        for limb, side in self.squeeze.sides.items():
            laid = target @ held[limb]
            above = shifted(laid, self._up * float((last[limb].palm[:3, 3] - laid[:3, 3]) @ self._up))
            away = target[:3, :3] @ side.away
            apart = shifted(laid, away / 2 + away / np.linalg.norm(away) * PRESS_M)
            back = shifted(apart, self._up * 2 * OVER_M)
            plan[limb] = [
                self._held(above, side.fingers, 1.5 * carry, "carry", FREE),
                self._held(laid, side.fingers, lower, "lower", there),
                self._held(apart, side.fingers, let, "release", there),
                self._held(back, side.fingers, 2 * retreat, "retreat", there),
                self._held(back, side.fingers, rest, "retreat", there),
            ]
        return plan


def _columns(cavity: Cavity) -> tuple[np.ndarray, float]:
    """Centres (C, 2) of the columns of a cavity, in its frame, and the height of its rim [m]."""
    deep = cavity.rim_m - cavity.floor_m
    # Columns over a foot or a slope cannot support an object.
    cells = np.argwhere(deep > 0.5 * deep.max())
    return cavity.corner_m + (cells + 0.5) * cavity.cell_m, float(cavity.rim_m[deep > 0].max())


def _outside(points: np.ndarray, columns: np.ndarray, cell_m: float) -> float:
    """Largest distance of points (P, 2) outside the border of columns (C, 2) [m]; negative if all are inside."""
    low, high = columns.min(axis=0) - cell_m / 2, columns.max(axis=0) + cell_m / 2
    middle, half = (low + high) / 2, (high - low) / 2
    filled = len(columns) * cell_m**2 / max(4.0 * float(half.prod()), 1e-9)
    if filled > 0.9:
        return float((np.abs(points - middle) - half).max())
    # A round cavity is an ellipse within the same box.
    return float(((np.linalg.norm((points - middle) / half, axis=1) - 1.0) * half.min()).max())


def _places(search: Search) -> list[Candidate]:
    """Grasps of the task's object to carry it to its target."""
    return grasps(search, lambda grasp: Place(search.environment, search.reach, grasp))


def _places_together(search: Search) -> list[Candidate]:
    """Two-handed grasps to carry the task's object."""
    return together(search, lambda way: PlaceTogether(search.environment, search.reach, way))


EXPERTS = (Expert("thumb", _places), Expert("nothing", _places_together, hands=2))
