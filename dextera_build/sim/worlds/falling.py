"""Simulation of objects that fall onto a table until they rest."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np

from dextera_build.artifacts.scenes.world import Thing
from dextera_build.geometry import convex, quaternions, transforms
from dextera_build.geometry.solids import Solid

STEP_S = 0.002
"""Time step [s]."""
STILL_M_S = 2e-3
"""Speed below which an object is at rest [m/s]."""
CHECK_S = 0.2
"""Interval between checks whether all objects rest [s]."""


def let_fall(things: Mapping[str, Thing], low: np.ndarray, high: np.ndarray, seconds: float) -> dict[str, np.ndarray]:
    """Simulate objects from their poses until all rest.

    Args:
        things: Objects with convex pieces and mechanical properties, by name, initially above the table.
        low: Lower corner (2,) of the table's top [m], at z = 0.
        high: Its upper corner (2,) [m].
        seconds: Maximum simulated time [s].

    Returns:
        T_reference_thing (4, 4) of the objects at rest on the table; others fell off or did not come to rest.
    """
    model = _model(things, low, high)
    data = mujoco.MjData(model)
    still = np.zeros(len(things), bool)
    for _ in range(max(1, round(seconds / CHECK_S))):
        mujoco.mj_step(model, data, round(CHECK_S / STEP_S))
        still = np.linalg.norm(data.qvel.reshape(-1, 6)[:, :3], axis=1) < STILL_M_S
        if still.all():
            break
    poses = {}
    for number, name in enumerate(things):
        body = data.body(name)
        inside = (body.xipos[:2] > low).all() and (body.xipos[:2] < high).all() and body.xipos[2] > 0.0
        if inside and still[number]:
            poses[name] = transforms.rigid(body.xmat.reshape(3, 3).copy(), body.xpos.copy())
    return poses


def _model(things: Mapping[str, Thing], low: np.ndarray, high: np.ndarray) -> Any:
    spec = mujoco.MjSpec()
    spec.option.timestep = STEP_S
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 10.0
    spec.option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    middle, half = (low + high) / 2, (high - low) / 2
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX, pos=[*middle, -0.5], size=[*half, 0.5], condim=6, friction=[0.6, 0.01, 0.002]
    )
    for name, thing in things.items():
        _add(spec, name, thing)
    return spec.compile()


def _add(spec: Any, name: str, thing: Thing) -> None:
    pose = thing.pose.matrix
    body = spec.worldbody.add_body(name=name, pos=pose[:3, 3], quat=quaternions.from_matrix(pose[:3, :3]))
    body.add_freejoint()
    hulls = [convex.surface(piece.vertices) for part in thing.parts.values() for piece in part.pieces]
    volumes = np.array([Solid(vertices.astype(np.float64), faces).volume for vertices, faces in hulls])
    mass = thing.matter.mass_kg if thing.matter is not None else 0.2
    for number, (vertices, faces) in enumerate(hulls):
        label = f"{name}_{number}"
        mesh = spec.add_mesh(name=label)
        mesh.uservert, mesh.userface = vertices.flatten(), faces.flatten()
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=label,
            mass=mass * volumes[number] / volumes.sum(),
            condim=6,
            # Rolling friction stops round objects, as real imperfections do.
            friction=[0.6, 0.01, 0.002],
            solref=[0.005, 1.2],
        )
