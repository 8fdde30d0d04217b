"""A robot's hand with its palm fixed: fingertips, contacts, and their derivatives by the motors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.geometry import quaternions, transforms
from dextera_build.sim.control.mechanism import surface_points
from dextera_build.sim.model.fixed_joints import alone

CLEAR_M = 0.002
"""Distance below which two parts of the hand are reported as close [m]."""


@dataclass(frozen=True)
class Seen:
    """The hand at joint positions; points are in the frame of the palm."""

    tips: np.ndarray
    """(F, 3) fingertip frames [m]."""
    centres: np.ndarray
    """(F, 3) centres of the fingertips' spheres [m]."""
    close: np.ndarray
    """(K,) distances of parts that are closer than `CLEAR_M`, negative inside each other [m]."""
    bodies: np.ndarray
    """(K, 2) their bodies."""


class HandModel:
    """Kinematics of one hand; every joint is a motor's or follows one at a fixed ratio.

    Args:
        robot: The embodiment; all other joints are fixed at home.
        limb: Name of the limb.
        tips: Roles of the fingertips.
    """

    def __init__(self, robot: RobotModel, limb: str, tips: Sequence[str]) -> None:
        own = robot.limbs[limb]
        motors = [joint for joint in robot.joints if joint.name in own.hand]
        led = [each for each in robot.followers if each.leader in own.hand]
        self.joints: tuple[str, ...] = tuple(joint.name for joint in motors)
        """Motors, in the limb's order."""
        self.model = alone(robot, {*self.joints, *(each.name for each in led)})
        self.data = mujoco.MjData(self.model)
        self._spread, self._offset = np.zeros((self.model.nv, len(motors))), np.zeros(self.model.nv)
        self.lower = np.array([joint.lower for joint in motors])
        """(H,) lower limits of the motors, those of followers included [rad]."""
        self.upper = np.array([joint.upper for joint in motors])
        """(H,) upper limits [rad]."""
        self.home = np.array([joint.home for joint in motors])
        """(H,) home [rad]."""
        for column, name in enumerate(self.joints):
            self._spread[self.model.joint(name).dofadr[0], column] = 1.0
        for each in led:
            joint = self.model.joint(each.name)
            self._spread[joint.dofadr[0], self.joints.index(each.leader)] = each.ratio
            self._offset[joint.dofadr[0]] = each.offset
        self._sites = [self.model.site(robot.frames[role]).id for role in tips]
        self.bodies = np.array([self.model.site_bodyid[site] for site in self._sites])
        """(F,) bodies of the fingertips."""
        self._inside, self.radii = self._spheres()
        group = self._groups(int(self.model.site(robot.frames[own.palm]).bodyid[0]), robot.links)
        self.links: tuple[str, ...] = tuple(self.model.body(body).name for body in np.flatnonzero(group).tolist())
        """Links of the hand."""
        self._only_the_hand(group)
        self._set(self.home)
        palm = self.data.site(robot.frames[own.palm])
        self.palm = transforms.rigid(palm.xmat.reshape(3, 3).copy(), palm.xpos.copy())
        """T_world_palm (4, 4) of this model."""
        self._contacts: list[int] = []
        self._turn, self._jacobian = self.palm[:3, :3].copy(), np.zeros((3, self.model.nv))

    def at(self, posture: np.ndarray) -> Seen:
        """The hand at motor positions (H,) [rad]."""
        self._set(posture)
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_collision(self.model, self.data)
        tips, centres = self.data.site_xpos[self._sites], self._centres()
        self._contacts = self._closest()
        return Seen(
            (tips - self.palm[:3, 3]) @ self._turn,
            (centres - self.palm[:3, 3]) @ self._turn,
            self.data.contact.dist[self._contacts],
            self.model.geom_bodyid[self.data.contact.geom[self._contacts]].reshape(-1, 2),
        )

    def link_poses(self, posture: np.ndarray, palm: np.ndarray) -> np.ndarray:
        """Poses (K, 7) of `links` at motor positions (H,) [rad]: position [m], quaternion w x y z.

        Args:
            posture: Motor positions [rad].
            palm: Pose of the palm (4, 4), in whose base the poses are.
        """
        self._set(posture)
        shift = palm @ transforms.invert(self.palm)
        turn = quaternions.from_matrix(shift[:3, :3])
        bodies = [self.data.body(link) for link in self.links]
        places = np.array([body.xpos for body in bodies]) @ shift[:3, :3].T + shift[:3, 3]
        return np.concatenate([places, quaternions.multiply(turn, np.array([body.xquat for body in bodies]))], axis=1)

    def moving(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Derivatives by the motors, at the posture of the last `at`: of tips, of centres (F, 3, H), of `close` (K, H).

        Raises nothing; a part that no motor moves has zeros.
        """
        tips = np.array([self._moves(self.data.site_xpos[s], b) for s, b in zip(self._sites, self.bodies, strict=True)])
        centres = np.array([self._moves(c, b) for c, b in zip(self._centres(), self.bodies, strict=True)])
        contact, close = self.data.contact, np.zeros((len(self._contacts), self.model.nv))
        for row, number in enumerate(self._contacts):
            first, second = self.model.geom_bodyid[contact.geom[number]]
            gap = self._moves(contact.pos[number], second) - self._moves(contact.pos[number], first)
            close[row] = contact.frame[number, :3] @ gap
        return self._turn.T @ tips @ self._spread, self._turn.T @ centres @ self._spread, close @ self._spread

    def site(self, finger: int) -> int:
        """Number in `model` of the site of a fingertip."""
        return int(self._sites[finger])

    def tip(self, posture: np.ndarray, finger: int) -> np.ndarray:
        """Position (3,) [m] of one fingertip in the palm's frame at motor positions (H,) [rad]."""
        self._set(posture)
        return np.asarray(self._turn.T @ (self.data.site_xpos[self._sites[finger]] - self.palm[:3, 3]))

    def chain(self, finger: int) -> list[int]:
        """Motors that move a fingertip, from the palm outwards, as places in `joints`."""
        found: list[int] = []
        for body in self._above(int(self.bodies[finger])):
            first = self.model.body_dofadr[body]
            for dof in reversed(range(first, first + self.model.body_dofnum[body])):
                found += [motor for motor in np.flatnonzero(self._spread[dof]).tolist() if motor not in found]
        return found[::-1]

    def root(self, finger: int) -> np.ndarray:
        """Position (3,) [m] in the palm's frame of the axis of the first motor that moves a fingertip."""
        anchor = self.data.joint(self.joints[self.chain(finger)[0]]).xanchor
        return np.asarray(self._turn.T @ (anchor - self.palm[:3, 3]))

    def place(self, site: str) -> np.ndarray:
        """Position (3,) [m] of a site of the robot in the palm's frame, at the last posture."""
        return np.asarray(self._turn.T @ (self.data.site(site).xpos - self.palm[:3, 3]))

    def width(self, finger: int, across: np.ndarray) -> float:
        """Largest distance from a fingertip to a side of its link, along `across` (3,), at the last posture [m]."""
        body = int(self.bodies[finger])
        along = self.data.xmat[body].reshape(3, 3).T @ self._turn @ across
        corners = surface_points(self.model, body) - self.model.site_pos[self._sites[finger]]
        return float(np.abs(corners @ along).max())

    def gap(self, one: int, other: int) -> float:
        """Smallest distance of the surfaces of two fingertips' links at the last posture; below 0 inside [m].

        Unlike the spheres of `Seen` it is that of the whole collision geometry.
        """
        links = [np.flatnonzero(self.model.geom_bodyid == self.bodies[finger]) for finger in (one, other)]
        solid = [[geom for geom in link if self.model.geom_contype[geom]] for link in links]
        pairs = [(first, second) for first in solid[0] for second in solid[1]]
        return float(min(mujoco.mj_geomDistance(self.model, self.data, *pair, 1.0, None) for pair in pairs))

    def touching(self) -> list[tuple[str, str]]:
        """Pairs of links that are inside each other at the last posture."""
        deep = [number for number in self._contacts if self.data.contact.dist[number] < 0]
        pairs = self.model.geom_bodyid[self.data.contact.geom[deep]].reshape(-1, 2)
        return [(self.model.body(one).name, self.model.body(other).name) for one, other in pairs]

    def _closest(self) -> list[int]:
        """The closest contact of each pair of links."""
        if not self.data.ncon:
            return []
        distance = self.data.contact.dist
        best: dict[tuple[int, int], int] = {}
        for number, pair in enumerate(self.model.geom_bodyid[self.data.contact.geom].tolist()):
            key = (min(pair), max(pair))
            if key not in best or distance[number] < distance[best[key]]:
                best[key] = number
        return list(best.values())

    def _set(self, posture: np.ndarray) -> None:
        self.data.qpos[:] = self._spread @ posture + self._offset
        mujoco.mj_kinematics(self.model, self.data)

    def _centres(self) -> np.ndarray:
        turns = self.data.xmat[self.bodies].reshape(-1, 3, 3)
        return np.asarray(self.data.xpos[self.bodies] + np.einsum("fij,fj->fi", turns, self._inside))

    def _moves(self, point: np.ndarray, body: int) -> np.ndarray:
        """(3, V) derivative of a point of a body by the joints."""
        mujoco.mj_jac(self.model, self.data, self._jacobian, None, point, body)
        return self._jacobian.copy()

    def _spheres(self) -> tuple[np.ndarray, np.ndarray]:
        """Centres (F, 3) in the links, and radii (F,), of the spheres that round off the fingertips [m].

        The sphere is as thick as the collision geometry at the tip, and touches its end from inside.
        """
        model = self.model
        centres, radii = [], []
        for site, body in zip(self._sites, self.bodies, strict=True):
            best, place = np.inf, model.site_pos[site]
            centre, radius = place, 0.0
            for geom in np.flatnonzero((model.geom_bodyid == body) & (model.geom_contype > 0)):
                turn = quaternions.to_matrix(model.geom_quat[geom])
                middle, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
                inner = half - half.min()
                own = turn.T @ (place - model.geom_pos[geom]) - middle
                near = np.clip(own, -inner, inner)
                off = abs(np.linalg.norm(own - near) - half.min())
                if off < best:
                    best, radius = off, half.min()
                    centre = model.geom_pos[geom] + turn @ (middle + near)
            centres.append(centre)
            radii.append(radius)
        return np.array(centres), np.array(radii)

    def _only_the_hand(self, group: np.ndarray) -> None:
        """Let fingers collide with one another and with the palm alone, and report what is closer than `CLEAR_M`."""
        model, of_geom = self.model, group[self.model.geom_bodyid]
        solid = (of_geom > 0) & ((model.geom_contype > 0) | (model.geom_conaffinity > 0))
        # A geometry collides with all groups but its own.
        model.geom_contype[:] = np.where(solid, 1 << of_geom, 0)
        model.geom_conaffinity[:] = np.where(solid, ~(1 << of_geom), 0)
        model.geom_margin[:] = CLEAR_M / 2
        model.geom_gap[:] = 0.0

    def _groups(self, palm: int, links: Mapping[str, str]) -> np.ndarray:
        """Group of each body: 0 outside of the hand, 1 the palm and links of several fingers, from 2 on a finger."""
        model = self.model
        while links.get(model.body(model.body_parentid[palm]).name) == "hand":
            palm = int(model.body_parentid[palm])
        above = [self._above(int(body)) for body in self.bodies]
        group = np.zeros(model.nbody, int)
        for body in range(1, model.nbody):
            way = self._above(body)
            moving = next((each for each in way if model.body_dofnum[each]), -1)
            fingers = [finger for finger, chain in enumerate(above) if moving in chain]
            group[body] = fingers[0] + 2 if len(fingers) == 1 else int(palm in way)
        return group

    def _above(self, body: int) -> list[int]:
        """A body and those that carry it, outwards first."""
        found = []
        while body:
            found.append(body)
            body = int(self.model.body_parentid[body])
        return found
