"""Options of learn.ppo."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from dextera_build.artifacts.robot import Group
from dextera_build.rule import Options


class PpoOptions(Options):
    """Options of learn.ppo."""

    inputs: tuple[str, ...] = ("joints", "previous_action", "objects", "displacement", "goal")
    """Channels of the deployable observation that the policy gets; `joints` and `previous_action` are needed."""
    groups: tuple[Group, ...] = ("arm",)
    """Joints that it moves; all others stay as in `grip`."""
    control: Literal["palm", "joints"] = "palm"
    """How it moves the arm: by steps of the palm, which keeps its turn, or joint by joint."""
    step_m: float = Field(0.15, gt=0.0)
    """Largest step of the palm by one decision, per axis [m]; light and slippery objects have to be pushed quickly."""
    grip: str | None = None
    """Posture of the fingers, one of the robot's grips; None: the first that suits the task, or else as at home."""
    lean_rad: float = Field(0.4, ge=-1.6, le=1.6)
    """How far the fingers lean from straight down towards where they push [rad]."""
    every: int = Field(4, ge=1)
    """Control periods that one decision holds for."""
    step_rad: float = Field(0.35, gt=0.0)
    """Largest change of a joint target by one decision [rad]."""
    lead_rad: float = Field(0.5, gt=0.0)
    """Farthest that a joint target may be ahead of its joint [rad]; bounds the pushing force."""
    width: int = Field(128, ge=1)
    """Features of a layer, of the policy and of its critic."""
    layers: int = Field(2, ge=1)
    """Layers."""
    steps: int = Field(80_000, ge=1)
    """Decisions that are practised, in all environments together."""
    worlds: int = Field(8, ge=1)
    """Environments that are stepped side by side."""
    rollout: int = Field(32, ge=1)
    """Decisions per environment between two updates."""
    batch: int = Field(128, ge=2)
    """Decisions per gradient step."""
    epochs: int = Field(10, ge=1)
    """Passes over a rollout."""
    rate: float = Field(1e-3, gt=0.0)
    """Learning rate of Adam at the start; it falls to a tenth."""
    discount: float = Field(0.98, gt=0.0, le=1.0)
    """Worth of a reward one decision later."""
    entropy: float = Field(0.0, ge=0.0)
    """Weight of the policy's entropy."""
    spread: float = Field(0.3, gt=0.0)
    """Standard deviation of decisions at the start."""
    average: float = Field(0.97, ge=0.0, lt=1.0)
    """The policy is a running average of its weights; an update leaves this share of it."""
    seed: int = Field(0, ge=0)
    """Seed of first weights, exploration and starts."""
