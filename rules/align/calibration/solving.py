"""From sightings of a board to a calibration: outlier removal, checks, result."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.cameras.calibration import Board, Calibration
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.errors import listing
from dextera_build.geometry import hand_eye, hand_eye_checks, hand_eye_refine
from dextera_build.geometry.hand_eye import Setup, View
from dextera_build.geometry.hand_eye_checks import Checked
from dextera_build.rule import Context

from . import diagnosis, residuals
from .sighting import Picture

if TYPE_CHECKING:
    from .hand_eye import HandEyeOptions

SURE_SIGMAS = 4.0
"""Number of standard deviations at which a board's size contradicts the stated one."""
NOTED = 0.01
"""Relative difference of a board's size above which a warning is given."""


def solve(
    ctx: Context,
    setup: Setup,
    effectors: Mapping[str, np.ndarray],
    seen: Mapping[str, Picture],
    common: HandEyeOptions,
) -> Checked:
    """Initialise, refine, remove inconsistent views, and refuse results that must not be used."""
    given = _usable(ctx, effectors, seen, common)
    _check_motion(ctx, given, setup, common)
    start, views = hand_eye.start(given, setup)
    first = hand_eye_refine.refine(views, setup, start)
    middle = np.median([hand_eye_refine.closing(view, setup, first.solution) for view in views], axis=0)
    if middle[0] > common.most_residual_m or np.degrees(middle[1]) > common.most_residual_deg:
        diagnosis.explain(ctx, given, setup, Checked(first, views, [], []), common)
    found = hand_eye_checks.checked(views, setup, first.solution, common.least_views, common.most_bad)
    fits = residuals.fits(found, setup, common)
    size, sigma = hand_eye_checks.board_scale(found.views, setup, found.refined) if fits else (1.0, 0.0)
    wrong_size = abs(size - 1) > max(SURE_SIGMAS * sigma, common.board_size_fraction)
    if not fits:
        diagnosis.explain(ctx, given, setup, found, common)
    if wrong_size:
        diagnosis.other_size(ctx, views, size, sigma)
    if abs(size - 1) > max(SURE_SIGMAS * sigma, NOTED):
        ctx.warn(f"by the robot's motion the board is {size:.3f} times its stated size, sigma {sigma:.3f}")
    for bad in found.bad:
        ctx.warn(
            f"`{bad.name}` contradicts the other pictures (chance {bad.chance:.1g}) and is left out: "
            "was it taken while the robot moved, or did the camera or the board move?"
        )
    place = float(np.sqrt(np.trace(found.refined.of_x[:3, :3])))
    ctx.check(
        place <= common.most_sigma_m,
        f"the camera's place is known to {1000 * place:.0f} mm only, {1000 * common.most_sigma_m:.0f} mm are allowed",
        hint="add pictures with the board nearer to the camera, and with more rotation about all axes",
    )
    return found


def calibration(found: Checked, setup: Setup, frame: str, camera: Camera, board: Board) -> Calibration:
    """The artifact of a solved problem."""
    solution, covariance = found.refined.solution, found.refined.covariance
    holder, other = (frame, "base") if setup.in_hand else ("base", frame)
    each = np.array([hand_eye_refine.closing(view, setup, solution) for view in found.views])
    offsets = [hand_eye.offsets(solution, view, setup) for view in found.views]
    return Calibration(
        mount="eye_in_hand" if setup.in_hand else "eye_on_base",
        pose=Pose(parent=holder, child="camera", matrix=solution.x, covariance=covariance[:6, :6]),
        effector_frame=frame,
        camera=camera,
        method="Park, refined",
        board=board,
        board_pose=Pose(parent=other, child="board", matrix=solution.y, covariance=covariance[6:, 6:]),
        residuals=each,
        leave_one_out=np.array([[one.shift_m, one.turn_rad] for one in found.left]) if found.left else None,
        reprojection_px=np.array([float(np.sqrt((each**2).sum(axis=1).mean())) for each in offsets]),
    )


def with_joints(
    found: Calibration, solved: Checked, setup: Setup, drifts: Mapping[str, np.ndarray], sigma: float
) -> Calibration:
    """The calibration with encoder zero offsets included in its covariances, see `hand_eye_refine.by_joints`."""
    rows = [drifts[view.name] for view in solved.views]
    more = hand_eye_refine.by_joints(solved.views, setup, solved.refined, rows, sigma)
    poses = {}
    for name, part in (("pose", more[:6, :6]), ("board_pose", more[6:, 6:])):
        pose = getattr(found, name)
        poses[name] = pose.model_copy(update={"covariance": pose.covariance + part})
    return found.model_copy(update=poses)


def _usable(
    ctx: Context, effectors: Mapping[str, np.ndarray], seen: Mapping[str, Picture], common: HandEyeOptions
) -> list[View]:
    """The pictures in which the board was found with consistent corners."""
    views, missing, other = [], {}, {}
    numbers = [picture.sighting.marker for picture in seen.values() if picture.sighting is not None]
    usual = max(numbers, key=numbers.count, default=None)
    for name, picture in seen.items():
        sighting = picture.sighting
        if sighting is None:
            missing[name] = picture.reason()
        elif sighting.marker != usual:
            missing[name] = f"marker {sighting.marker} is seen instead of {usual}"
        elif sighting.rms_px > common.most_corner_px:
            other[name] = sighting
        else:
            views.append(
                View(name, effectors[name], sighting.board, sighting.pixels, sighting.candidates, sighting.orders)
            )
    for name, reason in missing.items():
        ctx.warn(f"`{name}` is left out: {reason}")
    if len(views) < common.least_views and other:
        diagnosis.other_board(ctx, other, common)
    for name, sighting in other.items():
        ctx.warn(f"`{name}` is left out: its corners are {sighting.rms_px:.1f} px from those of the stated board")
    if len(views) < common.least_views:
        ctx.fail(
            f"the board is seen in {len(views)} of {len(seen)} pictures, {common.least_views} are needed",
            **{f"`{name}`": reason for name, reason in list(missing.items())[:6]},
            hint="look at the kind, counts and dictionary of the board; take sharp pictures of the whole board",
        )
    return views


def _check_motion(ctx: Context, views: list[View], setup: Setup, common: HandEyeOptions) -> None:
    """Raise for motion that leaves the solution undetermined."""
    values, axes = hand_eye.turns(views, setup)
    degrees = np.degrees(values)
    if degrees[1] >= common.least_turn_deg:
        return
    about = "(" + ", ".join(f"{part + 0.0:.2f}" for part in np.round(axes[0], 2)) + ")"
    still = degrees[0] < common.least_turn_deg
    message = (
        "the effector hardly turns between the pictures" if still else "the effector turns about one axis only"
    ) + ", which leaves the camera's place open"
    unit = still and diagnosis.too_small(views, setup)
    ctx.fail(
        message + (f": {diagnosis.IN_DEGREES}" if unit else ""),
        **{"rotation by axis": ", ".join(f"{each:.1f}" for each in degrees) + " deg"},
        **({} if still else {"axis": f"{about} of the effector"}),
        views=listing([view.name for view in views]),
        hint=diagnosis.UNIT
        if unit
        else "add pictures in which the effector is turned by 20 to 40 deg about "
        + ("two or more axes" if still else "axes across that one"),
    )
