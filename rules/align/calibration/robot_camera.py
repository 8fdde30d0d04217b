"""align.robot_camera: refine a camera calibration by registration of the robot's surface."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from pydantic import Field, NonNegativeFloat, PositiveFloat, PositiveInt

from dextera_build.artifacts.cameras.calibration import Calibration
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.robots.robot_views import RobotViews
from dextera_build.geometry import transforms
from dextera_build.rule import ROUNDING, Context, Fraction, Options, Tolerance, rule

from . import combining


class RobotCameraOptions(Options):
    """Options of align.robot_camera."""

    points: PositiveInt = 4000
    """Number of points of the arm, and of the hand, over all poses: N of Eq. 2."""
    balanced: bool = True
    """Whether arm and hand have equal weight; False weights all points equally, for comparison."""
    exact_model: bool = False
    """Whether the model is taken as exact and the given calibration as a start only, as in Eq. 2 and 3, for comparison;
    plain ICP (`balanced: false`) always does."""
    rounds: PositiveInt = 3
    """Number of renders of the model, each with the calibration of the previous round."""
    tolerance_m: PositiveFloat = 0.04
    """Maximum difference between measured and rendered depth in the first round; halved in each further round [m]."""
    grow_px: PositiveInt = 12
    """Distance outside the rendered outline within which pixels are used in the first round; halved in each further
    round [px]."""
    joint_sigma_deg: NonNegativeFloat = 0.05
    """Standard deviation of the zero offset of each arm joint's encoder, for the covariance [deg]."""
    encoder_sigma_deg: NonNegativeFloat = 0.02
    """Standard deviation of each reading of an arm joint, for the covariance [deg]."""
    surface_sigma_m: NonNegativeFloat = 0.001
    """Standard deviation of the unknown offset of a link's measured surface from its model [m]."""
    least_chance: Fraction = 0.001
    """Minimum probability of the difference between both calibrations, by their covariances. Below it, they contradict
    each other, and the given calibration is returned."""
    least_overlap: Fraction = 0.3
    """Minimum fraction of the rendered robot with measured depth."""
    most_residual_m: PositiveFloat = 0.008
    """Maximum root mean square residual of arm or hand [m]."""
    most_correction_m: PositiveFloat = Field(0.06, le=1.0)
    """Maximum correction: root mean square displacement of the robot's visible points [m]."""


@dataclass(frozen=True)
class Refinement:
    """Result of a backend."""

    camera_base: np.ndarray  # (4, 4) T_camera_base
    covariance: np.ndarray  # (6, 6) covariance of it, in the camera frame
    residuals: dict[str, np.ndarray]  # `arm` and `hand` -> (K,) root mean square per pose [m]; NaN if not seen
    overlap: np.ndarray  # (K,) fraction of the rendered robot with agreeing depth
    shift_m: float  # root mean square motion of the robot's points
    offsets: dict[str, float] = field(default_factory=dict)  # `arm` and `hand` -> surface outside the model, mean [m]
    cost: np.ndarray | None = None  # (6, 6) W: e.T @ W @ e is the mean squared motion of its points by a twist e [m2]


class RefinementBackend(Protocol):
    """Interface of a backend of align.robot_camera."""

    def refine(
        self,
        ctx: Context,
        views: RobotViews,
        robot: RobotModel,
        camera_base: np.ndarray,
        common: RobotCameraOptions,
        options: Any,
    ) -> Refinement:
        """T_camera_base (4, 4) from the robot's surface and a first estimate."""
        ...


