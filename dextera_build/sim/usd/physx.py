"""Attributes of PhysX, which Isaac Lab reads, on prims.

`usd-core` has no schemas for them, so they are written as plain attributes with the names of `PhysxSchema` in Isaac Sim
5. Other simulators ignore them.
"""

from __future__ import annotations

from typing import Any

import numpy as np


def unit(turns: bool) -> float:
    """Factor from a joint's position to USD, whose angles are in degrees; stiffness is divided by it."""
    return float(np.degrees(1.0)) if turns else 1.0


def add_articulation(prim: Any) -> None:
    """Make a prim the root of an articulation with contacts between its links except for filtered pairs."""
    from pxr import UsdPhysics

    UsdPhysics.ArticulationRootAPI.Apply(prim)
    _set(prim, "PhysxArticulationAPI", "physxArticulation:enabledSelfCollisions", True)


def float_in_place(prim: Any) -> None:
    """Disable gravity for a rigid body."""
    _set(prim, "PhysxRigidBodyAPI", "physxRigidBody:disableGravity", True)


def set_material(prim: Any, spring: tuple[float, float] | None = None) -> None:
    """Combine friction and restitution of two materials by their maximum, as MuJoCo does.

    Args:
        prim: The material.
        spring: Stiffness [N/m] and damping [N s/m] of a soft surface; None: rigid.
    """
    for each in ("friction", "restitution"):
        _set(prim, "PhysxMaterialAPI", f"physxMaterial:{each}CombineMode", "max")
    for name, value in zip(("Stiffness", "Damping"), spring or (), strict=False):
        _set(prim, "PhysxMaterialAPI", f"physxMaterial:compliantContact{name}", value)


def set_joint(prim: Any, turns: bool, friction: float, armature: float, fastest: float | None = None) -> None:
    """Dry friction [N m or N], motor inertia [kg m^2 or kg] and maximum speed [rad/s or m/s] of a joint."""
    axis = "angular" if turns else "linear"
    _set(prim, "PhysxJointAPI", "physxJoint:armature", armature)
    if fastest is not None:
        _set(prim, "PhysxJointAPI", "physxJoint:maxJointVelocity", fastest * unit(turns))
    for each in ("static", "dynamic"):
        _set(prim, f"PhysxJointAxisAPI:{axis}", f"physxJointAxis:{axis}:{each}FrictionEffort", friction)


def set_position(prim: Any, turns: bool, position: float) -> None:
    """Initial position of a joint [rad or m]."""
    axis = "angular" if turns else "linear"
    _set(prim, f"PhysicsJointStateAPI:{axis}", f"state:{axis}:physics:position", position * unit(turns))


def follow(prim: Any, turns: bool, leader: Any, ratio: float, offset: float) -> None:
    """Couple a joint to another: its position is `ratio` x leader + `offset` [rad or m].

    PhysX keeps position + gearing x leader + offset at 0.
    """
    from pxr import Sdf

    axis = "rotX" if turns else "transX"
    schema, name = f"PhysxMimicJointAPI:{axis}", f"physxMimicJoint:{axis}"
    _set(prim, schema, f"{name}:gearing", -ratio)
    _set(prim, schema, f"{name}:offset", -offset * unit(turns))
    relation = prim.CreateRelationship(f"{name}:referenceJoint", custom=False)
    relation.SetTargets([Sdf.Path(str(leader))])


def value(prim: Any, name: str, default: float = 0.0) -> float:
    """An attribute's number, or `default`."""
    attribute = prim.GetAttribute(name)
    return float(attribute.Get()) if attribute and attribute.HasAuthoredValue() else default


def _set(prim: Any, schema: str, name: str, value: bool | float | str) -> None:
    from pxr import Sdf

    prim.AddAppliedSchema(schema)
    kinds = {bool: Sdf.ValueTypeNames.Bool, str: Sdf.ValueTypeNames.Token}
    kind = kinds.get(type(value), Sdf.ValueTypeNames.Float)
    plain = float(value) if isinstance(value, np.floating | int) and not isinstance(value, bool) else value
    prim.CreateAttribute(name, kind, custom=False).Set(plain)
