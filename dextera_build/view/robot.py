"""A robot in the viewer: joint sliders within the limits, roles as coloured frames, collision shapes, reach."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import mujoco
import numpy as np

from dextera_build.artifacts.robots.robot import RobotJoint, RobotModel
from dextera_build.sim.model.reach import of_limb
from dextera_build.sim.model.robot import load
from dextera_build.view import kinematic
from dextera_build.view.figure import Figure, add_label, look_from
from dextera_build.view.panel import note_robot
from dextera_build.view.switches import switch

COLOURS = {"flange": (235, 170, 50), "palm": (60, 140, 220), "tip": (230, 85, 60), "": (150, 105, 200)}
"""Part of a role's name -> colour of its frame's origin; "" for all others."""
AXES_M, DOT_M = 0.05, 0.007
"""Length of a frame's axes, and radius of its origin [m]."""
BEHIND = (106, 122, 142)
"""Colour of the background: unlike white, grey and black, as most robots are."""
POSTURES = 1500
"""Number of random postures whose palms show the reach."""
SWEEP_S, STEPS = 1.5, 13
"""Duration [s] and number of states of a joint's way home, lower, upper, home in a recording; 13 hold all four."""


class RobotView:
    """Shows a robot; sliders move its joints and those that follow them.

    Args:
        server: From `view.server.start`.
        name: Scene node of the whole.
        robot: The robot.
    """

    def __init__(self, server: Any, name: str, robot: RobotModel) -> None:
        self._server, self._robot = server, robot
        self._model = load(robot.model).compile()
        self._data = mujoco.MjData(self._model)
        self._posture = dict(robot.home)
        self._forward()
        self.figure = Figure(server, name, self._model, self._data, {})
        self.frames = {role: self._frame(f"{name}/roles/{role}", role) for role in robot.frames}
        self.labels = {role: add_label(server, f"{name}/labels/{role}", role, (0.0, 0.0, 0.0)) for role in robot.frames}
        self.sliders: dict[str, tuple[Any, float]] = {}
        reach = self._reach(name)
        server.gui.add_markdown(self._words())
        server.scene.set_background_image(np.full((4, 4, 3), BEHIND, np.uint8), format="png")
        self._switches(reach)
        self._joints()
        self._note(name)
        look_from(server, np.concatenate([self._data.xpos[1:], self._data.site_xpos]))
        self.pose({})

    def pose(self, joints: dict[str, float]) -> None:
        """Move actuated joints [rad or m], and show the result."""
        self._posture |= joints
        self._forward()
        self.figure.update(self._data)
        with self._server.atomic():
            for role, site in self._robot.frames.items():
                found = self._data.site(site)
                quaternion = np.zeros(4)
                mujoco.mju_mat2Quat(quaternion, found.xmat)
                self.frames[role].position, self.frames[role].wxyz = found.xpos.copy(), quaternion
                self.labels[role].position = found.xpos + np.array([0.0, 0.0, 2 * DOT_M])

    def sweep(self) -> Iterator[float]:
        """Move one joint after the other through its limits and back home; each item is how long a state lasts [s]."""
        for joint in self._robot.joints:
            way = [joint.home, joint.lower, joint.upper, joint.home]
            for position in np.interp(np.linspace(0, 3, STEPS), range(4), way):
                self.pose({joint.name: float(position)})
                yield SWEEP_S / STEPS

    def _forward(self) -> None:
        for name, position in self._robot.followed(self._posture).items():
            self._data.joint(name).qpos[0] = position
        mujoco.mj_kinematics(self._model, self._data)

    def _frame(self, name: str, role: str) -> Any:
        kind = next((part for part in COLOURS if part and part in role), "")
        return self._server.scene.add_frame(
            name, axes_length=AXES_M, axes_radius=AXES_M / 25, origin_radius=DOT_M, origin_color=COLOURS[kind]
        )

    def _reach(self, name: str) -> list[Any]:
        """The palm of every limb at random joint positions within the limits, hidden at first."""
        random, found = np.random.default_rng(0), []
        for limb in self._robot.limb_names:
            own = self._robot.limbs[limb]
            arm = [joint for joint in self._robot.joints if joint.name in own.arm]
            if not arm or not own.palm:
                continue
            points = np.empty((POSTURES, 3), np.float32)
            for number in range(POSTURES):
                self._posture |= {each.name: float(random.uniform(each.lower, each.upper)) for each in arm}
                self._forward()
                points[number] = self._data.site(self._robot.frames[own.palm]).xpos
            colours = np.tile(np.array(COLOURS["palm"], np.uint8), (POSTURES, 1))
            place = f"{name}/reach/{limb}"
            found.append(self._server.scene.add_point_cloud(place, points, colours, point_size=0.006, visible=False))
        self._posture = dict(self._robot.home)
        self._forward()
        return found

    def _words(self) -> str:
        """Name of the source, masses and reach."""
        robot = self._robot
        mass = float(self._model.body_mass.sum())
        rows = [f"**{robot.source}**", "", f"* {len(robot.joints)} joints, {len(robot.links)} links, {mass:.1f} kg"]
        for name in robot.limb_names:
            limb, ball = robot.limbs[name], of_limb(robot, name)
            reach = "" if ball is None or not np.isfinite(ball.radius_m) else f", reach below {ball.radius_m:.2f} m"
            hand = "gripper" if limb.gripper else f"{len(limb.tips)} tips"
            rows.append(f"* `{name}`: {len(limb.arm)} joints of the arm, {len(limb.hand)} of the hand, {hand}{reach}")
        return "\n".join(rows)

    def _switches(self, reach: list[Any]) -> None:
        roles = [*self.frames.values(), *self.labels.values()]
        with self._server.gui.add_folder("Show"):
            switch(self._server, "Robot", self.figure.robot, visible=True)
            switch(self._server, "Roles", roles, visible=True)
            switch(self._server, "Collision pieces", self.figure.pieces, visible=False)
            if reach:
                switch(self._server, "Reach of the palm", reach, visible=False)

    def _joints(self) -> None:
        """Buttons for all joints, and a slider for each that ends at its limits."""
        gui = self._server.gui
        with gui.add_folder("Joints"):
            all_at = gui.add_button_group("All at", ("Home", "Lower", "Upper"))
            for joint in self._robot.joints:
                self.sliders[joint.name] = self._slider(joint)
        wanted: dict[str, Callable[[RobotJoint], float]] = {
            "Home": lambda joint: joint.home,
            "Lower": lambda joint: joint.lower,
            "Upper": lambda joint: joint.upper,
        }
        all_at.on_click(lambda _: self._move_all(wanted[all_at.value]))

    def _note(self, name: str) -> None:
        """The same sliders for a saved page."""
        units = {joint: unit for joint, (_, unit) in self.sliders.items()}
        found = kinematic.tree(self._robot, self._model, units, self.figure.followed)
        for role, site in self._robot.frames.items():
            found["nodes"].append(kinematic.node(self._model, f"{name}/roles/{role}", site))
            label = kinematic.node(self._model, f"{name}/labels/{role}", site)
            found["nodes"].append({**label, "above": 2 * DOT_M})
        note_robot(self._server, found)

    def _move_all(self, wanted: Callable[[RobotJoint], float]) -> None:
        posture = {joint.name: wanted(joint) for joint in self._robot.joints}
        for name, (slider, unit) in self.sliders.items():
            slider.value = float(np.clip(posture[name] * unit, slider.min, slider.max))
        self.pose(posture)

    def _slider(self, joint: RobotJoint) -> tuple[Any, float]:
        """A slider in degrees or millimetres, and the number of these per radian or metre."""
        turns = int(self._model.joint(joint.name).type[0]) == mujoco.mjtJoint.mjJNT_HINGE
        unit = float(np.degrees(1.0)) if turns else 1000.0
        # Limits are rounded inwards: a slider cannot leave them.
        low, high = np.ceil(joint.lower * unit * 10) / 10, np.floor(joint.upper * unit * 10) / 10
        slider = self._server.gui.add_slider(
            f"{joint.name} [{'deg' if turns else 'mm'}]",
            min=float(low),
            max=float(max(high, low + 0.1)),
            step=0.1,
            initial_value=float(np.clip(round(joint.home * unit, 1), low, max(high, low + 0.1))),
        )
        slider.on_update(lambda _: self.pose({joint.name: slider.value / unit}))
        return slider, unit
