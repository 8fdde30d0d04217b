"""A simulated world measured as hardware is: frames of one camera, a tracker, and a calibration.

Frames are rendered from the camera's true pose, at its rate and with sensor noise; some are lost, and the tracker's
results arrive after a delay. Until then, and while an object is not found, its last known pose is used; before it was
ever found, the photographed one. The simulator's poses are read only for the comparison in a `Sighting`, which is used
only by evaluations.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Collection
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
from dextera_build.sim.runtime import starts
from dextera_build.sim.runtime.cell_camera import CellCamera, Picture
from dextera_build.sim.runtime.cell_tracker import AWAY_S, PHOTOGRAPHED, CellTracker, Found
from dextera_build.sim.runtime.environment import Environment

NOT_FOUND = "the tracker did not find the object"
WAIT_S = 1.0
"""Time after a trial in which late results of the tracker may still show success [s]."""
CONFIRMED = 5
"""Number of consecutive frames in which an object must be tracked before a trial begins."""


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

    _done: bool | None
    """Whether the measurements show success; None if not evaluated yet."""

    def __init__(
        self, environment: Environment, cell: Cell, names: Collection[str], twin: TaskBundle | None = None
    ) -> None:
        self.environment, self.cell = environment, cell
        bundle = environment.bundle
        check(cell, bundle, twin)
        self._tracker = CellTracker(cell, bundle, {*names, *catalogue.concerned(bundle.task, bundle.objects)}, twin)
        self.names = self._tracker.names
        """The tracked objects."""
        self._camera = CellCamera(environment, cell)
        self._mirror = self._tracker.mirror
        self._guard = Guard(cell.limits, bundle.robot, environment.task.control_hz, self._palms)
        self._held = ExitStack()
        self._reset(0)

    def __enter__(self) -> Self:
        """Open the camera."""
        self._held.enter_context(self._camera)
        self._held.enter_context(self._tracker)
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
        scene = self._camera.picture()
        for _ in range(PHOTOGRAPHED):
            self._step(scene, self._clock)
        # The cell's camera already includes a calibration error; an error of the base would be a second one.
        self.environment.begin(start.model_copy(update={"base_error": EXACT}))
        self._clock += AWAY_S
        self._search(self._camera.picture())
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
            self._compare(self._step(self._camera.picture(), now))
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
        self._tracker.reset()
        photographed = self._tracker.photographed(np.zeros(0))
        self._poses, self._displacement = photographed.objects, photographed.displacement
        self._waiting: deque[tuple[float, Found]] = deque()
        self._clock = 0.0  # when the next frame is due [s]
        self._begun = 0.0  # when the trial began [s]
        self._heard = 0.0  # when the last frame arrived [s]
        self._found_s: float | None = None
        self._done = None
        self._frames, self._errors = 0, list[tuple[float, float, float]]()

    def _search(self, scene: Picture) -> None:
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

    def _step(self, scene: Picture, stamp: float) -> Found | None:
        """Send a frame through the sensor to the tracker, and set the time of the next one; None if it is lost."""
        cell = self.cell
        self._clock += 1.0 / cell.rate_hz
        if self._random.uniform() < cell.loss:
            return None
        rgb, depth = self._camera.measured(scene, self._random)
        found = self._tracker.step(rgb, depth, stamp, self._known())
        self._waiting.append((stamp + cell.delay_s, found))
        return found

    def _arrive(self, now: float) -> None:
        """Apply the tracker results that have arrived; without a pose, the last one is kept."""
        while self._waiting and self._waiting[0][0] <= now + 1e-9:
            self._heard, found = self._waiting.popleft()
            self._tracker.put(found, Measurement(np.zeros(0), self._poses, self._displacement))

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
        away = transforms.invert(poses.to_matrix(truth.objects[self._tracker.row(name)])) @ self.cell.placed(
            tracked.pose
        )
        joints = np.abs(tracked.joints - truth.displacement[self._tracker.columns(name)])
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
