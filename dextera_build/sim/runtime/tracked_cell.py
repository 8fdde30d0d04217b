"""A simulated world measured as hardware is: frames of one camera, a tracker, and a calibration.

Frames are rendered from the camera's true pose, at its rate and with sensor noise; some are lost, and the tracker's
results arrive after a delay. Until then, and while an object is not found, its last known pose is used; before it was
ever found, the photographed one. The simulator's poses are read only for the comparison in a `Sighting`, which is used
only by evaluations.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Mapping
from contextlib import ExitStack
from typing import Self

import numpy as np

from dextera_build.artifacts.robots.cell import Cell
from dextera_build.artifacts.tasks.episode import Start
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.artifacts.tasks.trials import Sighting
from dextera_build.artifacts.tasks.variation import EXACT
from dextera_build.errors import RuleError, listing
from dextera_build.geometry import poses, transforms
from dextera_build.policy.cell import Guard
from dextera_build.policy.observation import Frames, Measurement
from dextera_build.sim.primitives import catalogue
from dextera_build.sim.render.rendering import Eye
from dextera_build.sim.render.robot_pixels import RobotPixels
from dextera_build.sim.render.sensor import measure_colour, measure_depth
from dextera_build.sim.runtime import starts
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.runtime.measured_state import Hold, MeasuredState
from dextera_build.tracking.model import Model
from dextera_build.tracking.tracked_object import Tracked
from dextera_build.tracking.tracker import Tracker

NOT_FOUND = "the tracker did not find the object"
PHOTOGRAPHED = 5
"""Number of frames of the photographed scene from which the tracker learns the appearance of its objects."""
AWAY_S = 10.0
"""Time in which the objects are moved, unseen [s]."""
WAIT_S = 1.0
"""Time after a trial in which late results of the tracker may still show success [s]."""
CONFIRMED = 5
"""Number of consecutive frames in which an object must be tracked before a trial begins."""

Found = Mapping[str, Tracked]


class TrackedCell:
    """Measures an environment through a cell; a context manager, because it holds a GL context.

    Every trial begins with a new tracker and is independent of earlier ones.

    Args:
        environment: The true world.
        cell: Its camera and tracker.
        names: Objects to track, beside those of the task; other objects keep their photographed poses.
        twin: The task in the twin, for the robot's pixels, carried objects, and success from measurements; None:
            without these.

    Raises:
        RuleError: The cell has no asset of an object.
    """

    names: tuple[str, ...]
    """The tracked objects."""
    _done: bool | None
    """Whether the measurements show success; None if not evaluated yet."""

    def __init__(
        self, environment: Environment, cell: Cell, names: Collection[str], twin: TaskBundle | None = None
    ) -> None:
        self.environment, self.cell = environment, cell
        bundle = environment.bundle
        check(cell, bundle, twin)
        tracked = {*names, *catalogue.concerned(bundle.task, bundle.objects)}
        self.names = tuple(name for name in bundle.objects if name in tracked)
        bodies = {name: cell.assets[name].body for name in self.names}
        self._models = {name: Model.of(body, body.residual_m) for name, body in bodies.items()}
        base = transforms.invert(bundle.base_pose.matrix)
        self._photographed = {name: base @ cell.assets[name].pose.matrix for name in bundle.objects}
        self._row = {name: number for number, name in enumerate(bundle.objects)}
        self._columns = _columns({name: len(thing.joints) for name, thing in bundle.objects.items()})
        self._twin, self._mirror = twin, None if twin is None else MeasuredState(twin)
        self._guard = Guard(cell.limits, bundle.robot, environment.task.control_hz, self._palms)
        self._held = ExitStack()
        self._reset(0)

    def __enter__(self) -> Self:
        """Open the camera."""
        environment, cell = self.environment, self.cell
        pose = environment.bundle.base_pose.matrix @ cell.eye.matrix
        self._eye = self._held.enter_context(Eye(environment.model, cell.camera, pose, samples=1))
        if self._twin is not None:
            self._robot = self._held.enter_context(RobotPixels(self._twin, cell.camera, cell.mount.matrix))
        return self

    def __exit__(self, *error: object) -> None:
        """Close the camera."""
        self._held.close()

    def begin(self, start: Start) -> str:
        """Show the photographed scene to the camera, then that of a start until the objects are found.

        The simulation is paused meanwhile.

        Returns:
            Reason why there can be no trial; empty if the task's object was found.
        """
        self._reset(start.seed)
        self.environment.begin(starts.photographed(self.environment.bundle, self.environment.model))
        scene = self._picture()
        for _ in range(PHOTOGRAPHED):
            self._step(scene, self._clock)
        # The cell's camera already includes a calibration error; an error of the base would be a second one.
        self.environment.begin(start.model_copy(update={"base_error": EXACT}))
        self._clock += AWAY_S
        self._search(self._picture())
        if self._found_s is None:
            return NOT_FOUND
        # The robot waits at rest, so that all results have arrived.
        self._arrive(np.inf)
        self._begun = self._heard = self._clock
        self._guard.begin(self.environment.previous_action)
        if self._mirror is not None:
            self._mirror.begin(self._known())
            self._done = False
        return ""

    def measure(self, frames: Frames | None = None) -> Measurement:
        """Encoder readings, the last poses from the tracker, and the given frames."""
        now = self._now
        if now >= self._clock - 1e-9:
            self._compare(self._step(self._picture(), now))
        self._arrive(now)
        known = self._known(frames)
        if self._mirror is not None and not self._done:
            self._done = self._mirror.judge(known, now - self._begun)
        return known

    def send(self, targets: np.ndarray) -> np.ndarray:
        """Send joint targets (A,) [rad] within the limits of the cell; see `RobotCell`."""
        environment, now = self.environment, self._now
        forces = environment.contact_forces() if self.cell.limits.force_n is not None else np.zeros((0, 3))
        return environment.send(self._guard.passed(targets, forces, now - self._heard))

    @property
    def _now(self) -> float:
        """Time of the cell's clock [s]."""
        return float(self._begun + self.environment.steps * self.environment.period_s)

    def _palms(self, joints: np.ndarray) -> np.ndarray:
        """Positions (L, 3) of the palms in the base at joint positions (A,) [m]."""
        assert self._mirror is not None
        return self._mirror.palms(joints)

    def settle(self) -> None:
        """After a trial, hold the last targets until the measurements show success, or for `WAIT_S`."""
        environment = self.environment
        for _ in range(round(WAIT_S / environment.period_s)):
            if self._done is not False:
                return
            environment.step(environment.previous_action)
            self.measure()

    def _known(self, frames: Frames | None = None) -> Measurement:
        return Measurement(self._encoders(), self._poses.copy(), self._displacement.copy(), frames or {})

    @property
    def sighting(self) -> Sighting:
        """Accuracy of the tracker in the current trial."""
        return Sighting(
            found_s=self._found_s,
            frames=self._frames,
            tracked=len(self._errors),
            distances_m=tuple(error[0] for error in self._errors),
            angles_rad=tuple(error[1] for error in self._errors),
            joints_rad=tuple(error[2] for error in self._errors if np.isfinite(error[2])),
            success=self._done,
        )

    def _encoders(self) -> np.ndarray:
        """Positions (A,) of the robot's joints [rad]."""
        return self.environment.measure().joints

    def _reset(self, seed: int) -> None:
        self._random = np.random.default_rng([seed, self.cell.seed, 3])
        self._tracker = Tracker(self._models, self.cell.camera.matrix())
        assets = self.cell.assets
        self._tracker.start({name: self.cell.mount.matrix @ self._photographed[name] for name in self.names})
        self._poses = np.array([poses.from_matrix(pose) for pose in self._photographed.values()])
        self._displacement = np.array([joint.position for name in self._row for joint in assets[name].body.joints])
        self._waiting: deque[tuple[float, Found]] = deque()
        self._clock = 0.0  # when the next frame is due [s]
        self._begun = 0.0  # when the trial began [s]
        self._heard = 0.0  # when the last frame arrived [s]
        self._found_s: float | None = None
        self._done = None
        self._hold: Hold | None = None
        self._frames, self._errors = 0, list[tuple[float, float, float]]()

    def _picture(self) -> tuple[np.ndarray, np.ndarray]:
        """Colours (H, W, 3) 0..1 and depth (H, W) [m] of the current state, without noise."""
        data = self.environment.data
        return self._eye.rgb(data) / 255.0, self._eye.depth(data).astype(np.float64)

    def _search(self, scene: tuple[np.ndarray, np.ndarray]) -> None:
        """Send frames to the tracker until all objects are found, or the time limit is reached."""
        times = dict.fromkeys(self.names, 0)
        first, object_name = self._clock, self.environment.task.object
        while min(times.values()) < CONFIRMED and self._clock - first < self.cell.search_s - 1e-9:
            stamp = self._clock
            found = self._step(scene, stamp)
            for name, tracked in (found or {}).items():
                times[name] = times[name] + 1 if tracked.status == "tracked" else 0
            if times[object_name] == 0:
                self._found_s = None
            elif self._found_s is None:
                self._found_s = stamp - first

    def _step(self, scene: tuple[np.ndarray, np.ndarray], stamp: float) -> Found | None:
        """Send a frame through the sensor to the tracker, and set the time of the next one; None if it is lost."""
        cell = self.cell
        self._clock += 1.0 / cell.rate_hz
        if self._random.uniform() < cell.loss:
            return None
        depth = measure_depth(scene[1], scene[0], cell.camera.matrix(), cell.depth_noise, self._random)
        rgb = measure_colour(scene[0], cell.colour_noise, self._random)
        robot = None if self._twin is None else self._robot.mask(self._encoders(), depth)
        found = self._tracker.step(rgb, depth, stamp, moved=np.eye(4), robot=robot, carried=self._carried())
        self._grip(found)
        self._waiting.append((stamp + cell.delay_s, found))
        return found

    def _carried(self) -> dict[str, np.ndarray] | None:
        """Motion of the objects since the last frame if they moved with the hand around them, in the camera frame."""
        if self._mirror is None or self._hold is None:
            return None
        mount = self.cell.mount.matrix
        moved = self._hold.carried(self._mirror.hold(self._known()))
        return {name: mount @ motion @ transforms.invert(mount) for name, motion in moved.items()}

    def _grip(self, found: Found) -> None:
        """Record the objects between the fingers in the last tracked frame."""
        if self._mirror is None:
            return
        seen = self._known()
        for name, tracked in found.items():
            if tracked.pose is not None:
                seen.objects[self._row[name]] = poses.from_matrix(self.cell.placed(tracked.pose))
        self._hold = self._mirror.hold(seen)

    def _arrive(self, now: float) -> None:
        """Apply the tracker results that have arrived; without a pose, the last one is kept."""
        while self._waiting and self._waiting[0][0] <= now + 1e-9:
            self._heard, found = self._waiting.popleft()
            for name, tracked in found.items():
                if tracked.pose is not None:
                    self._poses[self._row[name]] = poses.from_matrix(self.cell.placed(tracked.pose))
                    self._displacement[self._columns[name]] = tracked.joints

    def _compare(self, found: Found | None) -> None:
        """Record the error of the measured pose of the task's object."""
        if found is None:
            return
        self._frames += 1
        name = self.environment.task.object
        tracked = found[name]
        if tracked.status != "tracked" or tracked.pose is None:
            return
        truth = self.environment.measure()
        away = transforms.invert(poses.to_matrix(truth.objects[self._row[name]])) @ self.cell.placed(tracked.pose)
        joints = np.abs(tracked.joints - truth.displacement[self._columns[name]])
        self._errors.append(
            (
                float(np.linalg.norm(away[:3, 3])),
                transforms.angle(away[:3, :3]),
                float(joints.max()) if len(joints) else np.nan,
            )
        )


