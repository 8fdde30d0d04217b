"""demonstrate.operate by an operator's hands: every take of a recording is retargeted and run in MuJoCo."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field, NonNegativeFloat, PositiveFloat

from dextera_build.artifacts.robots.cell import Corner, Limits
from dextera_build.artifacts.robots.hand_stream import HandStream
from dextera_build.artifacts.tasks.episode import Episode, Episodes
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.artifacts.tasks.term import TermSpec
from dextera_build.policy import layout
from dextera_build.policy.added import of_specs
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.experts.drive import Driver
from dextera_build.sim.experts.filters import Filters
from dextera_build.sim.experts.hand_operator import HandOperator, hands_of, patient
from dextera_build.sim.retarget import motion
from dextera_build.sim.retarget.options import Retargeting
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.runtime.seeds import seed_of

from .attempt_strips import attempt_strips

if TYPE_CHECKING:
    from .operate import OperateOptions

BACKEND = Backend(
    summary="a recording of an operator's hands, retargeted, in MuJoCo; inverse kinematics by mink",
    takes=("recording",),
    packages=("mujoco", "mink", "daqp"),
    extra="learn",
)
_DEFAULT = Retargeting()


class GuardOptions(Options):
    """Limits that a guard enforces on targets, as in a robot's cell."""

    speed: float = Field(1.0, gt=0.0, le=1.0)
    """Fraction of every joint's speed limit that targets may use."""
    workspace_m: tuple[Corner, Corner] | None = None
    """Lowest and highest x, y, z of every palm in the base frame [m]; empty: unlimited."""
    force_n: PositiveFloat | None = None
    """Force on a fingertip at which the robot is stopped and the take has failed [N]; empty: none."""

    def limits(self) -> Limits:
        """The same for a guard."""
        return Limits(**self.model_dump())


class RetargetOptions(Options):
    """How hands of the operator become motion of the robot."""

    enter_m: PositiveFloat = _DEFAULT.enter_m
    """A finger begins to pinch when its tip is nearer to the thumb's than this [m] of the operator."""
    leave_m: PositiveFloat = _DEFAULT.leave_m
    """It ends to pinch when its tip is further from the thumb's than this [m] of the operator."""
    closed_m: PositiveFloat = _DEFAULT.closed_m
    """Distance of the operator's tips at which those of the robot meet [m]."""
    low_pass_hz: NonNegativeFloat = _DEFAULT.low_pass_hz
    """Frequency at which the motion of the fingers is halved in power; 0: no filter [Hz]."""
    scale: PositiveFloat | None = None
    """Metre of the robot's hand per metre of the operator's; empty: by the lengths of their fingers."""
    arm_scale: PositiveFloat = _DEFAULT.arm_scale
    """Metre of a palm per metre of a wrist."""
    heading_deg: float | None = None
    """Angle about z from the operator's axes to the robot's base [deg]; empty: 0 for a recording in frame `base`, else
    the operator's head looks along the base's x axis at its first message."""
    jump_m: PositiveFloat = _DEFAULT.jump_m
    """Displacement of a wrist between two messages that is not followed [m]."""
    jump_deg: PositiveFloat = 25.0
    """Rotation of a wrist between two messages that is not followed [deg]."""

    apart_m: NonNegativeFloat = _DEFAULT.apart_m
    """Distance that arms keep from the rest of the robot, and hands from arms, where the operator would bring them
    nearer; 0: none [m]."""

    limits: GuardOptions | None = None
    """Limits that the guard enforces on the robot; empty: those of the recording's session, or else the joints' own."""

    def constants(self) -> Retargeting:
        """These options in [rad]."""
        given = self.model_dump(exclude={"heading_deg", "jump_deg", "limits"})
        heading = None if self.heading_deg is None else float(np.radians(self.heading_deg))
        return Retargeting(**given, heading_rad=heading, jump_rad=float(np.radians(self.jump_deg)))


def operate(
    ctx: Context,
    bundle: TaskBundle,
    terms: tuple[TermSpec, ...],
    recording: HandStream | None,
    common: OperateOptions,
    options: RetargetOptions,
) -> Episodes:
    """Attempt every take of the recording once, from the start of its seed or from a drawn one."""
    if recording is None:
        ctx.fail(
            "there is no recording of hands to follow", hint="add `recording: $...`, a target that returns a HandStream"
        )
    takes = recording.demonstrations[: common.attempts]
    own, constants = hands_of(bundle.robot), motion.headed(options.constants(), recording)
    environment = Environment(patient(bundle, recording, takes), terms=of_specs(terms, ctx.companion))
    recorded = recording.workplace.limits if recording.workplace is not None else Limits()
    driver = Driver(
        environment, apart_m=constants.apart_m, limits=options.limits.limits() if options.limits else recorded
    )
    filters = Filters(lag_m=common.lag_m, press_n=common.press_n, fingers=True)
    items: dict[str, Episode] = {}
    failures: dict[str, Episode] = {}
    for number, take in enumerate(takes):
        seed = seed_of("operate", common.seed, number) if take.seed is None else take.seed
        start = driver.environment.draw(seed)
        operator = HandOperator(driver.environment, own, recording.during(take), constants)
        episode = driver.run(operator, start, origin="operator", filters=filters, longest_s=operator.longest_s)
        (items if episode.success else failures)[f"{number:05d}"] = episode
        ctx.progress(number + 1, len(takes), f"{len(items)} succeeded")
    return layout.gathered(bundle, items, failures, len(takes), terms)


def strips(
    ctx: Context, bundle: TaskBundle, episodes: Episodes, options: RetargetOptions
) -> list[tuple[str, np.ndarray]]:
    """Film strips of the first success and the first failure."""
    return attempt_strips(bundle, episodes)
