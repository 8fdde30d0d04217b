"""learn.ppo: reinforcement in the task's own simulation (Schulman et al. 2017, arXiv 1707.06347)."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from dextera_build.artifacts.policy import Checkpoint
from dextera_build.artifacts.robot import Group
from dextera_build.artifacts.task import TaskBundle
from dextera_build.errors import listing
from dextera_build.rule import Context, Options, rule

from . import curve_picture
from .practised import Practised
from .reinforcement import contract_of


class PpoOptions(Options):
    """Options of learn.ppo."""

    inputs: tuple[str, ...] = ("joints", "previous_action", "objects", "displacement", "goal")
    """Channels of the deployable observation that the policy gets; `joints` and `previous_action` are needed."""
    groups: tuple[Group, ...] = ("arm",)
    """Joints that it moves; all others stay as in `grip`."""
    control: Literal["palm", "joints"] = "palm"
    """How it moves the arm: by steps of the palm, which keeps its turn, or joint by joint."""
    step_m: float = Field(0.15, gt=0.0)
    """Largest way of the palm by one decision, per axis [m]. What is light and slippery has to be pushed quickly."""
    grip: str | None = None
    """Posture of the fingers, one of the robot's grips; None: the first that suits the task, or else as at home."""
    lean_rad: float = Field(0.4, ge=-1.6, le=1.6)
    """How far the fingers lean from straight down towards where they push [rad]."""
    every: int = Field(4, ge=1)
    """Control periods that one decision holds for."""
    step_rad: float = Field(0.35, gt=0.0)
    """Largest change of a joint target by one decision [rad]."""
    lead_rad: float = Field(0.5, gt=0.0)
    """Farthest that a joint target may be ahead of its joint [rad]; bounds the force on what is pushed."""
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


@rule(version=1, packages=("numpy",), memory_gb=2.0)
def ppo(ctx: Context, bundle: TaskBundle, *, options: PpoOptions) -> Checkpoint:
    """Return a policy that taught itself the task, from what a robot can observe; its critic alone is privileged.

    The training goes on where it was if it is interrupted, and ends with the same weights.
    """
    _check(ctx, bundle, options)
    contract = contract_of(bundle, options, ctx.backend.heading(bundle))
    ctx.check(int(contract.settings["decisions"]) > 0, "the robot has no joints in `groups`", groups=options.groups)
    practised = ctx.backend.practise(ctx, bundle, contract, options)
    ctx.check(len(practised.steps) == len(practised.reward) > 0, "the training has no reward curve")
    _report(ctx, practised)
    return Checkpoint(
        weights=practised.weights,
        contract=contract,
        steps=practised.steps,
        curve=practised.reward,
        curve_name="mean reward of an episode",
    )


def _check(ctx: Context, bundle: TaskBundle, options: PpoOptions) -> None:
    for name in ("joints", "previous_action"):
        if name not in options.inputs:
            ctx.fail(f"the policy moves targets by steps and needs `{name}`", hint=f"add `{name}` to `inputs`")
    if "rgb" in options.inputs:
        ctx.fail("learn.ppo learns from numbers, not from pictures", hint="leave `rgb` out of `inputs`")
    if options.control == "palm" and "palm" not in bundle.robot.frames:
        ctx.fail("the robot has no frame `palm` that could be steered", hint="set `control: joints`")
    grips = bundle.robot.grips
    if options.grip is not None and options.grip not in grips:
        ctx.fail(f"the robot has no grip `{options.grip}`", grips=listing(grips) or "none")


def _report(ctx: Context, practised: Practised) -> None:
    steps, last = practised.steps, int(practised.steps[-1])
    for curve, what in ((practised.reward, "mean reward of an episode"), (practised.success, "share of successes")):
        ctx.preview(
            curve_picture.draw({what: (steps, curve)}, f"{what}, exploring", logarithmic=False),
            f"{what} over {last:,} decisions",
        )
    success = float(practised.success[-1])
    ctx.metric("success while exploring", success)
    ctx.say(f"{last:,} decisions, {practised.episodes:,} episodes, {100 * success:.0f} % success while exploring")
