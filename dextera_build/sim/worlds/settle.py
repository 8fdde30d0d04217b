"""Simulate a scene from keyframe `home` and measure the motion of its bodies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from dextera_build.artifacts.base import Folder
from dextera_build.geometry import quaternions, transforms
from dextera_build.sim.model import model as models

SAMPLE_S = 0.01
"""Time between two energy samples [s]."""
SETTLED_S = 0.5
"""Time in which bodies fall by a fraction of 1 mm, after which the mechanical energy of a scene at rest is constant
[s]."""
LAST_S = 0.25
"""Final interval over which speeds are measured [s], long enough to ignore contact jitter of micrometres."""


@dataclass(frozen=True)
class Motion:
    """The motion of one body."""

    name: str
    drift_m: float  # distance of its origin from start to end
    fall_m: float  # drop of its origin
    tilt_rad: float  # angle between start and end
    joints: float  # maximum change of a joint position of its tree [rad or m]
    penetration_m: float  # maximum penetration at the start
    depth_m: float  # maximum penetration at the end
    speed_m_s: float  # maximum distance of the origin from its end in the last `LAST_S`, over that time
    turn_rad_s: float  # maximum angle to the end in the last `LAST_S`, over that time


@dataclass(frozen=True)
class Run:
    """Motion of the scene."""

    motions: tuple[Motion, ...]
    energy_j: np.ndarray  # (T,) kinetic energy, every `SAMPLE_S`
    energy_change: float  # largest change of the mechanical energy after `SETTLED_S`, over m g h of all bodies
    diverged: bool  # whether the solver diverged


def let_go(scene: Folder, bodies: tuple[str, ...], seconds: float) -> Run:
    """Simulate `seconds` from keyframe `home`.

    Args:
        scene: `scene.xml` and its files.
        bodies: Root bodies to observe; each has a free joint.
        seconds: Simulated time [s].

    Raises:
        RuleError: MuJoCo rejects the scene.
    """
    import mujoco

    model = models.compile_folder(scene)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    data = models.at_home(model)
    ids = [model.body(name).id for name in bodies]
    start = _poses(data, ids)
    joints = data.qpos.copy()
    depths = penetrations(model, data)
    weight_j = sum(_lift_j(model, data, body) for body in ids)
    energy, potential, poses = _run(model, data, ids, seconds)
    late = _late_speeds(poses[-1 - round(LAST_S / SAMPLE_S) :])
    diverged = not np.isfinite(data.qpos).all() or any(
        data.warning[int(kind)].number
        for kind in (
            mujoco.mjtWarning.mjWARN_BADQPOS,
            mujoco.mjtWarning.mjWARN_BADQVEL,
            mujoco.mjtWarning.mjWARN_BADQACC,
        )
    )
    end = start if diverged else _poses(data, ids)
    last = {} if diverged else penetrations(model, data)
    motions = []
    for row, (name, body) in enumerate(zip(bodies, ids, strict=True)):
        moved = end[row][:3, 3] - start[row][:3, 3]
        tilt = transforms.angle(end[row][:3, :3] @ start[row][:3, :3].T)
        turned = max((abs(float(data.qpos[a] - joints[a])) for a in _joint_addresses(model, body)), default=0.0)
        motions.append(
            Motion(
                name=name,
                drift_m=float(np.linalg.norm(moved)),
                fall_m=float(-moved[2]),
                tilt_rad=tilt,
                joints=turned,
                penetration_m=depths.get(body, 0.0),
                depth_m=last.get(body, 0.0),
                speed_m_s=float(late[row, 0]),
                turn_rad_s=float(late[row, 1]),
            )
        )
    total = (energy + potential)[min(round(SETTLED_S / SAMPLE_S), len(energy) - 1) :]
    change = float(np.abs(total - total[0]).max()) / weight_j if weight_j else 0.0
    return Run(tuple(motions), energy, change, diverged)


def penetrations(model: Any, data: Any) -> dict[int, float]:
    """Root body id -> maximum penetration of its tree in the state of `data` [m]."""
    found: dict[int, float] = {}
    for contact in data.contact[: data.ncon]:
        for geom in contact.geom:
            root = int(model.body_rootid[model.geom_bodyid[geom]])
            found[root] = max(found.get(root, 0.0), -float(contact.dist))
    return found


def _lift_j(model: Any, data: Any, root: int) -> float:
    """M g h of a tree of bodies: the energy to lift its centre of mass from its lowest collision point [J]."""
    own = np.flatnonzero((model.body_rootid[model.geom_bodyid] == root) & (model.geom_contype > 0))
    if not len(own):
        return 0.0
    turns = np.abs(data.geom_xmat[own].reshape(-1, 3, 3))
    places = data.geom_xpos[own, 2] + np.einsum(
        "gi,gi->g", data.geom_xmat[own].reshape(-1, 3, 3)[:, 2], model.geom_aabb[own, :3]
    )
    lowest = float((places - np.einsum("gi,gi->g", turns[:, 2], model.geom_aabb[own, 3:])).min())
    height = max(float(data.subtree_com[root, 2]) - lowest, 0.0)
    return float(model.body_subtreemass[root]) * float(np.linalg.norm(model.opt.gravity)) * height


def _run(model: Any, data: Any, ids: list[int], seconds: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Kinetic and potential energy (T,) [J], and poses (T, B, 4, 4), all every `SAMPLE_S`."""
    import mujoco

    every = max(1, round(SAMPLE_S / model.opt.timestep))
    samples = max(1, round(seconds / (every * model.opt.timestep)))
    energy, potential = np.zeros(samples), np.zeros(samples)
    poses = np.tile(np.eye(4), (samples, len(ids), 1, 1))
    for sample in range(samples):
        mujoco.mj_step(model, data, every)
        if not np.isfinite(data.qvel).all():
            break
        mujoco.mj_energyVel(model, data)
        mujoco.mj_energyPos(model, data)
        potential[sample], energy[sample] = data.energy
        poses[sample] = np.reshape(_poses(data, ids), (-1, 4, 4))
    mujoco.mj_forward(model, data)
    return energy, potential, poses


def _late_speeds(poses: np.ndarray) -> np.ndarray:
    """Speeds (B, 2) [m/s, rad/s] of poses (T, B, 4, 4) that span `LAST_S`."""
    end = poses[-1]
    far = np.linalg.norm(poses[..., :3, 3] - end[:, :3, 3], axis=-1).max(axis=0)
    turns = [
        max(transforms.angle(pose[row, :3, :3] @ end[row, :3, :3].T) for pose in poses) for row in range(poses.shape[1])
    ]
    return np.stack([far, np.array(turns)], axis=1) / LAST_S


def _poses(data: Any, ids: list[int]) -> list[np.ndarray]:
    return [transforms.rigid(quaternions.to_matrix(data.xquat[body]), data.xpos[body].copy()) for body in ids]


def _joint_addresses(model: Any, root: int) -> list[int]:
    return [
        int(model.jnt_qposadr[joint])
        for joint in range(model.njnt)
        if model.body_rootid[model.jnt_bodyid[joint]] == root and model.jnt_bodyid[joint] != root
    ]
