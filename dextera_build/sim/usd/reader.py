"""Read the inventory of a stage written by `sim.usd.writer`, from its prims alone, for comparison with MuJoCo's model.

It follows the semantics of UsdPhysics and PhysX: degrees, joint frames, the maximum of two frictions. Bodies and joints
are named by their display names.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dextera_build.geometry import quaternions, transforms
from dextera_build.sim.model import mjcf_contact
from dextera_build.sim.model.inventory import CORNERS, WORLD, BodyEntry, Collider, Inventory, JointEntry
from dextera_build.sim.usd import physx

X = np.array([1.0, 0.0, 0.0])


def inventory(stage: Any) -> Inventory:
    """All rigid bodies, colliders, joints and filtered pairs of an open stage, in the world frame [m, kg, rad]."""
    return _Reader(stage).read()


class _Reader:
    def __init__(self, stage: Any) -> None:
        from pxr import UsdPhysics

        self.stage = stage
        self.prims = list(stage.Traverse())
        bodies = [prim for prim in self.prims if prim.HasAPI(UsdPhysics.RigidBodyAPI)]
        self.names = {prim.GetPath(): prim.GetDisplayName() for prim in bodies}
        self.colliders: dict[str, list[Any]] = {name: [] for name in (WORLD, *self.names.values())}
        for prim in self.prims:
            if prim.HasAPI(UsdPhysics.CollisionAPI):
                self.colliders[self._body_of(prim.GetPath())].append(prim)

    def read(self) -> Inventory:
        """Everything."""
        from pxr import UsdPhysics

        found = Inventory()
        found.bodies[WORLD] = BodyEntry(0.0, np.zeros(3), np.zeros((3, 3)), False, self._touching(WORLD))
        for path, name in self.names.items():
            found.bodies[name] = self._body(self.stage.GetPrimAtPath(path), name)
        for prim in self.prims:
            if prim.IsA(UsdPhysics.Joint):
                name, joint, collides = self._joint(prim)
                found.joints[name] = joint
                if not collides and joint.parent != WORLD:
                    found.apart.add(_sorted(joint.parent, joint.child))
        self._filters(found)
        return found

    def _body_of(self, path: Any) -> str:
        """The rigid body at or above a path."""
        while not path.isEmpty and path not in self.names:
            path = path.GetParentPath()
        return str(self.names.get(path, WORLD))

    def _body(self, prim: Any, name: str) -> BodyEntry:
        from pxr import UsdPhysics

        api, pose = UsdPhysics.MassAPI(prim), world(prim)
        centre = np.array(api.GetCenterOfMassAttr().Get(), np.float64)
        turn = pose[:3, :3] @ _turn(api.GetPrincipalAxesAttr().Get())
        moments = np.array(api.GetDiagonalInertiaAttr().Get(), np.float64)
        floating = prim.GetAttribute("physxRigidBody:disableGravity")
        return BodyEntry(
            float(api.GetMassAttr().Get()),
            transforms.apply(pose, centre[None])[0],
            turn @ np.diag(moments) @ turn.T,
            bool(floating and floating.Get()),
            self._touching(name),
        )

    def _touching(self, name: str) -> tuple[Collider, ...]:
        return tuple(_collider(prim) for prim in self.colliders[name])

    def _joint(self, prim: Any) -> tuple[str, JointEntry, bool]:
        from pxr import UsdPhysics

        base = UsdPhysics.Joint(prim)
        ends = [[*relation.GetTargets(), None][0] for relation in (base.GetBody0Rel(), base.GetBody1Rel())]
        parent, child = (WORLD if end is None else self._body_of(end) for end in ends)
        above = np.eye(4) if ends[0] is None else world(self.stage.GetPrimAtPath(ends[0]))
        frame = above @ _local(prim, 0)
        collides = bool(base.GetCollisionEnabledAttr().Get())
        moving = world(self.stage.GetPrimAtPath(ends[1])) @ _local(prim, 1)
        if prim.IsA(UsdPhysics.FixedJoint):
            # The child's pose follows from the coincidence of both frames.
            origin = frame @ transforms.invert(_local(prim, 1))
            return f"fixed {child}", JointEntry("fixed", parent, child, origin[:3, 3], np.zeros(3)), collides
        turns = prim.IsA(UsdPhysics.RevoluteJoint)
        typed = UsdPhysics.RevoluteJoint(prim) if turns else UsdPhysics.PrismaticJoint(prim)
        axis = {"X": X, "Y": np.roll(X, 1), "Z": np.roll(X, 2)}[typed.GetAxisAttr().Get()]
        position, gap = _moved(transforms.invert(frame) @ moving, axis, turns)
        limits = [each.Get() for each in (typed.GetLowerLimitAttr(), typed.GetUpperLimitAttr())]
        low, high = (float(each) / physx.unit(turns) for each in limits)
        drive = UsdPhysics.DriveAPI.Get(prim, "angular" if turns else "linear")
        joint = JointEntry(
            "revolute" if turns else "prismatic",
            parent,
            child,
            # As in MuJoCo, the anchor of a slide does not move with it.
            (moving if turns else frame)[:3, 3],
            frame[:3, :3] @ axis,
            (low, high),
            position,
            friction=physx.value(prim, f"physxJointAxis:{'angular' if turns else 'linear'}:staticFrictionEffort"),
            armature=physx.value(prim, "physxJoint:armature"),
            stiffness=float(drive.GetStiffnessAttr().Get()) * physx.unit(turns),
            damping=float(drive.GetDampingAttr().Get()) * physx.unit(turns),
            effort=float(drive.GetMaxForceAttr().Get()),
            target=float(drive.GetTargetPositionAttr().Get()) / physx.unit(turns),
            follows=self._follows(prim, turns),
            gap=gap,
        )
        return prim.GetDisplayName(), joint, collides

    @staticmethod
    def _follows(prim: Any, turns: bool) -> tuple[str, float, float]:
        name = f"physxMimicJoint:{'rotX' if turns else 'transX'}"
        relation = prim.GetRelationship(f"{name}:referenceJoint")
        if not relation:
            return "", 0.0, 0.0
        leader = prim.GetStage().GetPrimAtPath(relation.GetTargets()[0]).GetDisplayName()
        offset = -physx.value(prim, f"{name}:offset") / physx.unit(turns)
        return leader, -physx.value(prim, f"{name}:gearing"), offset

    def _filters(self, found: Inventory) -> None:
        from pxr import UsdPhysics

        numbers = {prim.GetPath(): (name, n) for name, own in self.colliders.items() for n, prim in enumerate(own)}
        single: dict[tuple[str, str], set[Any]] = {}
        for prim in self.prims:
            for target in UsdPhysics.FilteredPairsAPI(prim).GetFilteredPairsRel().GetTargets():
                bodies = _sorted(self._body_of(prim.GetPath()), self._body_of(target))
                found.apart.add(bodies)
                if prim.GetPath() in numbers:
                    pair = sorted((numbers[prim.GetPath()], numbers[target]))
                    single.setdefault(bodies, set()).add(tuple(pair))
        for (one, other), apart in single.items():
            ours, theirs = (range(len(self.colliders[name])) for name in (one, other))
            found.touch |= {((one, i), (other, j)) for i in ours for j in theirs} - apart


def world(prim: Any) -> np.ndarray:
    """T_world_prim (4, 4), with the scale of a prim that has one."""
    from pxr import Usd, UsdGeom

    # USD multiplies row vectors.
    return np.array(UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(Usd.TimeCode.Default())).T


def _moved(motion: np.ndarray, axis: np.ndarray, turns: bool) -> tuple[float, float]:
    """Position of a joint from the relative pose (4, 4) of its two frames, and the residual [rad or m]."""
    turn, shift = motion[:3, :3], motion[:3, 3]
    if not turns:
        position = float(axis @ shift)
        return position, float(np.linalg.norm(shift - position * axis)) + transforms.angle(turn)
    sine = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) @ axis
    position = float(np.arctan2(sine, np.trace(turn) - 1.0))
    return position, float(np.linalg.norm(shift) + np.linalg.norm(turn @ axis - axis))


def _collider(prim: Any) -> Collider:
    from pxr import UsdGeom, UsdPhysics, UsdShade

    pose = world(prim)
    material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial("physics")
    contact = UsdPhysics.MaterialAPI(material.GetPrim())
    friction, bounce = (float(each.Get()) for each in (contact.GetDynamicFrictionAttr(), contact.GetRestitutionAttr()))
    if friction:
        bounce = max(bounce, mjcf_contact.LEAST_BOUNCE)
    radius, kind = 0.0, "hull"
    if prim.IsA(UsdGeom.Cube):
        points = CORNERS * float(UsdGeom.Cube(prim).GetSizeAttr().Get()) / 2
    elif prim.IsA(UsdGeom.Mesh):
        points = np.array(UsdGeom.Mesh(prim).GetPointsAttr().Get(), np.float64)
    elif prim.IsA(UsdGeom.Sphere):
        kind, points, radius = "sphere", np.zeros((1, 3)), float(UsdGeom.Sphere(prim).GetRadiusAttr().Get())
    else:
        kind = "capsule" if prim.IsA(UsdGeom.Capsule) else "cylinder"
        shape = UsdGeom.Capsule(prim) if kind == "capsule" else UsdGeom.Cylinder(prim)
        half, radius = float(shape.GetHeightAttr().Get()) / 2, float(shape.GetRadiusAttr().Get())
        points = np.array([[0.0, 0.0, -half], [0.0, 0.0, half]])
    return Collider(kind, points @ pose[:3, :3].T + pose[:3, 3], radius, friction, bounce)


def _local(prim: Any, side: int) -> np.ndarray:
    """Frame of a joint in one of its bodies, (4, 4)."""
    place = np.array(prim.GetAttribute(f"physics:localPos{side}").Get(), np.float64)
    return transforms.rigid(_turn(prim.GetAttribute(f"physics:localRot{side}").Get()), place)


def _turn(quaternion: Any) -> np.ndarray:
    return quaternions.to_matrix(np.array([quaternion.real, *quaternion.imaginary], np.float64))


def _sorted(one: str, other: str) -> tuple[str, str]:
    return (one, other) if one < other else (other, one)
