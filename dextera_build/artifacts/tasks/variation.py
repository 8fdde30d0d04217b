"""Random changes of an episode other than poses, masses, sizes and friction: joints, goal, cameras and light."""

from __future__ import annotations

from pydantic import Field

from dextera_build.artifacts.core.value import Value
from dextera_build.artifacts.tasks.goals import Goal

Twist = tuple[float, float, float, float, float, float]
"""An error of a pose: translation [m], then rotation vector [rad], in the axes of the parent frame."""
EXACT: Twist = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
"""No error."""


class Variation(Value):
    """Changes of one episode; by default nothing changes."""

    damping: dict[str, float] = Field(default_factory=dict)
    """Root body, or `robot`, -> factor on the damping of its joints."""
    joint_friction: dict[str, float] = Field(default_factory=dict)
    """Root body, or `robot`, -> factor on the friction of its joints."""
    goal: Goal | None = None
    """The goal of this episode; None: the task's."""
    cameras: dict[str, Twist] = Field(default_factory=dict)
    """Camera -> error of its pose in the world."""
    exposure: float = 1.0
    """Factor on linear brightness of pictures."""
    light: float = 1.0
    """Factor on the scene's lights."""
    noise: float = 1.0
    """Factor on noise and dropout of cameras."""
