"""Unintended contacts of a robot and of its task's object, penetration, and bystanders that are moved.

A *bystander* is a movable body that has no part in the task: neither the task's object, nor a body that the goal
names, nor what carries one of them.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

import mujoco
import numpy as np

from dextera_build.geometry import transforms
from dextera_build.sim.model.compose import ROBOT
from dextera_build.sim.model.links import ancestors
from dextera_build.sim.runtime.environment import Environment

SCENE, ARM, OBJECT, NAMED, CARRIER, BYSTANDER, HAND = range(7)
"""Kinds of geoms: of the scene that never moves, of a robot's arms and base, of the task's object, of bodies that the
goal names, of what carries these, and of other movable bodies; `HAND` + n: of the hand of limb n."""
BELOW = float(np.cos(np.radians(45.0)))
"""Least rise of the normal of a contact, of length 1, where a body rests on another one."""
LIFTED_M = 0.005
"""Height above the goal from which what carries the object there is looked for, downwards [m]."""


class Deep(NamedTuple):
    """Two bodies that penetrate each other too deep."""

    one: str
    other: str
    free: bool
    """Whether the robot touches neither, or not the task's object, if it is one of them."""
    meant: bool
    """Whether they are a hand and what it should touch."""


class Touch:
    """Contacts of the robot and of the task's object at one moment, and where bystanders are.

    Args:
        environment: The task.
    """

    def __init__(self, environment: Environment) -> None:
        self._environment = environment
        self._model, self._data = environment.model, environment.data
        model = self._model
        self._roots = model.body_rootid[model.geom_bodyid]
        self._robot = self._roots == model.body(ROBOT + "base").id
        named = np.isin(self._roots, [model.body(name).id for name in environment.primitive.others()])
        self._object = int(model.body(environment.task.object).id)
        # What is fixed to the world belongs to the scene.
        movable = model.body_weldid[model.geom_bodyid] != 0
        self._kinds = np.where(movable, BYSTANDER, SCENE)
        self._kinds[named] = NAMED
        self._kinds[self._roots == self._object] = OBJECT
        self._kinds[self._robot] = ARM
        self._limbs = environment.bundle.robot.limb_names
        for number, geoms in enumerate(hand_geoms(environment)):
            self._kinds[geoms] = HAND + number
        self._usual = self._kinds.copy()
        self._names = [self._name(geom) for geom in range(model.ngeom)]
        # What is one body in a contact; of the scene, every part with a name is one.
        owners = [(int(body), self._names[geom] if body == 0 else "") for geom, body in enumerate(model.geom_bodyid)]
        self._bodies = np.unique(owners, axis=0, return_inverse=True)[1].ravel()
        self._up = -model.opt.gravity / max(float(np.linalg.norm(model.opt.gravity)), 1e-9)
        self._places, self._turns = self._data.geom_xpos, self._data.geom_xmat
        self._intend((), False)
        self.begin()

    def begin(self) -> None:
        """A new episode begins: bodies that touch now may touch, and bystanders are where they should stay."""
        self._kinds[:] = self._usual
        pairs = np.sort(self._bodies[self._data.contact.geom], axis=1)
        self._touching = set(map(tuple, pairs.tolist()))
        self._carry(self._under_goal())
        while (below := self._below()).any():
            self._carry(below)
        self._bystanders = np.flatnonzero(self._kinds == BYSTANDER)
        self._met = np.zeros(len(self._bystanders), bool)
        self._from = self._places[self._bystanders], self._turns[self._bystanders].reshape(-1, 3, 3)

    def intend(self, limbs: Collection[str], *, fingers: bool = False) -> None:
        """Set which contacts are intended from now on.

        Args:
            limbs: Limbs whose hands should touch the task's object, bodies that the goal names, and each other.
            fingers: Whether parts of hands may touch each other in any case.
        """
        intended = tuple(number for number, limb in enumerate(self._limbs) if limb in limbs)
        if (intended, fingers) != self._intended:
            self._intend(intended, fingers)

    def unintended(self, press_n: float) -> str:
        """The first two bodies that press each other with more than `press_n` [N] in total without intention.

        In words, such as "touched `wall`" by the robot, or "`box` hit `wall`"; empty if there are none.
        """
        data = self._data
        if not data.ncon:
            return ""
        found = data.contact
        pairs = found.geom
        kinds = self._kinds[pairs]
        self._meet(pairs[(kinds == BYSTANDER) & (kinds[:, ::-1] != SCENE)])
        unmeant = self._unmeant[kinds[:, 0], kinds[:, 1]] & (found.efc_address >= 0)
        if (kinds == OBJECT).any():
            unmeant &= ~self._rests(kinds, found.frame)
        total: dict[tuple[int, ...], float] = {}
        force = np.zeros(6)
        for number in np.flatnonzero(unmeant).tolist():
            key = tuple(sorted(self._bodies[pairs[number]].tolist()))
            if key in self._touching and not self._robot[pairs[number]].any():
                continue
            mujoco.mj_contactForce(self._model, data, number, force)
            total[key] = total.get(key, 0.0) + float(np.linalg.norm(force[:3]))
            if total[key] > press_n:
                return self._said(*pairs[number])
        return ""

    def deeper(self, depth_m: float, grip_m: float) -> list[Deep]:
        """Bodies that penetrate too deep, of which at least one is movable.

        Args:
            depth_m: Tolerated depth [m].
            grip_m: Tolerated depth of an intended contact [m].
        """
        deep = list[Deep]()
        if not self._data.ncon:
            return deep
        found = self._data.contact
        for number in np.flatnonzero(found.dist < -min(depth_m, grip_m)):
            one, other = found.geom[number]
            meant = self._meant[self._kinds[one], self._kinds[other]]
            if found.dist[number] < -(grip_m if meant else depth_m):
                pair = {int(self._roots[one]), int(self._roots[other])}
                # A finger may touch the container into which the task's object falls.
                falls = {self._object} if self._object in pair else pair
                free = not (self._robot[one] or self._robot[other] or falls & self._touched())
                deep.append(Deep(self._names[one], self._names[other], free, bool(meant)))
        return deep

    def displaced(self, far_m: float) -> str:
        """A bystander that has moved by more than `far_m` [m], turns included; empty if none has.

        A turn counts as the way of the points that are farthest from the centre. What touches nothing but the scene may
        settle: it moves from the place that it has when something movable meets it.
        """
        places, turns = self._from
        alone = self._bystanders[~self._met]
        places[~self._met], turns[~self._met] = self._places[alone], self._turns[alone].reshape(-1, 3, 3)
        shift = np.linalg.norm(self._places[self._bystanders] - places, axis=1)
        now = self._turns[self._bystanders].reshape(-1, 3, 3)
        turned = transforms.angles(turns.swapaxes(1, 2) @ now)
        far = np.flatnonzero(shift + turned * self._model.geom_rbound[self._bystanders] > far_m)
        return self._names[self._bystanders[far[0]]] if len(far) else ""

    def _meet(self, geoms: np.ndarray) -> None:
        """Note that something movable touches these geoms of bystanders."""
        if len(geoms):
            self._met |= np.isin(self._roots[self._bystanders], self._roots[geoms])

    def _intend(self, intended: tuple[int, ...], fingers: bool) -> None:
        """Tables of pairs of kinds (K, K) bool: contacts that are meant, and others whose force matters."""
        self._intended = intended, fingers
        count = HAND + len(self._limbs)
        hands, every = [HAND + number for number in intended], list(range(HAND, count))
        self._meant, self._unmeant = np.zeros((2, count, count), bool)
        self._meant[np.ix_(hands, [OBJECT, NAMED])] = True
        self._meant |= self._meant.T
        self._unmeant[[ARM, *every]] = True
        self._unmeant[OBJECT, [SCENE, BYSTANDER]] = True
        self._unmeant |= self._unmeant.T
        touching = every if fingers else hands
        self._unmeant[np.ix_(touching, touching)] = False
        self._unmeant &= ~self._meant

    def _rests(self, kinds: np.ndarray, frames: np.ndarray) -> np.ndarray:
        """Contacts (N,) bool, of kinds (N, 2) and frames (N, 9), in which the task's object rests on the scene."""
        rise = frames[:, :3] @ self._up
        first, second = kinds.T
        on_first = (first == SCENE) & (second == OBJECT) & (rise > BELOW)
        return np.asarray(on_first | ((first == OBJECT) & (second == SCENE) & (rise < -BELOW)))

    def _below(self) -> np.ndarray:
        """Bystanders that carry the task's object, a body that the goal names, or what carries these, (ngeom,) bool."""
        found = self._data.contact
        # The normal points from the first geom to the second.
        rise = found.frame[:, :3] @ self._up
        carry = np.zeros(len(self._kinds), bool)
        for upper, lower, up in ((1, 0, rise), (0, 1, -rise)):
            carried = np.isin(self._kinds[found.geom[:, upper]], (OBJECT, NAMED, CARRIER)) & (up > BELOW)
            for geom in found.geom[carried, lower].tolist():
                carry |= self._bystander(geom)
        return carry

    def _under_goal(self) -> np.ndarray:
        """The bystander on which the task's object shall rest in the end, (ngeom,) bool."""
        goal = np.array(self._environment.primitive.target() or [np.nan], np.float64)
        if not np.isfinite(goal).all():
            return np.zeros(len(self._kinds), bool)
        # Above it in the air, the object rests on nothing.
        points = self._environment.bundle.objects[self._environment.task.object].points
        reach = float(np.linalg.norm(points, axis=1).max(initial=0.0)) + 2 * LIFTED_M
        geom, above = np.full(1, -1, np.int32), goal + LIFTED_M * self._up
        away = mujoco.mj_ray(self._model, self._data, above, -self._up, None, True, self._object, geom)
        return self._bystander(int(geom[0]) if away <= reach else -1)

    def _bystander(self, geom: int) -> np.ndarray:
        """Geoms of the bystander of which a geom is a part, (ngeom,) bool; none if it is of something else."""
        return np.asarray((self._kinds == BYSTANDER) & (self._roots == self._roots[geom]) & (geom >= 0))

    def _carry(self, geoms: np.ndarray) -> None:
        self._kinds[geoms] = CARRIER

    def _said(self, one: int, other: int) -> str:
        """The contact of two geoms in words."""
        if not (self._robot[one] or self._robot[other]):
            thing = other if self._kinds[one] == OBJECT else one
            return f"`{self._environment.task.object}` hit `{self._names[thing]}`"
        own, thing = (one, other) if self._robot[one] else (other, one)
        arm = self._kinds[own] == ARM and self._kinds[thing] in (OBJECT, NAMED)
        return f"touched `{self._names[thing]}`{' with an arm' if arm else ''}"

    def _touched(self) -> set[int]:
        """Root bodies of what the robot touches."""
        pairs = self._data.contact.geom
        return set(self._roots[pairs[self._robot[pairs].any(axis=1)]].ravel().tolist())

    def _name(self, geom: int) -> str:
        model = self._model
        body = int(model.geom_bodyid[geom])
        if body == 0:
            return str(model.geom(geom).name or "the scene").removeprefix("static_")
        owner = body if self._robot[geom] else int(model.body_rootid[body])
        return str(model.body(owner).name)


def hand_geoms(environment: Environment) -> list[np.ndarray]:
    """Geoms of the hand of every limb, in order, (ngeom,) bool each.

    They are those of links of group `hand` from the arm's last joint on, and of palm and fingers.
    """
    model, robot, hands = environment.model, environment.bundle.robot, environment.hands
    group = [
        body for body in range(model.nbody) if robot.links.get(model.body(body).name.removeprefix(ROBOT)) == "hand"
    ]
    found = []
    for number, name in enumerate(robot.limb_names):
        arm = robot.limbs[name].arm
        wrist = int(model.joint(ROBOT + arm[-1]).bodyid[0]) if arm else model.body(ROBOT + "base").id
        own = [body for body in group if wrist in ancestors(model, body)]
        fingers = np.isin(hands.fingers, range(*hands.of(number).indices(hands.count)))
        found.append(np.isin(model.geom_bodyid, own) | fingers)
    return found
