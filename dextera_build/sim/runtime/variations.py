"""Random variations of an episode other than poses and masses: joints, goals, cameras, light, the robot's base.

Errors of cameras and of the base are drawn from the covariance of their calibration. A twin has no estimate of joint
damping and friction, exposure and light, so their ranges are the constants below, scaled by the task's `Reset`.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dextera_build.artifacts.tasks.episode import Start
from dextera_build.artifacts.tasks.goals import Goal
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.artifacts.tasks.variation import EXACT, Twist, Variation
from dextera_build.sim.primitives import catalogue
from dextera_build.sim.runtime.seeds import seed_of
from dextera_build.sim.runtime.strata import Draws

ROBOT = "robot"
"""Name of the robot among bodies."""
JOINTS = 0.5
"""Half range of the log of factors on damping and friction of joints, times `Reset.joints`."""
EXPOSURE, LIGHT, NOISE = 0.3, 0.3, 0.5
"""Half ranges of the logs of factors on exposure, light and noise, times `Reset.visual`."""


def draw(bundle: TaskBundle, random: Draws) -> Variation:
    """Draw a variation of the task.

    Args:
        bundle: The task, whose `reset` gives the ranges.
        random: Source of all randomness.
    """
    reset = bundle.task.reset
    jointed = [name for name, thing in bundle.objects.items() if thing.joints]
    # A world that replaces hardware has one specific robot and set of objects, not a distribution.
    width = JOINTS * reset.joints if bundle.kind == "twin" else 0.0
    bodies = [*jointed, ROBOT] if width else []
    return Variation(
        damping={name: _factor(random, width) for name in bodies},
        joint_friction={name: _factor(random, width) for name in bodies},
        goal=_goal(bundle, random),
        exposure=_factor(random, EXPOSURE * reset.visual),
        light=_factor(random, LIGHT * reset.visual),
        noise=_factor(random, NOISE * reset.visual),
    )


def base(bundle: TaskBundle, random: Draws) -> Twist:
    """Draw an error of the robot's base from the covariance of its pose; none if it is exact, or not a twin's."""
    width = bundle.task.reset.dynamics if bundle.kind == "twin" else 0.0
    covariance = bundle.base_pose.covariance
    return _error(covariance, width, random) if width and covariance is not None else EXACT


def seen(bundle: TaskBundle, start: Start, views: Mapping[str, View]) -> Variation:
    """The variation of a start with pose errors of these cameras.

    An error depends only on the start's seed, the camera's name and its covariance, so that films of recorded episodes,
    rollouts and Gymnasium have the same pictures of an episode. Cameras have no error in a world that replaces
    hardware, nor has the photograph's camera if the base has one, because one calibration has one error.
    """
    width = bundle.task.reset.visual if bundle.kind == "twin" else 0.0
    cameras = {}
    for name, view in views.items():
        covariance = view.camera_pose.covariance
        if width and covariance is not None and not (view.photographed and any(start.base_error)):
            random = np.random.default_rng(seed_of("camera", start.seed, name))
            cameras[name] = _error(covariance, width, random)
    return start.variation.model_copy(update={"cameras": cameras})


def _factor(random: Draws, width: float) -> float:
    return float(np.exp(width * random.uniform(-1.0, 1.0))) if width else 1.0


def _error(covariance: np.ndarray, width: float, random: Draws) -> Twist:
    """`width` times a pose error with this covariance (6, 6)."""
    drawn = np.array([random.standard_normal() for _ in range(6)])
    values, axes = np.linalg.eigh(covariance)
    x, y, z, a, b, c = (width * axes @ (np.sqrt(np.maximum(values, 0.0)) * drawn)).tolist()
    return x, y, z, a, b, c


def _goal(bundle: TaskBundle, random: Draws) -> Goal | None:
    """The task's goal with its position and rotation drawn within `Reset`; None if nothing is drawn."""
    reset = bundle.task.reset
    if not (reset.goal_m or reset.goal_rad):
        return None
    across = np.asarray(random.uniform(-reset.goal_m, reset.goal_m, 2))
    turn = float(random.uniform(-reset.goal_rad, reset.goal_rad))
    return catalogue.of(bundle.task, bundle.objects).drawn(across, turn)
