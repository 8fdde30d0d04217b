"""Clocks of camera and robot: offset, overlap, and poses at given times."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.robots.stream import Stream
from dextera_build.artifacts.spatial.joints import Joints
from dextera_build.formats import mcap
from dextera_build.geometry import quaternions, synchronisation
from dextera_build.rule import Context

CORRELATED = 0.6
"""Minimum correlation of motion in pictures and joints at which an offset is estimated."""
ALONE = 0.9
"""Largest correlation at a second offset, relative to the best."""
SURE_S = 0.04
"""Largest standard deviation of an offset that is applied [s]."""
SMALL = 60
"""Width of the reduced pictures [px]: motion remains visible, noise averages out."""


def offset(ctx: Context, stream: Stream, topic: str, joints: Joints, given: float | None, reach_s: float) -> float:
    """Time of the joints minus time of the pictures at the same moment [s]; 0 if it cannot be estimated.

    Args:
        ctx: Context for warnings and metrics.
        stream: Recording of the camera.
        topic: Topic of its pictures.
        joints: Joint states of the robot.
        given: The offset, if it is known [s].
        reach_s: Largest offset that is searched [s].
    """
    if given is not None:
        return given
    stamps, changes = _changes(stream, topic)
    found = synchronisation.clock_offset(stamps, changes, joints.stamps, joints.positions, reach_s)
    if found is None:
        ctx.warn(
            "assuming synchronised clocks of camera and robot: too few pictures were recorded in motion to estimate "
            "their offset"
        )
        return 0.0
    ctx.metric("clock_correlation", found.correlation)
    spelled = f"{1000 * found.seconds:.0f} +- {1000 * found.sigma:.0f} ms"
    if found.correlation < CORRELATED or found.rival > ALONE * found.correlation or found.sigma > SURE_S:
        ctx.warn(
            "assuming synchronised clocks of camera and robot: their offset is not certain "
            f"({spelled}, correlation {found.correlation:.2f}, next best {found.rival:.2f}); `clock_offset_s` sets it"
        )
        return 0.0
    ctx.metric("clock_offset", found.seconds, "s")
    ctx.metric("clock_offset_sigma", found.sigma, "s")
    if abs(found.seconds) > reach_s - 3 * found.sigma:
        ctx.fail(
            "the clocks of camera and robot differ by more than was looked for",
            offset=spelled,
            looked=f"up to {reach_s:g} s",
            hint="set `reach_s` higher, or synchronise the clocks with PTP or NTP",
        )
    if abs(found.seconds) > max(0.02, 3 * found.sigma):
        ctx.warn(f"the clock of the robot is {spelled} ahead of the camera's, which is taken into account")
        return found.seconds
    return 0.0


def check_overlap(ctx: Context, pictures: np.ndarray, joints: np.ndarray) -> None:
    """Raise for recordings of different times; times on the joints' clock [s]."""
    if not len(pictures) or not len(joints):
        ctx.fail("the recording has no pictures" if not len(pictures) else "the recording has no joint states")
    if pictures.min() > joints[-1] or pictures.max() < joints[0]:
        apart = max(pictures.min() - joints[-1], joints[0] - pictures.max())
        ctx.fail(
            "pictures and joint states were not recorded at the same time, or their clocks differ",
            pictures=f"{pictures.min():.3f} to {pictures.max():.3f} s",
            joints=f"{joints[0]:.3f} to {joints[-1]:.3f} s",
            apart=f"{apart:.3f} s",
            hint="synchronise the clocks, or set `clock_offset_s`",
        )


def poses_at(ctx: Context, stamps: np.ndarray, rows: np.ndarray, times: np.ndarray, skew_s: float) -> np.ndarray:
    """(K, 7) poses at times (K,), interpolated between measurements (N, 7) at increasing stamps (N,)."""
    gaps = synchronisation.nearest_gap(times, stamps)
    outside = (times < stamps[0]) | (times > stamps[-1]) | (gaps > skew_s)
    if outside.any():
        ctx.fail(
            "the effector's poses were not recorded at all pictures",
            poses=f"{stamps[0]:.3f} to {stamps[-1]:.3f} s",
            picture=f"{times[outside][0]:.3f} s, {1000 * gaps[outside][0]:.0f} ms from the nearest",
            hint="record poses as often as joint states, or leave `poses` out",
        )
    found = []
    for time in times:
        right = int(np.clip(np.searchsorted(stamps, time), 1, len(stamps) - 1))
        before, after = rows[right - 1], rows[right]
        share = float((time - stamps[right - 1]) / (stamps[right] - stamps[right - 1]))
        turn = quaternions.slerp(before[3:], after[3:], share)
        found.append(np.append((1 - share) * before[:3] + share * after[:3], turn))
    return np.array(found)


def _changes(stream: Stream, topic: str) -> tuple[np.ndarray, np.ndarray]:
    """(N,) times of the pictures in order, and (N - 1,) mean changes from each to the next."""
    stamps: list[float] = []
    changes: list[float] = []
    last: np.ndarray | None = None
    for stamp, pixels in mcap.pictures(stream, topic):
        if stamps and stamp <= stamps[-1]:
            continue
        small = _reduced(pixels)
        if last is not None:
            changes.append(float(np.abs(small - last).mean()))
        stamps.append(stamp)
        last = small
    return np.array(stamps), np.array(changes)


def _reduced(pixels: np.ndarray) -> np.ndarray:
    """Means of square blocks of a picture's green channel."""
    side = max(1, pixels.shape[1] // SMALL)
    rows, columns = pixels.shape[0] // side * side, pixels.shape[1] // side * side
    green = pixels[:rows, :columns, 1].astype(np.float32)
    return np.asarray(green.reshape(rows // side, side, columns // side, side).mean(axis=(1, 3)))
