"""The channels that a task bundle or a data set offers to policies, and the names of their components."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from dextera_build import digest
from dextera_build.artifacts.episode import Episode, Episodes, Film
from dextera_build.artifacts.robot import RobotModel
from dextera_build.artifacts.task import TaskBundle, View


@dataclass(frozen=True)
class Layout:
    """The inputs and outputs of policies in one world or one data set."""

    task: str
    """Name of the task."""
    embodiment: str
    """Digest of joint names and limits."""
    rate_hz: float
    """Control rate [Hz]."""
    joints: tuple[str, ...]
    """Components of actions, `joints` and `previous_action`."""
    objects: tuple[str, ...]
    """Rows of `objects`."""
    displacement: tuple[str, ...]
    """Components of `displacement`."""
    goal: tuple[str, ...]
    """Components of `goal`."""
    picture: tuple[int, int] | None = None
    """(height, width) of `rgb` [px], or None without a camera."""

    def names(self, channel: str) -> tuple[str, ...] | None:
        """Names of the components along the first axis of a vector channel, or None for an unknown channel."""
        known = {
            "joints": self.joints,
            "previous_action": self.joints,
            "objects": self.objects,
            "displacement": self.displacement,
            "goal": self.goal,
        }
        return known.get(channel)


def embodiment(robot: RobotModel) -> str:
    """Digest of a robot's action space: names of its joints, in order, and their limits [rad or m]."""
    return digest.of_value([[joint.name, float(joint.lower), float(joint.upper)] for joint in robot.joints])


def of_bundle(bundle: TaskBundle, view: View | None = None, rate_hz: float | None = None) -> Layout:
    """The layout of a task bundle, seen through `view`, at its own rate or at `rate_hz`."""
    task = bundle.task
    return Layout(
        task=task.name,
        embodiment=embodiment(bundle.robot),
        rate_hz=task.control_hz if rate_hz is None else rate_hz,
        joints=tuple(joint.name for joint in bundle.robot.joints),
        objects=tuple(bundle.objects),
        displacement=bundle.displacement_names,
        goal=task.goal.names,
        picture=(view.camera.height, view.camera.width) if view else None,
    )


def of_episodes(episodes: Episodes, goal: tuple[str, ...], film: Film | None = None) -> Layout:
    """The layout of a data set; only the task knows the components of its goal, `goal`."""
    return Layout(
        task=episodes.task,
        embodiment=episodes.embodiment,
        rate_hz=episodes.rate_hz,
        joints=episodes.joint_names,
        objects=episodes.object_names,
        displacement=episodes.displacement_names,
        goal=goal,
        picture=(film.height, film.width) if film else None,
    )


def gathered(
    bundle: TaskBundle, items: Mapping[str, Episode], failures: Mapping[str, Episode], attempts: int
) -> Episodes:
    """Episodes of a task bundle with the names of the components of their arrays.

    Args:
        bundle: The task that they were made in.
        items: Index -> accepted episode.
        failures: Index -> discarded episode.
        attempts: Number of attempts behind both.
    """
    here = of_bundle(bundle)
    return Episodes(
        items=dict(items),
        failures=dict(failures),
        attempts=attempts,
        task=here.task,
        embodiment=here.embodiment,
        rate_hz=here.rate_hz,
        joint_names=here.joints,
        object_names=here.objects,
        displacement_names=here.displacement,
        tip_names=bundle.robot.tips,
        limb_names=bundle.robot.limb_names,
    )
