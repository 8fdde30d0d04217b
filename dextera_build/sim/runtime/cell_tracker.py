"""The tracker of a cell, with what is known about the robot: its pixels, and the objects that move with its hands.

Simulated cells and the tracker of a robot use it alike; it reads pictures, encoders and the twin, never a true pose.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from contextlib import ExitStack
from typing import Self

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.robots.cell import Cell
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.geometry import poses, transforms
from dextera_build.policy.observation import Measurement
from dextera_build.sim.render.robot_pixels import RobotPixels
from dextera_build.sim.runtime.measured_state import Hold, MeasuredState
from dextera_build.tracking.model import Model
from dextera_build.tracking.tracked_object import Tracked
from dextera_build.tracking.tracker import Tracker

Found = Mapping[str, Tracked]
PHOTOGRAPHED = 5
"""Number of frames of the photographed scene from which the tracker learns the appearance of its objects."""
AWAY_S = 10.0
"""Time between the photograph and the next frame, in which objects are moved, unseen [s]."""


class CellTracker:
    """Tracks the objects of a task; a context manager, because it holds a GL context.

    Args:
        cell: Its assets and its calibration.
        bundle: The task, whose objects stand in the order of measurements.
        names: Objects to track, of `bundle.objects`.
        twin: The task in the twin, for the robot's pixels and for carried objects; None: without these.
        camera: Intrinsics of the frames; None: those of the cell.
    """

    def __init__(
        self,
        cell: Cell,
        bundle: TaskBundle,
        names: Collection[str],
        twin: TaskBundle | None = None,
        camera: Camera | None = None,
    ) -> None:
        self.cell, self.camera = cell, camera or cell.camera
        self.names = tuple(name for name in bundle.objects if name in names)
        bodies = {name: cell.assets[name].body for name in self.names}
        self._models = {name: Model.of(body, body.residual_m) for name, body in bodies.items()}
        base = transforms.invert(bundle.base_pose.matrix)
        self._photographed = {name: base @ cell.assets[name].pose.matrix for name in bundle.objects}
        self._row = {name: number for number, name in enumerate(bundle.objects)}
        self._columns = _columns({name: len(thing.joints) for name, thing in bundle.objects.items()})
        self._twin = twin
        self.mirror = None if twin is None else MeasuredState(twin)
        """The twin in the measured state; None without a twin."""
        self._held = ExitStack()
        self.reset()

    def __enter__(self) -> Self:
        """Open the renderer of the robot."""
        if self._twin is not None:
            self._robot = self._held.enter_context(RobotPixels(self._twin, self.camera, self.cell.mount.matrix))
        return self

    def __exit__(self, *error: object) -> None:
        """Close it."""
        self._held.close()

    def reset(self) -> None:
        """Forget all frames: every object is where it was photographed."""
        self._tracker = Tracker(self._models, self.camera.matrix())
        self._tracker.start({name: self.cell.mount.matrix @ self._photographed[name] for name in self.names})
        self._hold: Hold | None = None

    def photographed(self, joints: np.ndarray) -> Measurement:
        """A measurement of the photographed objects, with positions (A,) of the robot's joints [rad or m]."""
        bodies = [self.cell.assets[name].body for name in self._row]
        return Measurement(
            joints,
            np.array([poses.from_matrix(pose) for pose in self._photographed.values()]),
            np.array([joint.position for body in bodies for joint in body.joints]),
        )

    def step(self, rgb: np.ndarray, depth: np.ndarray, stamp: float, known: Measurement) -> Found:
        """Track all objects in a new frame of the camera, which stands.

        Args:
            rgb: (H, W, 3) uint8 sRGB.
            depth: (H, W) image-plane z [m], registered to `rgb`; 0 where nothing was measured.
            stamp: Time [s], later than before.
            known: Positions of the robot's joints at that time, and what is known so far of the objects.
        """
        robot = None if self._twin is None else self._robot.mask(known.joints, depth)
        found = self._tracker.step(rgb, depth, stamp, moved=np.eye(4), robot=robot, carried=self._carried(known))
        if self.mirror is not None:
            gripped = Measurement(known.joints, known.objects.copy(), known.displacement)
            self.put(found, gripped, joints=False)
            self._hold = self.mirror.hold(gripped)
        return found

    def put(self, found: Found, measured: Measurement, *, joints: bool = True) -> None:
        """Write the poses that were found, in the base frame, into a measurement; without a pose, it is kept.

        Args:
            found: Result of `step`.
            measured: Is changed.
            joints: Whether positions of the objects' joints are written, too.
        """
        for name, tracked in found.items():
            if tracked.pose is not None:
                measured.objects[self._row[name]] = poses.from_matrix(self.cell.placed(tracked.pose))
                if joints:
                    measured.displacement[self.columns(name)] = tracked.joints

    def row(self, name: str) -> int:
        """Row of an object in `Measurement.objects`."""
        return self._row[name]

    def columns(self, name: str) -> slice:
        """Columns of an object's joints in `Measurement.displacement`."""
        return self._columns[name]

    def _carried(self, known: Measurement) -> dict[str, np.ndarray] | None:
        """Motion of the objects since the last frame if they moved with the hand around them, in the camera frame."""
        if self.mirror is None or self._hold is None:
            return None
        mount = self.cell.mount.matrix
        moved = self._hold.carried(self.mirror.hold(known))
        return {name: mount @ motion @ transforms.invert(mount) for name, motion in moved.items()}


def _columns(counts: Mapping[str, int]) -> dict[str, slice]:
    """Columns of `Measurement.displacement` of each object, from the numbers of joints."""
    found, first = {}, 0
    for name, count in counts.items():
        found[name] = slice(first, first + count)
        first += count
    return found
