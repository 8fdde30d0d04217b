"""Unintended contacts of a robot, and penetration."""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np

from dextera_build.sim.model.compose import ROBOT
from dextera_build.sim.runtime.environment import Environment


class Deep(NamedTuple):
    """Two bodies that penetrate each other too deep."""

    one: str
    other: str
    free: bool
    """Whether the robot touches neither, or not the task's object, if it is one of them."""


class Touch:
    """Contacts between the robot and everything else, or between parts of the robot.

    Args:
        environment: The task.
    """

    def __init__(self, environment: Environment) -> None:
        self._environment = environment
        model = environment.model
        base = model.body(ROBOT + "base").id
        self._roots = roots = model.body_rootid[model.geom_bodyid]
        self._robot = roots == base
        # What moves by the task: the robot, and every object.
        self._movable = self._robot | np.isin(roots, [model.body(name).id for name in environment.bundle.objects])
        links = [ROBOT + name for name, group in environment.bundle.robot.links.items() if group == "hand"]
        self._hand = np.isin(model.geom_bodyid, [model.body(name).id for name in links])
        # A hand may touch the container that it reaches into.
        meant = (environment.task.object, *environment.primitive.others())
        self._target = np.isin(roots, [model.body(name).id for name in meant])
        self._object = int(model.body(environment.task.object).id)
        self._names = [self._name(geom) for geom in range(model.ngeom)]

    def unintended(self, contact: bool, press_n: float, *, fingers: bool = False) -> str:
        """Unintended contacts with more than `press_n` [N]; empty if there are none.

        Args:
            contact: Whether contact with the bodies named by the task is intended now.
            press_n: Tolerated force [N].
            fingers: Whether parts of hands may touch each other at any time.
        """
        data, model = self._environment.data, self._environment.model
        for number in range(data.ncon):
            one, other = data.contact.geom[number]
            if not (self._robot[one] or self._robot[other]) or data.contact.efc_address[number] < 0:
                continue
            thing = other if self._robot[one] else one
            if contact and self._target[thing]:
                continue
            # Fingers of a closing hand may touch each other.
            if contact and self._robot[one] and self._robot[other]:
                continue
            if fingers and self._hand[one] and self._hand[other]:
                continue
            force = np.zeros(6)
            mujoco.mj_contactForce(model, data, number, force)
            if np.linalg.norm(force[:3]) > press_n:
                return str(self._names[thing])
        return ""

    def deeper(self, contact: bool, depth_m: float, grip_m: float) -> list[Deep]:
        """Bodies that penetrate too deep, of which the robot or an object is one.

        Args:
            contact: Whether contact with the bodies named by the task is intended now.
            depth_m: Tolerated depth [m].
            grip_m: Tolerated depth of an intended contact [m].
        """
        found, deep = self._environment.data.contact, list[Deep]()
        for number in np.flatnonzero(found.dist < -min(depth_m, grip_m)):
            one, other = found.geom[number]
            robot = bool(self._robot[one] or self._robot[other])
            meant = contact and robot and (self._target[one] or self._target[other])
            if found.dist[number] < -(grip_m if meant else depth_m) and (self._movable[one] or self._movable[other]):
                pair = {int(self._roots[one]), int(self._roots[other])}
                # A finger may touch the container into which the task's object falls.
                falls = {self._object} if self._object in pair else pair
                free = not robot and not falls & self._touched()
                deep.append(Deep(str(self._names[one]), str(self._names[other]), free))
        return deep

    def _touched(self) -> set[int]:
        """Root bodies of what the robot touches."""
        pairs = self._environment.data.contact.geom
        return set(self._roots[pairs[self._robot[pairs].any(axis=1)]].ravel().tolist())

    def _name(self, geom: int) -> str:
        model = self._environment.model
        body = int(model.geom_bodyid[geom])
        if body == 0:
            return str(model.geom(geom).name or "the scene").removeprefix("static_")
        owner = body if self._robot[geom] else int(model.body_rootid[body])
        return str(model.body(owner).name)
