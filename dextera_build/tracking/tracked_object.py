"""One tracked object: its state, its motion model, and its status."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from dextera_build.geometry import lie
from dextera_build.tracking import camera_motion, judge, landmarks, motions, search, solve
from dextera_build.tracking.appearance import Appearance
from dextera_build.tracking.colours import Colours
from dextera_build.tracking.frame import ROBOT, Frame
from dextera_build.tracking.judge import Gate, Verdict
from dextera_build.tracking.model import Cast, Model, State
from dextera_build.tracking.terms import Look

Measured = tuple[solve.Fit, Verdict, Cast | None]
"""A fit with its agreement with the frame."""
Status = Literal["tracked", "predicted", "lost"]
LEARN_EVERY = 5
"""Interval in frames between updates of its colours."""
ALIKE = 0.5
"""Minimum log-likelihood ratio of the colours of a recovered object, relative to its usual value."""
HIDDEN = 0.9
"""Visible fraction below which the orientation is unreliable, because shading and shadows resemble texture."""
AS_GOOD = 0.02
"""Margin of the score by which a moved pose of such an object must beat a static or carried one."""
WHOLE = 0.6
"""Minimum visible fraction to recover an object by shape and colour alone."""
STILL_M = 0.004
"""Displacement of its corners up to which an object is static [m]."""
STILL_FRAMES = 5
"""Number of frames after which poses are averaged."""
AVERAGED = 50
"""Number of frames over which the pose of a static object is averaged."""
_SLOWER = 0.7
_DRIFT = np.diag([0.01, 0.01, 0.01, 0.05, 0.05, 0.05]) ** 2
"""Covariance added per frame to a pose without a measurement."""


@dataclass(frozen=True)
class Tracked:
    """Estimate of an object at one time."""

    status: Status
    pose: np.ndarray | None
    """T_camera_object (4, 4) [m]; None if it is lost."""
    covariance: np.ndarray | None
    """(6, 6) of a twist, see `geometry.uncertainty`; None if it is lost."""
    joints: np.ndarray
    """Positions (J,) [rad or m]; the last known ones if it is lost."""
    joint_sigmas: np.ndarray
    """Their standard deviations (J,)."""
    visible: float
    """Visible fraction."""
    why: str
    """Reason why it is not measured; empty if it is."""


class Thing:
    """A tracked object.

    Args:
        number: Its number, as in `Frame.owner`.
        model: Its shape.
    """

    def __init__(self, number: int, model: Model) -> None:
        self.number, self.model, self.appearance = number, model, Appearance(number, model)
        self.status: Status = "lost"
        self.state: State | None = None
        self.cast: Cast | None = None
        self.strikes = 0
        self.searched = -np.inf
        self._velocity = np.zeros(6)
        self._covariance = np.eye(6 + len(model.joints))
        self._seen_at = -np.inf
        self._stamp = -np.inf
        self._verdict: Verdict = judge.LOST
        self._why = "it has not been seen"
        self._mean, self._count = np.eye(4), 0
        self._offset, self._odds, self._measured = 0, 0.0, 0

    @property
    def distance(self) -> float:
        """Distance from the camera along its axis [m]."""
        return np.inf if self.state is None else float(self.state.pose[2, 3])

    @property
    def still(self) -> bool:
        """Whether it has been static for some frames."""
        return self._count >= STILL_FRAMES

    @property
    def colours(self) -> Colours:
        """Colour model of the object and its surroundings."""
        return self.appearance.colours

    @property
    def landmarks(self) -> list[landmarks.Landmarks]:
        """Features of its texture."""
        return self.appearance.landmarks

    @property
    def explained(self) -> bool:
        """Whether an occluder explains that it is not visible."""
        return self._verdict.hidden > 0.5 and self._verdict.agreement > 0.3

    def begin(self, state: State) -> None:
        """Set its state in the next frame."""
        self.state, self.status, self._why = state, "predicted", "it has not been seen"
        self._velocity, self._count = np.zeros(6), 0

    def lose(self, why: str) -> None:
        """Drop the pose, but keep it as the first position to search."""
        self.status, self._why, self._count, self.strikes, self.cast = "lost", why, 0, 0, None
        self._velocity = np.zeros(6)

    def predictions(
        self, frame: Frame, ways: camera_motion.Ways | None, camera: np.ndarray | None, held: np.ndarray | None
    ) -> list[State]:
        """Candidate states: in the hand that holds it, at rest, at constant velocity, and from its tracked points."""
        assert self.state is not None
        base = np.eye(4) if camera is None else camera
        resting = State(base @ self.state.pose, self.state.joints)
        passed = min(frame.stamp - self._stamp, 0.2) if np.isfinite(self._stamp) else 0.0
        moving = State(base @ lie.retract(self.state.pose, passed * self._velocity), self.state.joints)
        quick = np.linalg.norm(self._velocity[:3]) > 0.02 or np.linalg.norm(self._velocity[3:]) > 0.1
        found = [moving, resting] if quick else [resting]
        if ways is not None and self.cast is not None:
            by_flow = search.followed(self.model, frame, found[0], self.cast, ways)
            found += [] if by_flow is None else [by_flow]
        return found if held is None else [State(held @ self.state.pose, self.state.joints), *found]

    def orientations(self) -> list[np.ndarray]:
        """Likely orientations (3, 3) R_camera_object for a recovery."""
        assert self.state is not None
        last = self.state.pose[:3, :3]
        axis = last[:, 2]
        angles = np.radians([0.0, 45.0, -45.0, 90.0, -90.0, 180.0])
        return [lie.rotation(axis * angle) @ last for angle in angles]

    def turn(self, of: int, count: int) -> list[int]:
        """The next `count` of `of` indices cyclically, so that a long search tries all."""
        found = [(self._offset + number) % of for number in range(count)]
        self._offset += count
        return found

    def measure(
        self,
        frame: Frame,
        start: State,
        gate: Gate,
        camera: np.ndarray | None,
        *,
        fresh: bool = False,
        again: bool = False,
        held: bool = False,
    ) -> bool:
        """Fit the model to the frame from a start; accept the result if it passes the gate."""
        if fresh:
            self.appearance.learn(frame, start, 1.0)
        look = self.appearance.nearest(start)
        fit = solve.fit(self.model, frame, start, self.colours, look, number=self.number)
        if fit is None:
            self._verdict, self._why = judge.LOST, "outside the picture"
            return False
        verdict, cast = judge.look(self.model, frame, fit.state, self.colours, self.number)
        if (self.still or held) and not again and verdict.visible < HIDDEN:
            fit, verdict, cast = self._stayed(frame, start, look, (fit, verdict, cast))
        why = judge.passes(fit, verdict, gate)
        why = why or (self._doubt(fit, verdict) if again else "")
        if why:
            self._verdict, self._why = verdict, why
            return False
        self._take(frame, fit, camera, again=again)
        self.status, self._verdict, self._why, self.cast = "tracked", verdict, "", cast
        self._odds = verdict.odds if not self._odds else 0.95 * self._odds + 0.05 * verdict.odds
        self._claim(frame)
        self._measured += 1
        if verdict.visible > 0.3 and self._measured % LEARN_EVERY == 0:
            self.appearance.learn(frame, fit.state, 0.2)
        if verdict.visible > 0.4 and not again:
            assert self.state is not None
            self.appearance.remember(frame, self.state, self._covariance[:6, :6])
        return True

    def _stayed(self, frame: Frame, start: State, look: Look | None, moved: Measured) -> Measured:
        """The fit of a static object, unless it has clearly moved."""
        fit = solve.fit(self.model, frame, start, self.colours, look, number=self.number, prior=solve.STANDING)
        if fit is None:
            return moved
        verdict, cast = judge.look(self.model, frame, fit.state, self.colours, self.number)
        return moved if moved[1].score > verdict.score + AS_GOOD else (fit, verdict, cast)

    def _doubt(self, fit: solve.Fit, verdict: Verdict) -> str:
        """Reason why a recovered pose may belong to another object, in words; empty if there is none."""
        if verdict.odds < ALIKE * self._odds:
            return "its colours are hardly seen"
        if not np.isnan(fit.correlation):
            return ""
        # By shape alone, a printed box also fits rotated by half a turn, and a part of a plane fits any other.
        if self.appearance.textured:
            return "from there its texture has not been seen"
        return "" if verdict.visible >= WHOLE else "too little of it is seen"

    def carry(
        self, frame: Frame, state: State, camera: np.ndarray | None, patience_s: float, hidden_s: float, *, held: bool
    ) -> None:
        """Extrapolate without a measurement: at rest, or with decreasing speed; lost after a while."""
        assert self.state is not None
        verdict, _ = judge.look(self.model, frame, state, self.colours, self.number)
        self._verdict = verdict
        waited = frame.stamp - self._seen_at
        if (
            waited > (hidden_s if self.explained and (held or not np.any(self._velocity)) else patience_s)
            or self.status == "lost"
        ):
            base = np.eye(4) if camera is None else camera
            self.state = State(base @ self.state.pose, self.state.joints)
            self.lose(self._why or "it was not seen for long")
            self._stamp = frame.stamp
            return
        self.status, self.cast, self.state = "predicted", None, state
        self._velocity *= _SLOWER
        self._covariance[:6, :6] += _DRIFT
        self._stamp = frame.stamp

    def told(self, stamp: float) -> Tracked:
        """The reported estimate."""
        joints = self.model.at_rest if self.state is None else self.state.joints
        sigmas = np.sqrt(np.diag(self._covariance)[6:])
        if self.status == "lost" or self.state is None:
            return Tracked("lost", None, None, joints, sigmas, 0.0, self._why)
        return Tracked(
            self.status, self.state.pose, self._covariance[:6, :6], joints, sigmas, self._verdict.visible, self._why
        )

    def _take(self, frame: Frame, fit: solve.Fit, camera: np.ndarray | None, *, again: bool) -> None:
        """Accept a measured state: speed, and the average of a static object in front of a static camera."""
        state = fit.state
        base = np.eye(4) if camera is None else camera
        passed = frame.stamp - self._stamp
        speed = np.zeros(6)
        if self.state is not None and np.isfinite(passed) and 0 < passed < 0.5 and self.status == "tracked":
            speed = lie.between(base @ self.state.pose, state.pose) / passed
        standing = camera is not None and np.array_equal(camera, np.eye(4))
        near = motions.displacement(self._mean, state.pose, self.model.corners) < STILL_M
        if standing and near and self._count and not again:
            self._count = min(self._count + 1, AVERAGED)
            step = lie.between(self._mean, state.pose) / self._count
            self._mean = lie.retract(self._mean, step)
        else:
            self._mean, self._count = state.pose, 1
        if self.still:
            state, speed = State(self._mean, state.joints), np.zeros(6)
        self._velocity = 0.6 * speed + 0.4 * self._velocity if np.any(speed) else np.zeros(6)
        self.state, self._covariance = state, fit.spread.covariance(self._count if self.still else 1)
        self._stamp = self._seen_at = frame.stamp

    def _claim(self, frame: Frame) -> None:
        """Mark the pixels that show it."""
        if self.cast is None:
            return
        rows, columns = self.cast.rows, self.cast.columns
        z = frame.depth[np.ix_(rows, columns)]
        shown = self.cast.drawn & (np.abs(z - self.cast.depth) < 0.015)
        side = self.cast.stride
        large = np.repeat(np.repeat(shown, side, axis=0), side, axis=1)
        top, left = rows[0] - side // 2, columns[0] - side // 2
        area = frame.owner[top : top + large.shape[0], left : left + large.shape[1]]
        area[large[: area.shape[0], : area.shape[1]] & (area != ROBOT)] = self.number
