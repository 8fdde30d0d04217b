"""Checks that a robot moved between pictures, and that recorded poses and model rotate equally."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.spatial.joints import Joints
from dextera_build.errors import listing
from dextera_build.geometry import poses, transforms
from dextera_build.rule import Context

STILL_M, STILL_RAD = 1e-3, 2e-3
"""Differences below which an effector has not moved."""
TURNED_RAD = float(np.radians(3.0))
"""Largest median difference between rotations of recorded poses and of the model [rad]."""
DEGREE = float(np.pi / 180)


def doubt_poses(ctx: Context, effectors: np.ndarray | None, joints: np.ndarray | None, names: Sequence[str]) -> None:
    """Warn of captures without information: one pose, or a robot that did not move.

    Args:
        ctx: Context for warnings.
        effectors: (K, 7) poses, or None.
        joints: (K, J) positions [rad, m], or None.
        names: Of the K pictures.
    """
    rows = effectors if effectors is not None else joints
    if rows is None:
        return
    if len(rows) == 1:
        ctx.warn("there is one pose only: a hand-eye calibration needs at least 3, turned about different axes")
        return
    same = [names[n] for n in range(1, len(rows)) if _same(rows[n - 1], rows[n], effectors is not None)]
    if same:
        ctx.warn(
            f"the robot has the pose of the previous picture in {listing(same)}: was it recorded for each picture?"
        )


def check_poses(ctx: Context, robot: RobotModel, joints: Joints, effectors: np.ndarray, frame: str) -> None:
    """Raise for joint positions whose forward kinematics contradicts the rotations of the recorded poses.

    The angle between two poses is independent of the base's pose and of the recorded frame of the effector, so that it
    is affected only by wrong order, signs and units.

    Args:
        ctx: Context for errors and warnings.
        robot: The model.
        joints: Positions in its order, (K, J).
        effectors: (K, 7) recorded poses of the effector.
        frame: Link or role of a frame of the model; any other name is not checked.
    """
    if len(effectors) < 3 or frame not in {*robot.links, *robot.frames}:
        return
    from dextera_build.sim.model.forward import Kinematics

    kinematics, wanted = Kinematics(robot), _turns(effectors[:, 3:])

    def off(positions: np.ndarray) -> float:
        """Median difference of the rotation angles at joint positions (K, J) [rad]."""
        found = [poses.from_matrix(each)[3:] for each in kinematics.frames(joints.names, positions, frame)]
        return float(np.median(np.abs(_turns(np.array(found)) - wanted)))

    error = off(joints.positions)
    if error <= TURNED_RAD:
        return
    why = ""
    for text, positions in _hypotheses(joints):
        if off(positions) <= TURNED_RAD:
            why = text
            break
    ctx.fail(
        "the joint positions do not give the recorded poses" + (f": {why}" if why else ""),
        frame=frame,
        turns=f"differ by {np.degrees(error):.1f} deg in the median over {len(wanted)} pairs of poses",
        hint="check order, signs and units of the joints, the stamps of both, and which frame the poses are of",
    )


def _hypotheses(joints: Joints) -> Iterator[tuple[str, np.ndarray]]:
    """Common mistakes, with the positions without them."""
    names, rows = joints.names, joints.positions
    yield "they fit as degrees", DEGREE * rows
    yield "they fit in the reverse order", rows[:, ::-1]
    for one in range(len(names)):
        turned = rows.copy()
        turned[:, one] *= -1
        yield f"they fit with the sign of `{names[one]}` changed", turned
        for other in range(one + 1, len(names)):
            order = list(range(len(names)))
            order[one], order[other] = other, one
            yield f"they fit with `{names[one]}` and `{names[other]}` swapped", rows[:, order]


def _turns(quaternions: np.ndarray) -> np.ndarray:
    """Angles [rad] between all pairs of unit quaternions (K, 4)."""
    one, other = np.triu_indices(len(quaternions), 1)
    cosines = np.abs((quaternions[one] * quaternions[other]).sum(axis=1))
    return np.asarray(2 * np.arccos(np.clip(cosines, 0.0, 1.0)))


def _same(before: np.ndarray, now: np.ndarray, placed: bool) -> bool:
    if not placed:
        return bool(np.abs(now - before).max() < STILL_M)
    moved = transforms.invert(poses.to_matrix(before)) @ poses.to_matrix(now)
    return bool(np.linalg.norm(moved[:3, 3]) < STILL_M and transforms.angle(moved[:3, :3]) < STILL_RAD)
