"""Recordings of a robot that lifts or pushes a box, in a world whose masses, friction and controllers are known."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.policy import layout
from dextera_build.sim.model import machine
from dextera_build.sim.model.model import at_home, compile_folder
from dextera_build.sim.runtime import starts
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.runtime.rollout import open_loop
from tests import task_bundles

LATENCY_S = 0.02
MASS_KG, FRICTION = 0.6, 0.45
"""Those of the box, which the twin believes to be 0.5 and 0.6. With more friction it would nearly tip when pushed."""
SHARE = 0.01
"""Dry friction of the rails, as a fraction of their maximum force."""
ABOVE = [0.3, 0.1, 0.0, 0.05, 0.05]
"""Joints with the fingers around the box [m]."""
CLOSED, RAISED = [0.3, 0.1, 0.0, 0.0, 0.0], [0.3, 0.1, 0.08, 0.0, 0.0]
WAYS = {
    "lift": [([0.0, 0.1, 0.0, 0.05, 0.05], 10), (ABOVE, 25), (ABOVE, 5), (CLOSED, 10), (RAISED, 25), (RAISED, 10)],
    # The closed fingers push the box along x.
    "push": [([0.0, 0.1, 0.0, 0.0, 0.0], 10), ([0.25, 0.1, 0.0, 0.0, 0.0], 30), ([0.45, 0.1, 0.0, 0.0, 0.0], 40)],
    "wave": [([0.0, 0.1, 0.1, 0.05, 0.05], 15), ([-0.2, -0.1, 0.05, 0.05, 0.05], 30)],
}
"""What is done -> joints [m], and the control periods in which they are reached."""


def twin() -> TaskBundle:
    """The task in the twin: that of `task_bundles.lift` with a heavier box of less known friction."""
    bundle = task_bundles.lift()
    text = bundle.model.files["scene.xml"].replace(
        b'size="0.02 0.02 0.02" mass="0.1"', b'size="0.02 0.02 0.02" mass="0.5"'
    )
    assert text != bundle.model.files["scene.xml"]
    box = bundle.objects["box"].model_copy(update={"friction": 0.6, "friction_sigma": 0.16})
    return bundle.model_copy(
        update={"model": Folder(files={"scene.xml": text}), "objects": bundle.objects | {"box": box}}
    )


def world(seed: int = 5) -> TaskBundle:
    """A world that differs from the twin in everything that is estimated, but not in sizes."""
    robot = machine.Machine(
        seed=seed,
        gain_spread=0.08,
        arm_friction=SHARE,
        hand_friction=0.03,
        skin_spread=0.0,
        timestep_s=0.001,
        latency_s=LATENCY_S,
    )
    bundle = twin()
    before, spec = compile_folder(bundle.model), machine.load(bundle.model)
    home = at_home(before)
    box = spec.body("box").geoms[0]
    # As in composed scenes, the friction of an object is that of its contacts.
    box.mass, box.friction[0], box.priority = MASS_KG, FRICTION, 1
    machine.disturb(spec, bundle.robot, robot)
    positions = {before.joint(number).name: home.joint(number).qpos.copy() for number in range(before.njnt)}
    objects = bundle.objects | {"box": bundle.objects["box"].model_copy(update={"friction": FRICTION})}
    model = machine.finish(spec, positions, home, bundle.model.files)
    return bundle.model_copy(update={"model": model, "objects": objects, "kind": "perturbed", "latency_s": LATENCY_S})


def recorded(there: TaskBundle, *ways: str) -> Episodes:
    """Episodes in which these things are done."""
    environment = Environment(there)
    start = starts.photographed(there, environment.model)
    items = {str(number): open_loop(environment, start, _targets(start.ctrl, way)) for number, way in enumerate(ways)}
    return layout.gathered(there, items, {}, len(items))


def _targets(first: np.ndarray, way: str) -> np.ndarray:
    rows, now = [], np.asarray(first, float)
    for joints, periods in WAYS[way]:
        # Starts and ends at rest.
        share = 0.5 - 0.5 * np.cos(np.pi * np.arange(1, periods + 1) / periods)
        rows += [now + each * (np.array(joints) - now) for each in share]
        now = np.array(joints)
    return np.array(rows)
