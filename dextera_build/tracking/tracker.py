"""Frame-to-model tracking of several objects, for recordings and live cameras."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from dextera_build.geometry import transforms
from dextera_build.tracking import camera_motion, judge, landmarks, search
from dextera_build.tracking.frame import ROBOT, Frame
from dextera_build.tracking.judge import Gate
from dextera_build.tracking.model import Model, State
from dextera_build.tracking.tracked_object import Thing, Tracked

FOLLOWED = Gate()
FOUND = Gate(agreement=0.8, visible=0.4, pixels=200.0, correlation=0.5, outline=0.55, sharp=0.5, odds=0.2)


@dataclass(frozen=True)
class Tuning:
    """Parameters of a tracker."""

    gate: Gate = FOLLOWED
    """Requirements for a pose predicted from the previous frame."""
    found: Gate = FOUND
    """Requirements for a recovered pose."""
    patience_s: float = 0.5
    """Time without a measurement after which an object is lost [s]."""
    hidden_s: float = 3.0
    """The same for a static object that is occluded [s]."""
    mask_overlap: float = 0.4
    """Fraction of the object's pixels inside the given mask below which the pose is doubted."""
    strikes: int = 3
    """Number of consecutive frames with a doubted pose after which it is searched again."""


class Tracker:
    """Poses of known objects in the frame of a camera.

    Args:
        models: Name -> object.
        k: (3, 3) intrinsics [px], OpenCV convention.
        tuning: Parameters.
    """

    def __init__(self, models: Mapping[str, Model], k: np.ndarray, tuning: Tuning | None = None) -> None:
        self._k, self._tuning = np.asarray(k, np.float64), tuning or Tuning()
        self.things = {name: Thing(number, model) for number, (name, model) in enumerate(models.items())}
        self._last: Frame | None = None
        self._features: landmarks.Features | None = None

    def start(self, poses: Mapping[str, np.ndarray], joints: Mapping[str, np.ndarray] | None = None) -> None:
        """Set the states of objects in the next frame.

        Args:
            poses: Name -> T_camera_object (4, 4) [m].
            joints: Name -> positions (J,) [rad or m]; by default those of the body.
        """
        for name, pose in poses.items():
            thing = self.things[name]
            at = (joints or {}).get(name, thing.model.at_rest)
            thing.begin(State(np.asarray(pose, np.float64), np.asarray(at, np.float64)))

    def step(
        self,
        rgb: np.ndarray,
        depth: np.ndarray,
        stamp: float,
        *,
        masks: Mapping[str, np.ndarray] | None = None,
        moved: np.ndarray | None = None,
        robot: np.ndarray | None = None,
        carried: Mapping[str, np.ndarray] | None = None,
        budget_s: float | None = None,
    ) -> dict[str, Tracked]:
        """Track all objects in a new frame.

        Args:
            rgb: (H, W, 3) uint8 sRGB.
            depth: (H, W) image-plane z [m], registered to `rgb`; 0 where nothing was measured.
            stamp: Time [s], later than before.
            masks: Name -> (H, W) bool, the object in a video segmentation; an empty mask is ignored.
            moved: T_now_before (4, 4) of the camera frames, if the camera's motion is known; otherwise it is estimated.
            robot: (H, W) bool, pixels of the robot, from its model and its joints, which occlude objects.
            carried: Name -> motion T_now_before (4, 4) in the camera frame of the hand that probably holds the object.
            budget_s: Once it is spent [s], at most one lost object is searched per frame; others wait for later frames.
                None: all are searched, and results are deterministic.

        Returns:
            Name -> current estimate of the object.
        """
        begin = time.monotonic()
        frame = Frame(np.ascontiguousarray(rgb), np.asarray(depth, np.float32), self._k, float(stamp))
        if robot is not None:
            frame.owner[robot] = ROBOT
        ways, camera = self._camera(frame, moved)
        order = sorted(self.things.values(), key=lambda thing: (thing.status == "lost", thing.distance))
        failed, self._features = [], None
        for thing in order:
            mask = None if masks is None else masks.get(self._name(thing))
            held = None if carried is None else carried.get(self._name(thing))
            if not self._follow(thing, frame, ways, camera, mask, held):
                failed.append((thing, mask))
        for place, (thing, mask) in enumerate(sorted(failed, key=lambda each: each[0].searched)):
            if place and budget_s is not None and time.monotonic() - begin > budget_s:
                break
            thing.searched = frame.stamp
            self._search(thing, frame, camera, mask)
        self._last = frame
        return {name: thing.told(frame.stamp) for name, thing in self.things.items()}

    def _name(self, thing: Thing) -> str:
        return next(name for name, each in self.things.items() if each is thing)

    def _camera(self, frame: Frame, moved: np.ndarray | None) -> tuple[camera_motion.Ways | None, np.ndarray | None]:
        """Flow from the last frame, and T_now_before of the scene; None if unknown."""
        if self._last is None:
            return None, None
        known = [thing.cast for thing in self.things.values() if thing.cast is not None and thing.status == "tracked"]
        extra = np.concatenate([np.zeros((0, 2)), *(search.textured(self._last, cast) for cast in known)])
        ways = camera_motion.flow(self._last, frame, extra)
        if moved is not None:
            return ways, np.asarray(moved, np.float64)
        ignored = self._last.owner >= 0
        found = camera_motion.motion(self._last, frame, ways, ignored)
        if found is None:
            far = camera_motion.matched(self._last, frame)
            # Most of the scene may be the objects themselves, all of them static.
            found = camera_motion.motion(self._last, frame, far, ignored)
            found = camera_motion.motion(self._last, frame, far, np.zeros_like(ignored)) if found is None else found
        return ways, found

    def _follow(
        self,
        thing: Thing,
        frame: Frame,
        ways: camera_motion.Ways | None,
        camera: np.ndarray | None,
        mask: np.ndarray | None,
        held: np.ndarray | None,
    ) -> bool:
        """Track one object from the previous frame; returns whether that succeeded."""
        if thing.state is None:
            return False
        fresh = not thing.colours.known
        candidates = thing.predictions(frame, ways, camera, held)
        ranked = candidates
        if len(candidates) > 1:
            ranked = sorted(candidates, key=lambda state: -self._score(thing, frame, state))
        again = thing.status == "lost"
        gate = self._tuning.found if again else self._tuning.gate
        for state in ranked[:2]:
            if thing.measure(frame, state, gate, camera, fresh=fresh, again=again, held=held is not None):
                return not self._doubted(thing, frame, mask)
        tuning = self._tuning
        hidden_s = tuning.hidden_s if held is None else np.inf
        thing.carry(frame, candidates[0], camera, tuning.patience_s, hidden_s, held=held is not None)
        return False

    def _score(self, thing: Thing, frame: Frame, state: State) -> float:
        return judge.look(thing.model, frame, state, thing.colours, thing.number, rays=250)[0].score

    def _doubted(self, thing: Thing, frame: Frame, mask: np.ndarray | None) -> bool:
        """Whether the given mask has been elsewhere for several frames, so that the object counts as lost."""
        thing.strikes = thing.strikes + 1 if self._elsewhere(thing, frame, mask) else 0
        if thing.strikes < self._tuning.strikes:
            return False
        self._give_up(thing, frame)
        return True

    def _elsewhere(self, thing: Thing, frame: Frame, mask: np.ndarray | None) -> bool:
        if mask is None or not mask.any():
            return False
        shown = frame.owner == thing.number
        return float((shown & mask).sum() / max(int(shown.sum()), 1)) < self._tuning.mask_overlap

    def _give_up(self, thing: Thing, frame: Frame) -> None:
        frame.owner[frame.owner == thing.number] = -1
        thing.lose("its mask is elsewhere")

    def _recognised(self, thing: Thing, frame: Frame) -> list[State]:
        """States from the features of a texture, the best first."""
        if not thing.landmarks:
            return []
        self._features = landmarks.features(frame) if self._features is None else self._features
        states = (landmarks.found(each, frame, self._features, thing.model.at_rest) for each in thing.landmarks)
        known = [state for state in states if state is not None]
        return list(search.best(thing.model, frame, known, thing.colours, thing.number, 2))

    def _search(self, thing: Thing, frame: Frame, camera: np.ndarray | None, mask: np.ndarray | None) -> None:
        """Search an object by its texture, around its last pose and in the whole picture."""
        if thing.state is None or not thing.colours.known:
            return
        if thing.status == "predicted" and thing.explained:
            return  # occluded at its last position: a search elsewhere would find similar-looking objects
        for states in (self._recognised(thing, frame), *self._places(thing, frame, mask)):
            for state in states:
                if not thing.measure(frame, state, self._tuning.found, camera, again=True):
                    continue
                if not self._elsewhere(thing, frame, mask):
                    return
                self._give_up(thing, frame)

    def _places(self, thing: Thing, frame: Frame, mask: np.ndarray | None) -> Iterator[list[State]]:
        """The best states around the last pose, then those in the whole picture."""
        assert thing.state is not None
        model, joints = thing.model, thing.state.joints
        middle = transforms.apply(thing.state.pose, model.centre[None])[0]
        turns = thing.orientations()
        near = search.hypotheses(model, search.around(middle), turns[:1], joints)
        near += search.hypotheses(model, [middle], turns[1:], joints)
        yield list(search.best(model, frame, near, thing.colours, thing.number, 2))
        found = search.places(model, frame, thing.colours, thing.number, mask)
        wide = [search.spread()[number] for number in thing.turn(search.TURNS, 12)]
        far = search.hypotheses(model, found, turns, joints) + search.hypotheses(model, found[:2], wide, joints)
        yield list(search.best(model, frame, far, thing.colours, thing.number, 2))
