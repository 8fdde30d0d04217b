"""The steps of an episode as LeRobot's features and columns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.artifacts.episode import Episode, Episodes

POSE = ("x", "y", "z", "qw", "qx", "qy", "qz")
"""Components of a pose in the robot's base frame: metres, unit quaternion."""
FORCE = ("fx", "fy", "fz")


@dataclass(frozen=True)
class Feature:
    """One column of the data set."""

    dtype: str
    names: tuple[str, ...] | None
    """Names of the components; None: an unnamed number."""

    @property
    def width(self) -> int:
        """Numbers per step."""
        return len(self.names) if self.names else 1

    def facts(self) -> dict[str, object]:
        """The feature's entry in `meta/info.json`."""
        return {"dtype": self.dtype, "shape": [self.width], "names": list(self.names) if self.names else None}


def features(episodes: Episodes, goal: tuple[str, ...]) -> dict[str, Feature]:
    """Features by name, without empty ones.

    LeRobot's policies use features whose names start with `observation` or `action`, so other features are named
    differently: `executed_action` is `action` with noise as sent, `target.hand` the palm pose for `action`, of several
    limbs one after the other, `privileged.contact` the force on the fingertips.

    Args:
        episodes: Names and shapes of the channels.
        goal: Names of the goal's components.
    """
    objects = tuple(f"{name}.{part}" for name in episodes.object_names for part in POSE)
    forces = tuple(f"{name}.{part}" for name in episodes.tip_names for part in FORCE)
    limbs = episodes.limb_names
    hands = POSE if len(limbs) == 1 else tuple(f"{name}.{part}" for name in limbs for part in POSE)
    vectors = {
        "observation.state": episodes.joint_names,
        "observation.environment_state": (*objects, *episodes.displacement_names),
        "observation.goal": goal,
        "action": episodes.joint_names,
        "executed_action": episodes.joint_names,
        "target.hand": hands,
        "privileged.contact": forces,
    }
    found = {name: Feature("float32", parts) for name, parts in vectors.items() if parts}
    found |= {"next.done": Feature("bool", None), "next.success": Feature("bool", None)}
    found["timestamp"] = Feature("float32", None)
    return found | {name: Feature("int64", None) for name in ("frame_index", "episode_index", "index", "task_index")}


def columns(rate_hz: float, episode: Episode, number: int, first: int) -> dict[str, np.ndarray]:
    """Arrays (T, N) by feature; including features without components.

    Args:
        rate_hz: Steps per second.
        episode: The episode.
        number: Its index among the kept episodes.
        first: Number of steps in the episodes before it.
    """
    steps = len(episode.joints)
    frame = np.arange(steps)
    last = frame == steps - 1
    values: dict[str, np.ndarray] = {
        "observation.state": episode.joints,
        "observation.environment_state": np.concatenate(
            [episode.objects.reshape(steps, -1), episode.displacement], axis=1
        ),
        "observation.goal": np.tile(episode.goal, (steps, 1)),
        "action": episode.action,
        "executed_action": episode.executed,
        "target.hand": episode.hand.reshape(steps, -1),
        "privileged.contact": episode.contact.reshape(steps, -1),
        "next.done": last,
        "next.success": last & episode.success,
        "timestamp": (frame / rate_hz).astype(np.float32),
        "frame_index": frame,
        "episode_index": np.full(steps, number),
        "index": first + frame,
        "task_index": np.zeros(steps, np.int64),
    }
    return {name: value.reshape(steps, -1) for name, value in values.items()}
