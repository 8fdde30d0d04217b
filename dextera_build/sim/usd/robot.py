"""Write a robot as an articulation: links as siblings, joints with drives, followers, frames and filtered pairs.

    /World/<robot>              articulation root, labelled `robot`
      <link>                    rigid body with mass at its place in the home position
        Visuals, Collisions     geometry; pieces that only collide are guides
        Frames/<role>           tool centre, fingertips, ...
      joints/<joint>            joints; `root` fixes the base to the world
      Looks                     surface and physics materials

All values come from the compiled model, so derived values are those of MuJoCo's simulation. A link with neither joint
nor mass is not a rigid body, but a frame of its parent.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from dextera_build.artifacts.scenes.scene_description import Attachment
from dextera_build.formats.mesh_usd import add_surface_material
from dextera_build.geometry import quaternions, transforms
from dextera_build.sim.model import mjcf_contact
from dextera_build.sim.model import robot as robots
from dextera_build.sim.model.robot_meshes import COLLISION
from dextera_build.sim.usd import physx
from dextera_build.sim.usd.prims import (
    add_contact,
    add_drive,
    add_label,
    add_mass,
    bind_contact,
    connect,
    place,
)
from dextera_build.sim.usd.shapes import add_shape, refused


def add_robot(stage: Any, path: str, attachment: Attachment) -> None:
    """Write a robot at its home position below `path`, fixed to the world.

    Raises:
        RuleError: A link has two joints, a joint but no mass, or a geometry without a USD equivalent.
    """
    _Writer(stage, path, attachment).write()


class _Writer:
    def __init__(self, stage: Any, path: str, attachment: Attachment) -> None:
        self.stage, self.path, self.prefix = stage, path, attachment.prefix
        self.robot, self.base = attachment.robot, attachment.pose.matrix
        self.model = robots.load(self.robot.model).compile()
        self.data = mujoco.MjData(self.model)
        for name, position in self.robot.followed(self.robot.home).items():
            self.data.joint(name).qpos[0] = position
        mujoco.mj_forward(self.model, self.data)
        self.links = _identifiers([self.model.body(number).name for number in range(1, self.model.nbody)])
        self.joints = _identifiers([self.model.joint(number).name for number in range(self.model.njnt)])
        self.contacts: dict[tuple[float, float], Any] = {}
        self.looks: dict[tuple[float, ...], str] = {}

    def write(self) -> None:
        """Write everything."""
        from pxr import Kind, Usd, UsdGeom

        top = UsdGeom.Xform.Define(self.stage, self.path)
        Usd.ModelAPI(top).SetKind(Kind.Tokens.component)
        place(top, self.base)
        add_label(top.GetPrim(), "robot")
        physx.add_articulation(top.GetPrim())
        for scope in ("joints", "Looks"):
            UsdGeom.Scope.Define(self.stage, f"{self.path}/{scope}")
        for body in range(1, self.model.nbody):
            self._link(body)
        for body in range(1, self.model.nbody):
            if self._rigid(body):
                self._join(body)
        self._couple()
        self._separate()

    def _rigid(self, body: int) -> bool:
        return bool(self.model.body_mass[body] > 0)

    def _owner(self, body: int) -> int:
        """The rigid body of a body: itself, or an ancestor."""
        while body and not self._rigid(body):
            body = int(self.model.body_parentid[body])
        return body

    def _at(self, body: int) -> str:
        return f"{self.path}/{self.links[self.model.body(body).name]}" if body else self.path

    def _pose(self, body: int) -> np.ndarray:
        """T_base_body."""
        model = self.data
        base = transforms.rigid(model.body("base").xmat.reshape(3, 3), model.body("base").xpos)
        own = transforms.rigid(model.xmat[body].reshape(3, 3), model.xpos[body])
        return np.asarray(transforms.invert(base) @ own)

    def _link(self, body: int) -> None:
        from pxr import UsdGeom, UsdPhysics

        model, name = self.model, self.model.body(body).name
        if model.body_jntnum[body] > 1:
            raise refused(f"link `{name}` has {model.body_jntnum[body]} joints", "put a link between them")
        if model.body_jntnum[body] and not self._rigid(body):
            raise refused(f"link `{name}` moves but weighs nothing", "state its mass in the robot's description")
        link = UsdGeom.Xform.Define(self.stage, self._at(body))
        place(link, self._pose(body))
        prim = link.GetPrim()
        if self._rigid(body):
            UsdPhysics.RigidBodyAPI.Apply(prim)
            prim.SetDisplayName(self.prefix + name)
            turn = quaternions.to_matrix(model.body_iquat[body])
            inertia = turn @ np.diag(model.body_inertia[body]) @ turn.T
            add_mass(prim, float(model.body_mass[body]), model.body_ipos[body], inertia)
            # The controller compensates the robot's own weight, as in MJCF.
            physx.float_in_place(prim)
        for geom in np.flatnonzero(model.geom_bodyid == body):
            self._geom(self._at(body), int(geom))
        for site in np.flatnonzero(model.site_bodyid == body):
            frame = UsdGeom.Xform.Define(
                self.stage, f"{self._at(body)}/Frames/{_identifiers([model.site(site).name])[model.site(site).name]}"
            )
            place(frame, transforms.rigid(quaternions.to_matrix(model.site_quat[site]), model.site_pos[site]))

    def _geom(self, path: str, geom: int) -> None:
        from pxr import UsdGeom, UsdPhysics, UsdShade

        model = self.model
        touches = bool(model.geom_contype[geom] or model.geom_conaffinity[geom])
        seen = model.geom_group[geom] < COLLISION
        if not (touches or seen):
            return
        scope = "Collisions" if touches else "Visuals"
        UsdGeom.Scope.Define(self.stage, f"{path}/{scope}")
        prim = add_shape(self.stage, f"{path}/{scope}/geom_{geom}", model, geom)
        UsdShade.MaterialBindingAPI.Apply(prim).Bind(UsdShade.Material.Get(self.stage, self._look(geom)))
        if not touches:
            return
        if not seen:
            UsdGeom.Imageable(prim).CreatePurposeAttr(UsdGeom.Tokens.guide)
        UsdPhysics.CollisionAPI.Apply(prim)
        bind_contact(prim, self._contact(geom))

    def _look(self, geom: int) -> str:
        material = int(self.model.geom_matid[geom])
        rgba = self.model.mat_rgba[material] if material >= 0 else self.model.geom_rgba[geom]
        colour = tuple(round(float(each), 4) for each in rgba[:3])
        if colour not in self.looks:
            path = f"{self.path}/Looks/colour_{len(self.looks) + 1}"
            self.looks[colour] = add_surface_material(self.stage, path, colour, None, 0.5)  # type: ignore[arg-type]
        return self.looks[colour]

    def _contact(self, geom: int) -> Any:
        """The physics material of a geom: that of a skin, or one with which the other side's values apply."""
        decides = bool(self.model.geom_priority[geom])
        bounce = mjcf_contact.bounce(float(self.model.geom_solref[geom, 1]))
        key = (float(self.model.geom_friction[geom, 0]), bounce) if decides else (0.0, 0.0)
        if key not in self.contacts:
            path = f"{self.path}/Looks/contact_{len(self.contacts) + 1}"
            self.contacts[key] = add_contact(self.stage, path, *key)
        return self.contacts[key]

    def _join(self, body: int) -> None:
        from pxr import UsdPhysics

        model, parent = self.model, self._owner(int(self.model.body_parentid[body]))
        ends = (self._at(parent), self._at(body))
        # T_parent_body with its joint at 0, independent of the home position.
        between = transforms.invert(self._rest(parent)) @ self._rest(body)
        if not model.body_jntnum[body]:
            name = "root" if not parent else f"fixed_{self.links[model.body(body).name]}"
            fixed = UsdPhysics.FixedJoint.Define(self.stage, f"{self.path}/joints/{name}")
            connect(fixed, ends, (self._pose(body) if not parent else between, np.eye(4)))
            return
        number = int(model.body_jntadr[body])
        name = model.joint(number).name
        turns = self._turns(number)
        kind = UsdPhysics.RevoluteJoint if turns else UsdPhysics.PrismaticJoint
        joint = kind.Define(self.stage, f"{self.path}/joints/{self.joints[name]}")
        joint.GetPrim().SetDisplayName(self.prefix + name)
        along = transforms.rotation_between(np.array([1.0, 0.0, 0.0]), model.jnt_axis[number])
        frame = transforms.rigid(along, model.jnt_pos[number])
        # MuJoCo calls the position of the reference configuration `qpos0`, USD calls it 0.
        connect(joint, ends, (between @ frame @ _moved(-float(self._qpos0(number)), turns), frame))
        joint.CreateAxisAttr("X")
        self._limit(joint, number, turns)
        self._drive(joint.GetPrim(), name, number, turns)

    def _turns(self, joint: int) -> bool:
        return int(self.model.jnt_type[joint]) == int(mujoco.mjtJoint.mjJNT_HINGE)

    def _rest(self, body: int) -> np.ndarray:
        """T_world_body with all joints at their reference."""
        pose = np.eye(4)
        while body:
            turn = quaternions.to_matrix(self.model.body_quat[body])
            pose = transforms.rigid(turn, self.model.body_pos[body]) @ pose
            body = int(self.model.body_parentid[body])
        return pose

    def _qpos0(self, joint: int) -> float:
        return float(self.model.qpos0[self.model.jnt_qposadr[joint]])

    def _limit(self, joint: Any, number: int, turns: bool) -> None:
        if self.model.jnt_limited[number]:
            low, high = self.model.jnt_range[number] * (np.degrees(1.0) if turns else 1.0)
            joint.CreateLowerLimitAttr(float(low))
            joint.CreateUpperLimitAttr(float(high))

    def _drive(self, prim: Any, name: str, number: int, turns: bool) -> None:
        model, dof = self.model, int(self.model.jnt_dofadr[number])
        known = next((joint for joint in self.robot.joints if joint.name == name), None)
        fastest = None if known is None else known.velocity
        friction, armature = float(model.dof_frictionloss[dof]), float(model.dof_armature[dof])
        physx.set_joint(prim, turns, friction, armature, fastest)
        position, damping = float(self.data.qpos[model.jnt_qposadr[number]]), float(model.dof_damping[dof])
        physx.set_position(prim, turns, position)
        if known is None:
            add_drive(prim, turns, position, 0.0, damping)
            return
        actuator = model.actuator(name).id
        limited = model.actuator_forcelimited[actuator]
        add_drive(
            prim,
            turns,
            position,
            float(model.actuator_gainprm[actuator, 0]),
            damping - float(model.actuator_biasprm[actuator, 2]),
            float(model.actuator_forcerange[actuator, 1]) if limited else None,
        )

    def _couple(self) -> None:
        for follower in self.robot.followers:
            number = self.model.joint(follower.name).id
            turns = self._turns(number)
            prim, leader = (
                self.stage.GetPrimAtPath(f"{self.path}/joints/{self.joints[name]}")
                for name in (follower.name, follower.leader)
            )
            physx.follow(prim, turns, leader.GetPath(), follower.ratio, follower.offset)

    def _separate(self) -> None:
        from pxr import Sdf, UsdPhysics

        for number in range(self.model.nexclude):
            signature = int(self.model.exclude_signature[number])
            one, other = (self._owner(body) for body in (signature >> 16, signature & 0xFFFF))
            if one and other and one != other:
                api = UsdPhysics.FilteredPairsAPI.Apply(self.stage.GetPrimAtPath(self._at(one)))
                api.CreateFilteredPairsRel().AddTarget(Sdf.Path(self._at(other)))


def _moved(position: float, turns: bool) -> np.ndarray:
    """(4, 4) motion of a joint about or along x."""
    if not turns:
        return transforms.rigid(np.eye(3), np.array([position, 0.0, 0.0]))
    c, s = np.cos(position), np.sin(position)
    return transforms.rigid(np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]]), np.zeros(3))


def _identifiers(names: list[str]) -> dict[str, str]:
    """Name -> identifier of USD, unique among them."""
    from pxr import Tf

    taken: set[str] = {"joints", "Looks"}
    found = {}
    for name in names:
        own, number = Tf.MakeValidIdentifier(name), 2
        wanted = own
        while own in taken:
            own, number = f"{wanted}_{number}", number + 1
        taken.add(own)
        found[name] = own
    return found