@rule(version=3, packages=("numpy", "scipy"), memory_gb=2.0, tolerance=Tolerance({"": ROUNDING}))
def robot_camera(
    ctx: Context[RefinementBackend],
    views: RobotViews,
    robot: RobotModel,
    calibration: Calibration,
    *,
    options: RobotCameraOptions | None = None,
) -> Calibration:
    """Return the calibration with T_base_camera refined by morphology-balanced ICP on the robot's surface [m].

    Eq. 2 and 3 of the paper: visible points of the model are registered to the measured depth, arm to arm and hand to
    hand, with equal numbers, all poses together; dT is applied from the left to T_camera_base. Offsets of the links'
    surfaces, encoder zeros and readings are unknowns of the last step. The result is combined with the given
    calibration by covariance intersection: a surface that proves nothing more leaves that calibration as it is.
    """
    options = options or RobotCameraOptions()
    _check(ctx, views, calibration)
    before = transforms.invert(calibration.pose.matrix)
    found = ctx.backend.refine(ctx, views, robot, before, options, ctx.backend_options)
    _gate(ctx, views, found, options)
    combined = combining.combined(
        ctx, calibration, found.camera_base, found.covariance, found.cost, options.least_chance
    )
    refined = calibration.model_copy(update={"pose": combined.pose.inverse(), "method": combined.method})
    rms = {name: 1000 * float(np.sqrt(np.nanmean(each**2))) for name, each in found.residuals.items()}
    for name, value in rms.items():
        ctx.metric(f"{name} residual", value, "mm")
    for name, value in found.offsets.items():
        ctx.metric(f"{name} surface", 1000 * value, "mm")
    ctx.metric("shift", 1000 * found.shift_m, "mm")
    ctx.metric("weight", combined.weight)
    sigma = refined.pose.sigma() or (0.0, 0.0)
    ctx.metric("sigma", 1000 * sigma[0], "mm")
    told = ", ".join(f"{name} {value:.1f} mm" for name, value in rms.items())
    ctx.say(
        f"robot moved by {1000 * found.shift_m:.1f} mm in {len(views.captures)} poses with weight "
        f"{combined.weight:.2f}, residuals {told}, sigma {1000 * sigma[0]:.1f} mm and {np.degrees(sigma[1]):.2f} deg"
    )
    return refined


def _check(ctx: Context, views: RobotViews, calibration: Calibration) -> None:
    ctx.check(
        calibration.mount == views.mount == "eye_on_base",
        "a camera on the hand does not see the arm, so the robot's surface cannot refine its pose",
        hint="use the calibration of `align.hand_eye`",
    )
    if views.joints is None:
        ctx.fail("the joint positions are not known", hint="record the joint states with the pictures")
    without = [name for name, capture in views.captures.items() if capture.measured is None]
    if without:
        ctx.fail(
            f"{len(without)} of {len(views.captures)} pictures have no depth",
            pictures=", ".join(without[:6]),
            hint="record the depth of the calibration pictures, or use the calibration of `align.hand_eye`",
        )


def _gate(ctx: Context, views: RobotViews, found: Refinement, options: RobotCameraOptions) -> None:
    names = list(views.captures)
    low = [name for name, part in zip(names, found.overlap, strict=True) if part < options.least_overlap]
    ctx.check(
        len(low) < len(names),
        "the robot is not where the calibration has it: hardly any measured depth agrees with its model",
        overlap=f"{found.overlap.max():.0%} at most, {options.least_overlap:.0%} are needed",
        hint="look at the joint names and units and at the first calibration, or raise `tolerance_m`",
    )
    for name in low:
        ctx.warn(f"`{name}`: only {found.overlap[names.index(name)]:.0%} of the robot agrees with the measured depth")
    for part, each in found.residuals.items():
        rms = float(np.sqrt(np.nanmean(each**2)))
        worst = names[int(np.nanargmax(each))]
        ctx.check(
            rms <= options.most_residual_m,
            f"the {part} is {1000 * rms:.1f} mm from the measured depth",
            allowed=f"{1000 * options.most_residual_m:.0f} mm",
            worst=f"`{worst}`, {1000 * np.nanmax(each):.1f} mm",
            hint="look whether the model is this robot, and whether pictures and joints are of one moment",
        )
        if np.nanmax(each) > 3 * np.nanmedian(each) + 0.001:
            ctx.warn(f"`{worst}`: the {part} is {1000 * np.nanmax(each):.1f} mm off, more than in the other poses")
    ctx.check(
        found.shift_m <= options.most_correction_m,
        f"the robot would move by {1000 * found.shift_m:.0f} mm",
        believed=f"{1000 * options.most_correction_m:.0f} mm",
        hint="calibrate with `align.hand_eye` again, or raise `most_correction_m`",
    )