def check(cell: Cell, bundle: TaskBundle, twin: TaskBundle | None) -> None:
    """Raise for a cell whose tracker lacks an asset, or that cannot enforce its limits.

    Raises:
        RuleError: An asset is missing, or a requirement of a limit: the twin for a workspace, fingertips for a force.
    """
    if cell.limits.force_n is not None and not bundle.robot.tips:
        raise RuleError(
            "a cell that limits the force on fingertips has a robot without any",
            code="DXB-B247",
            facts={"frames": listing(bundle.robot.frames, most=40)},
            hint="leave `force_n` of `limits` out, or add frames `tip_...` to the robot",
        )
    if twin is None and cell.limits.workspace_m is not None:
        raise RuleError(
            "a cell that limits the workspace must know its robot",
            code="DXB-B247",
            hint="give the task in the twin too: `twin: $task`",
        )
    missing = sorted(bundle.objects.keys() - cell.assets.keys())
    if missing:
        raise RuleError(
            f"the tracker of this cell does not know `{missing[0]}`",
            code="DXB-B247",
            facts={"known": listing(cell.assets)},
            hint="make the cell from the assets of the task's twin",
        )


def _columns(counts: Mapping[str, int]) -> dict[str, slice]:
    """Columns of `Measurement.displacement` of each object, from the numbers of joints."""
    found, first = {}, 0
    for name, count in counts.items():
        found[name] = slice(first, first + count)
        first += count
    return found
