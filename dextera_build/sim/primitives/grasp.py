"""Grasp state of an object from a simulator's contacts.

On hardware, an estimate of the same form replaces it.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from dextera_build.sim.primitives.state import GraspState

PRESS_N = 0.05
"""Minimum force of a finger that counts as pressing [N]."""
OPPOSING = -0.3
"""Cosine between two forces on the object below which they oppose each other."""
NONE = GraspState()
"""Nothing is held."""
SUPPORT = -1
"""Entry of a finger map for geoms outside the hand."""


def finger_map(model: Any, tips: np.ndarray, palm: int) -> np.ndarray:
    """Geom -> finger number, the number of fingers for the palm, or `SUPPORT`; (ngeom,) int.

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


def estimate(model: Any, data: Any, body: int, fingers: np.ndarray, palm: int) -> GraspState:
    """Estimate the grasp state of the object with root `body`.

    Args:
        model: `mujoco.MjModel`.
        data: `mujoco.MjData` with contacts and forces of the current state.
        body: Root body of the object.
        fingers: `finger_map`.
        palm: Site of the palm, the reference for slip, or -1.
    """
    forces, supported = _forces(model, data, body, fingers)
    pressing = forces[np.linalg.norm(forces, axis=1) > PRESS_N]
    unit = pressing / np.maximum(np.linalg.norm(pressing, axis=1, keepdims=True), 1e-12)
    opposing = bool(len(unit) >= 2 and (unit @ unit.T).min() < OPPOSING)
    return GraspState(len(pressing), opposing, supported, _slip(model, data, body, palm))


def tip_forces(model: Any, data: Any, fingers: np.ndarray, count: int) -> np.ndarray:
    """Force on each finger from everything else, (F, 3) [N] in the world frame."""
    total = np.zeros((count, 3))
    for number in range(data.ncon):
        one, other = (int(fingers[geom]) for geom in data.contact.geom[number])
        if one == other or max(one, other) < 0:
            continue
        force = _on_second(model, data, number)
        if 0 <= other < count:
            total[other] += force
        if 0 <= one < count:
            total[one] -= force
    return total


def _forces(model: Any, data: Any, body: int, fingers: np.ndarray) -> tuple[np.ndarray, bool]:
    """Forces on the object by finger (F + 1, 3) [N], and whether anything else touches it."""
    forces = np.zeros((int(fingers.max(initial=0)) + 1, 3))
    supported = False
    roots = model.body_rootid[model.geom_bodyid]
    for number in range(data.ncon):
        one, other = data.contact.geom[number]
        inside = roots[one] == body, roots[other] == body
        if inside[0] == inside[1] or data.contact.efc_address[number] < 0:
            continue
        finger = int(fingers[other if inside[0] else one])
        force = _on_second(model, data, number) * (-1.0 if inside[0] else 1.0)
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
    ours, hand = np.zeros(6), np.zeros(6)
    mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, body, ours, 0)
    mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_SITE, palm, hand, 0)
    arm = data.xipos[body] - data.site_xpos[palm]
    return float(np.linalg.norm(ours[3:] - hand[3:] - np.cross(hand[:3], arm)))
