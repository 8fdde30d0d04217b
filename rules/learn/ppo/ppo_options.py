"""Options of learn.ppo."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from dextera_build.artifacts.robots.robot import Group
from dextera_build.policy import contract as contracts
from dextera_build.rule import Options


class PpoOptions(Options):
    """Options of learn.ppo."""

    inputs: tuple[str, ...] = ("joints", "previous_action", "objects", "displacement", "goal")
    """Input channels of the deployable observation; `joints` and `previous_action` are required."""
    privileged: bool = False
    """Whether the policy sees what its critic sees: contact forces, velocities, the surface of the object. It is then a
    teacher, which acts in simulation only; `demonstrate.teach` has it correct a student."""
    groups: tuple[Group, ...] = ("arm",)
    """Groups of controlled joints; all others are fixed as in `grip`."""
    closes: bool | None = None
    """Whether one decision per hand closes its fingers, from the open to the closed posture of `grip`; None: if hands
    carry the object, as in a lift. Joints of a group are controlled one by one instead."""
    control: Literal["palm", "joints"] = "palm"
    """Control of the arm: by steps of the palm with fixed orientation, or joint by joint."""
    step_m: float = Field(0.15, gt=0.0)
    """Maximum step of the palm per decision and axis [m]; light and slippery objects must be pushed quickly."""
    turn_rad: float | None = Field(None, ge=0.0)
    """Maximum rotation of the palm per decision about each axis of the base [rad]; 0: its orientation is fixed; None:
    0.3 if hands carry the object to an orientation that the goal names, otherwise 0."""
    grip: str | None = None
    """Posture of the fingers, one of the robot's grips; None: the first suitable one, otherwise home."""
    lean_rad: float = Field(0.4, ge=-1.6, le=1.6)
    """Tilt of the fingers from straight down towards the push [rad]."""
    every: int = Field(4, ge=1)
    """Control periods per decision."""
    step_rad: float = Field(0.35, gt=0.0)
    """Maximum change of a joint target per decision [rad]."""
    lead_rad: float = Field(0.5, gt=0.0)
    """Maximum lead of a joint target over its joint [rad]; bounds the pushing force."""
    width: int = Field(128, ge=1)
    """Features of a layer, of the policy and of its critic."""
    layers: int = Field(2, ge=1)
    """Number of layers."""
    steps: int = Field(80_000, ge=1)
    """Total decisions of the training, over all worlds."""
    worlds: int = Field(8, ge=1)
    """Number of worlds in which the policy practises at once."""
    threads: int = Field(1, ge=1)
    """Threads that step the worlds; a build counts on one, and the result is the same for any number."""
    rollout: int = Field(32, ge=1)
    """Decisions per world between two updates."""
    batch: int = Field(128, ge=2)
    """Decisions per gradient step."""
    epochs: int = Field(10, ge=1)
    """Passes over a rollout."""
    rate: float = Field(1e-3, gt=0.0)
    """Initial learning rate of Adam; decays to a tenth."""
    discount: float = Field(0.98, gt=0.0, le=1.0)
    """Discount factor per decision."""
    entropy: float = Field(0.0, ge=0.0)
    """Weight of the policy's entropy."""
    spread: float = Field(0.3, gt=0.0)
    """Initial standard deviation of decisions."""
    average: float = Field(0.97, ge=0.0, lt=1.0)
    """Decay per update of the running average of weights that forms the policy."""
    curriculum: int = Field(1, ge=1)
    """Steps in which the ranges of starts widen to those of the task, each once `passing` is reached; 1: no steps."""
    passing: float = Field(0.6, gt=0.0, le=1.0)
    """Share of the latest episodes that must succeed, while exploring, before the ranges widen."""
    seed: int = Field(0, ge=0)
    """Seed of initial weights, exploration and starts."""

    @model_validator(mode="after")
    def _deployable(self) -> PpoOptions:
        contracts.check_inputs(self.inputs, contracts.VECTORS)
        for name in ("joints", "previous_action"):
            if name not in self.inputs:
                raise ValueError(f"the policy moves targets by steps and needs `{name}`; add it to `inputs`")
        return self
