"""Grasp states of an object from a simulator's contacts, one per hand.

On hardware, they are replaced by estimates of the same form.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.sim.primitives.state import GraspState, opposed

PRESS_N = 0.05
"""Minimum force of a finger that counts as pressing [N]."""
SUPPORT = -1
"""Entry of a finger map for geoms outside every hand."""


class Hands:
    """The hands of a robot in a model: the geoms of each finger, and the sites of the palms.

    Args:
        model: `mujoco.MjModel`.
        robot: The embodiment.
        prefix: Prefix of the robot's names in the model.
    """

    def __init__(self, model: Any, robot: RobotModel, prefix: str = "") -> None:
        def site(role: str) -> int:
            return int(model.site(prefix + robot.frames[role]).id)

        self.names = robot.limb_names
        """Limbs, in order."""
        limbs = [robot.limbs[name] for name in self.names]
        self.palms = [site(limb.palm) if limb.palm else -1 for limb in limbs]
        """Sites of the palms, or -1."""
        self.tips = [site(role) for limb in limbs for role in limb.tips]
        """Sites of the fingertips of all hands, in order."""
        self._first = [0, *np.cumsum([len(limb.tips) + 1 for limb in limbs]).tolist()]
        self.fingers = np.full(model.ngeom, SUPPORT)
        """Geom -> number of its finger or palm among all hands, or `SUPPORT`, (ngeom,) int."""
        for number, limb in enumerate(limbs):
            own = finger_map(model, np.array([site(role) for role in limb.tips], int), self.palms[number])
            if not limb.hand and limb.palm:
                own[_rigid(model, robot, prefix, self.palms[number])] = len(limb.tips)
            self.fingers[own != SUPPORT] = own[own != SUPPORT] + self._first[number]

        self._inside: dict[int, np.ndarray] = {}
        counts = {name: len(limb.tips) + 1 for name, limb in zip(self.names, limbs, strict=True)}
        self._none = {
            supported: {name: GraspState.none(np.array([supported]), count) for name, count in counts.items()}
            for supported in (False, True)
        }

    def of(self, limb: int) -> slice:
        """Numbers of the fingers of a limb, its palm last."""
        return slice(self._first[limb], self._first[limb + 1])

    @property
    def count(self) -> int:
        """Number of fingers and palms."""
        return int(self._first[-1])

    def grasps(self, model: Any, data: Any, body: int) -> dict[str, GraspState]:
        """Limb -> grasp state (N = 1) of the object with root `body`.

        Args:
            model: `mujoco.MjModel`.
            data: `mujoco.MjData` with contacts and forces of the current state.
            body: Root body of the object.
        """
        if body not in self._inside:
            self._inside[body] = _inside(model, body)
        forces, supported = _forces(model, data, self._inside[body], self.fingers, self.count)
        # Sleeping bodies have no contacts; only supported bodies fall asleep.
        supported |= not data.tree_awake[model.body_treeid[body]]
        if not forces.any():
            return self._none[bool(supported)]
        return {
            name: _state(model, data, body, forces[self.of(number)], supported, self.palms[number])
            for number, name in enumerate(self.names)
        }

    def tip_forces(self, model: Any, data: Any) -> np.ndarray:
        """Force on each finger from everything else, (F, 3) [N] in the world frame; without the palms."""
        total = np.zeros((self.count, 3))
        for number in range(data.ncon):
            one, other = (int(self.fingers[geom]) for geom in data.contact.geom[number])
            if one == other or max(one, other) < 0:
                continue
            force = _on_second(model, data, number)
            if other >= 0:
                total[other] += force
            if one >= 0:
                total[one] -= force
        return np.delete(total, np.array(self._first[1:]) - 1, axis=0)


def finger_map(model: Any, tips: np.ndarray, palm: int) -> np.ndarray:
    """Geom -> finger number of one hand, the number of fingers for the palm, or `SUPPORT`; (ngeom,) int.

    Args:
        model: `mujoco.MjModel`.
        tips: Sites of the fingertips (F,), one per finger.
        palm: Site of the palm, or -1.
    """
    owner = np.full(model.nbody, SUPPORT)
    last = int(model.site_bodyid[palm]) if palm >= 0 else 0
    for finger, site in enumerate(tips):
        body = int(model.site_bodyid[site])
        while body not in (0, last):
            owner[body] = finger
            body = int(model.body_parentid[body])
    if palm >= 0:
        owner[last] = len(tips)
    return np.asarray(owner[model.geom_bodyid])


def _rigid(model: Any, robot: RobotModel, prefix: str, palm: int) -> np.ndarray:
    """Geoms (ngeom,) bool of the links of a tool, which have no joint between them and the palm."""
    welded = model.body_weldid == model.body_weldid[model.site_bodyid[palm]]
    names = [model.body(body).name.removeprefix(prefix) for body in range(model.nbody)]
    tool = welded & np.array([robot.links.get(name) == "hand" for name in names])
    return np.asarray(tool[model.geom_bodyid])


def estimate(model: Any, data: Any, body: int, fingers: np.ndarray, palm: int) -> GraspState:
    """Grasp state (N = 1) of the object with root `body` in a single hand.

    Args:
        model: `mujoco.MjModel`.
        data: `mujoco.MjData` with contacts and forces of the current state.
        body: Root body of the object.
        fingers: `finger_map`.
        palm: Site of the palm, the reference for slip, or -1.
    """
    forces, supported = _forces(model, data, _inside(model, body), fingers, int(fingers.max(initial=0)) + 1)
    return _state(model, data, body, forces, supported, palm)


def _state(model: Any, data: Any, body: int, forces: np.ndarray, supported: bool, palm: int) -> GraspState:
    norms = np.linalg.norm(forces, axis=1)
    presses = norms > PRESS_N
    if not presses.any():
        return GraspState.none(np.array([supported]), len(forces))
    # A row of zeros for a finger that does not press.
    unit = (forces / np.maximum(norms, 1e-12)[:, None] * presses[:, None])[None]
    slip = _slip(model, data, body, palm)
    return GraspState(np.array([presses.sum()]), opposed(unit), np.array([supported]), np.array([slip]), unit)


def _inside(model: Any, body: int) -> np.ndarray:
    """Geoms of the object with root `body`, (ngeom,) bool."""
    return np.asarray(model.body_rootid[model.geom_bodyid] == body)


def _forces(model: Any, data: Any, inside: np.ndarray, fingers: np.ndarray, count: int) -> tuple[np.ndarray, bool]:
    """Forces on the object by finger (`count`, 3) [N], and whether anything but a hand touches it."""
    forces = np.zeros((count, 3))
    supported = False
    if data.ncon == 0:
        return forces, supported
    contact = data.contact
    pairs = contact.geom
    ours = inside[pairs]
    for number in np.flatnonzero((ours[:, 0] != ours[:, 1]) & (contact.efc_address >= 0)).tolist():
        first = bool(ours[number, 0])
        finger = int(fingers[pairs[number, int(first)]])
        force = _on_second(model, data, number) * (-1.0 if first else 1.0)
        if finger == SUPPORT:
            supported |= bool(np.linalg.norm(force) > PRESS_N)
        else:
            forces[finger] += force
    return forces, supported


def _on_second(model: Any, data: Any, number: int) -> np.ndarray:
    """Force of a contact on the second of its geoms, (3,) [N] in the world frame."""
    local = np.zeros(6)
    mujoco.mj_contactForce(model, data, number, local)
    # Rows of the contact frame are axes; the normal, row 0, points from the first geom to the second.
    return np.asarray(data.contact.frame[number].reshape(3, 3).T @ local[:3])


def _slip(model: Any, data: Any, body: int, palm: int) -> float:
    """Speed of the object's centre of mass relative to a rigid attachment to the palm [m/s]."""
    if palm < 0:
        return 0.0
    # Angular [rad/s], then linear [m/s], along the world's axes.
    motion, hand = np.zeros(6), np.zeros(6)
    mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, body, motion, 0)
    mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_SITE, palm, hand, 0)
    x, y, z = (data.xipos[body] - data.site_xpos[palm]).tolist()
    wx, wy, wz = hand[:3].tolist()
    # Written out, because `np.cross` takes longer than all the rest.
    carried = np.array([wy * z - wz * y, wz * x - wx * z, wx * y - wy * x])
    return float(np.linalg.norm(motion[3:] - hand[3:] - carried))
