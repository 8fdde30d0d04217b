"""A task in the viewer: its robot, objects and room, and the physics, which can be played, paused and stepped."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from dextera_build.artifacts.scenes.scene import Scene
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.errors import RuleError
from dextera_build.sim.model import model as models
from dextera_build.sim.runtime.environment import Environment
from dextera_build.view.figure import Fact, Figure, about, facts_of, free_roots, look_from
from dextera_build.view.switches import switches
from dextera_build.view.transport import Transport

SPEEDS = ("0.1", "0.25", "0.5", "1", "2")
"""Choices of simulated time per real time."""


def facts_of_task(bundle: TaskBundle, model: Any, materials: Mapping[str, str]) -> dict[str, Fact]:
    """Facts about the task's objects.

    Args:
        bundle: The task.
        model: Its compiled model, with the photograph's masses.
        materials: Root body -> row of the material table, where known.
    """
    found = {}
    for root, thing in bundle.objects.items():
        kilograms = float(model.body_subtreemass[model.body(root).id])
        low, high = (factor * kilograms for factor in thing.mass_scale)
        found[root] = Fact(kilograms, (low, high), materials.get(root, ""), thing.friction)
    return found


class TaskView:
    """Shows a task and steps its physics on demand. The robot holds the joint targets of the sliders.

    Args:
        server: From `view.server.start`.
        name: Scene node of the whole.
        bundle: The task.
        materials: Root body -> row of the material table, where known.

    Raises:
        RuleError: MuJoCo cannot load the model, or it lacks the robot.
    """

    def __init__(self, server: Any, name: str, bundle: TaskBundle, materials: Mapping[str, str]) -> None:
        self._server, self._bundle = server, bundle
        self.environment = running(bundle)
        world = self.environment
        self._photographed = world.start
        facts = facts_of_task(bundle, world.model, materials)
        self.figure = Figure(server, name, world.model, world.data, facts)
        self._targets = world.previous_action.copy()
        self._verdict = ""
        self.transport = Transport(world.period_s, self.forward, self.show)
        look_from(server, world.data.xpos[1:])
        task = bundle.task
        server.gui.add_markdown(f"**{task.name}** · {task.primitive} `{task.object}` · {bundle.kind}")
        self._controls()
        switches(server, self.figure)
        about(server, self.figure, facts)
        self._sliders()

    def forward(self) -> bool:
        """One control period with the sliders' targets; False once the physics has diverged."""
        outcome = self.environment.step(self._targets)
        if outcome.success:
            self._verdict = "success"
        elif outcome.over and not self._verdict.startswith("success"):
            self._verdict = outcome.reason
        return bool(np.isfinite(self.environment.data.qpos).all())

    def show(self) -> None:
        """Move the bodies and show the time."""
        self.figure.update(self.environment.data)
        seconds = self.environment.steps * self.environment.period_s
        rate = f" · {self.transport.reached:.2f}x" if self.transport.playing else ""
        self._status.content = f"t = {seconds:.2f} s{rate}" + (f" · {self._verdict}" if self._verdict else "")

    def reset(self, seed: int | None = None) -> None:
        """Begin again: at the photograph's state, or at a start drawn with `seed`."""
        with self.transport.lock:
            start = self._photographed if seed is None else self.environment.draw(seed)
            self.environment.begin(start)
            self._verdict = ""
            self.figure.resize(start.size_scale)
            self._targets = self.environment.previous_action.copy()
            for slider, (unit, target) in zip(self._joints, self._shown(), strict=True):
                slider.value = round(float(np.clip(target * unit, slider.min, slider.max)), 1)
            self.show()

    def _controls(self) -> None:
        gui = self._server.gui
        with gui.add_folder("Physics"):
            self._status = gui.add_markdown("t = 0.00 s")
            play = gui.add_button_group("Motion", ("Play", "Pause", "Step"))
            speed = gui.add_dropdown("Speed", SPEEDS, initial_value="1")
            again = gui.add_button("Reset to the photograph")
            seed = gui.add_number("Seed", 1, min=0, step=1)
            drawn = gui.add_button("Reset to a drawn start")
        moves = {"Play": self.transport.play, "Pause": self.transport.pause, "Step": self.transport.step}
        play.on_click(lambda _: moves[play.value]())
        speed.on_update(lambda _: setattr(self.transport, "speed", float(speed.value)))
        again.on_click(lambda _: self.reset())

        def draw(_: object) -> None:
            try:
                self.reset(int(seed.value))
            except RuleError as error:
                self._status.content = error.message

        drawn.on_click(draw)

    def _shown(self) -> list[tuple[float, float]]:
        """Units per radian or metre of each slider, and the target of its joint."""
        turns = [joint_turns(self.environment.model, joint.name) for joint in self._bundle.robot.joints]
        return [(_unit(turn), float(target)) for turn, target in zip(turns, self._targets, strict=True)]

    def _sliders(self) -> None:
        self._joints: list[Any] = []
        with self._server.gui.add_folder("Joint targets", expand_by_default=False):
            for number, (joint, (unit, target)) in enumerate(
                zip(self._bundle.robot.joints, self._shown(), strict=True)
            ):
                low, high = round(joint.lower * unit, 1), round(joint.upper * unit, 1)
                title = f"{joint.name} [{'mm' if unit == 1000.0 else 'deg'}]"
                start = round(float(np.clip(target * unit, low, high)), 1)
                slider = self._server.gui.add_slider(title, min=low, max=high, step=0.1, initial_value=start)

                def aim(_: object, slider: Any = slider, number: int = number, unit: float = unit) -> None:
                    self._targets[number] = slider.value / unit

                slider.on_update(aim)
                self._joints.append(slider)


def running(bundle: TaskBundle) -> Environment:
    """The task at the photograph's state.

    Raises:
        RuleError: MuJoCo cannot load the model, or it lacks the robot.
    """
    try:
        return Environment(bundle)
    except KeyError as error:
        raise RuleError(
            "the task's model lacks names of its robot or objects, and cannot run",
            code="DXB-B232",
            facts={"MuJoCo": str(error.args[0]).partition(" Valid")[0]},
            hint="stub backends write no robot into it: build with `--profile cpu`",
        ) from None


def joint_turns(model: Any, name: str) -> bool:
    """Whether a joint of the robot is a hinge."""
    from dextera_build.sim.model.compose import ROBOT
    from dextera_build.sim.model.sizes import HINGE

    return int(model.joint(ROBOT + name).type[0]) == HINGE


def _unit(turns: bool) -> float:
    return float(np.degrees(1.0)) if turns else 1000.0


def show_model(server: Any, name: str, scene: Scene, materials: Mapping[str, str]) -> None:
    """A written scene at its home keyframe."""
    model = models.compile_folder(scene.model)
    data = models.at_home(model)
    known = {
        root: Fact(float(model.body_subtreemass[model.body(root).id]), None, materials[root])
        for root in free_roots(model)
        if root in materials
    }
    facts = facts_of(model, free_roots(model), known)
    figure = Figure(server, name, model, data, facts)
    look_from(server, data.xpos[1:])
    switches(server, figure)
    about(server, figure, facts)
