"""Object-centric trajectory synthesis: one demonstration, adapted to the object's current pose (Eq. 4 of the paper).

Segments that belong to a body keep the palm's pose relative to that body's frame F (Eq. 4a); the motion between is
interpolated, positions by LERP (4b) and rotations by SLERP (4c), timed by speed instead of a fixed number of steps;
noise (4d) perturbs the executed command, never the label. This is not a screw motion.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from dextera_build.artifacts.tasks.episode import Episode, Episodes, Segment, Start
from dextera_build.geometry import transforms
from dextera_build.geometry.poses import to_matrix
from dextera_build.sim.control.operator import Aim, Command, State
from dextera_build.sim.experts.acting import acting
from dextera_build.sim.experts.drive import Driver
from dextera_build.sim.experts.filters import Filters
from dextera_build.sim.experts.motion import between, minimum_jerk
from dextera_build.sim.experts.noise import Noise
from dextera_build.sim.runtime.environment import Environment

ALIKE_M, ALIKE_RAD = 0.04, 0.5
"""Maximum distance between the palms of demonstrations with the same grasp [m, rad]."""


@dataclass(frozen=True)
class Timing:
    """Speed of interpolated motion."""

    speed_m_s: float = 0.35
    """Speed of the palm [m/s]."""
    turn_rad_s: float = 1.2
    """Angular speed of the palm [rad/s]."""


def transfer(poses: np.ndarray, source_frame: np.ndarray, new_frame: np.ndarray) -> np.ndarray:
    """Eq. 4a: T_new(t) = T_F_new (T_F_src)^-1 T_src(t).

    Args:
        poses: (T, 4, 4) T_src(t), the palm in the source.
        source_frame: (4, 4) T_F_src.
        new_frame: (4, 4) T_F_new, in the same base as the others.
    """
    return np.asarray((new_frame @ transforms.invert(source_frame)) @ poses)


def bent(path: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Bend a free motion to lead from `start` to `end` (Eq. 4b and 4c).

    Every waypoint interpolates between the path moved to `start` and the path moved to `end`, by its fraction of the
    path's length; an arc around an obstacle stays an arc.

    Args:
        path: (N, 4, 4) demonstrated poses.
        start: (4, 4) new first pose.
        end: (4, 4) new last pose.
    """
    first, last = start @ transforms.invert(path[0]), end @ transforms.invert(path[-1])
    length = np.concatenate([[0.0], np.cumsum(_lengths(path))])
    parts = length / length[-1] if length[-1] > 0 else np.linspace(0.0, 1.0, len(path))
    return np.array([between(first @ pose, last @ pose, part) for pose, part in zip(path, parts, strict=True)])


def slowed(shown: np.ndarray, path: np.ndarray) -> float:
    """Factor, at least 1, by which `path` is slowed so that no step is faster than in `shown`, (N, 4, 4) each."""
    return max(1.0, float(_lengths(path).max() / max(_lengths(shown).max(), 1e-9)))


def _lengths(path: np.ndarray) -> np.ndarray:
    """Lengths of steps (N - 1,); metres and radians count equally, as for a point one metre from the palm."""
    turns = [transforms.angle(one[:3, :3].T @ other[:3, :3]) for one, other in pairwise(path)]
    return np.asarray(np.linalg.norm(np.diff(path[:, :3, 3], axis=0), axis=1) + turns)


def steps_between(first: np.ndarray, last: np.ndarray, rate_hz: float, timing: Timing) -> int:
    """Number of control steps, at least 1, from pose `first` to `last`, (4, 4) each, at the speed limits."""
    seconds = max(
        float(np.linalg.norm(last[:3, 3] - first[:3, 3])) / timing.speed_m_s,
        transforms.angle(first[:3, :3].T @ last[:3, :3]) / timing.turn_rad_s,
    )
    return max(1, int(np.ceil(seconds * rate_hz)))


@dataclass(frozen=True)
class Manner:
    """Settings of the synthesis."""

    noise: Noise = field(default_factory=Noise)
    """Action noise (Eq. 4d)."""
    filters: Filters = field(default_factory=Filters)
    """Limits whose violation discards an episode."""
    timing: Timing = field(default_factory=Timing)
    """Speed of interpolated motion."""
    nearest: int = 3
    """Number of demonstrations with the most similar object pose from which the source is drawn."""


class Synthesis:
    """An operator that repeats a source demonstration relative to the objects' current poses.

    Args:
        source: A successful episode with segments.
        names: Bodies of `source.objects`, in order.
        environment: The task, begun; its current palm, finger targets and control rate are used.
        timing: Speed of interpolated motion.
    """

    def __init__(self, source: Episode, names: Sequence[str], environment: Environment, timing: Timing) -> None:
        self._source, self._names, self._timing = source, list(names), timing
        robot = environment.bundle.robot
        self._columns = acting(source, robot.limb_names)
        self._limbs = [robot.limb_names[column] for column in self._columns]
        joints = [joint.name for joint in robot.joints]
        hands = [[joints.index(name) for name in robot.limbs[limb].hand] for limb in self._limbs]
        self._hand = np.array([number for hand in hands for number in hand], int)
        self._cuts = np.cumsum([len(hand) for hand in hands])[:-1]
        self._palm = np.array([to_matrix(row) for row in environment.palm_poses()[list(self._columns)]])
        self._fingers = environment.previous_action[self._hand]
        self._rate = environment.task.control_hz
        self._objects: Mapping[str, np.ndarray] = {}
        self._commands: Iterator[Command] = iter(())
        self._frames = (np.eye(4), np.eye(4))

    def begin(self, state: State) -> None:
        """Record the objects' poses."""
        self._objects = state.objects
        self._commands = self._walk()

    def command(self, state: State) -> Command | None:
        """The next command; frames of later segments use the objects' poses at that time."""
        self._objects = state.objects
        return next(self._commands, None)

    def _walk(self) -> Iterator[Command]:
        pending: list[Segment] = []
        held = ""
        for segment in self._source.segments:
            if not segment.frame:
                pending.append(segment)
                continue
            # At the object, the object moves with the hand: keep the frame.
            if pending or segment.frame != held:
                self._frames = self._frames_of(segment)
            held = segment.frame
            poses = transfer(self._poses(segment), *self._frames)
            yield from self._connect(pending, poses[0], segment)
            for row, pose in enumerate(poses):
                yield self._at(segment.first + row, pose, segment)
            self._palm, self._fingers = poses[-1], self._finger_rows(segment)[-1]
            pending = []
        # Free motion at the end is relative to its start.
        for segment in pending:
            shown = np.swapaxes(self._poses(segment), 0, 1)
            moved = [transfer(path, path[0], palm) for path, palm in zip(shown, self._palm, strict=True)]
            poses = np.stack(moved, axis=1)
            for row, pose in enumerate(poses):
                yield self._at(segment.first + row, pose, segment)
            self._palm = poses[-1]

    def _connect(self, free: list[Segment], target: np.ndarray, coming: Segment) -> Iterator[Command]:
        """Eq. 4b and 4c from the current palm to `target`, along the demonstrated free motion."""
        if not free:
            yield from self._straight(target, coming)
            return
        shown = np.concatenate([*(self._poses(segment) for segment in free), self._poses(coming)[:1]])
        fingers = np.concatenate([*(self._finger_rows(segment) for segment in free), self._finger_rows(coming)[:1]])
        pairs = list(zip(np.swapaxes(shown, 0, 1), self._palm, target, strict=True))
        path = np.stack([bent(poses, start, end) for poses, start, end in pairs], axis=1)
        steps = len(shown) - 1
        slow = max(slowed(poses, path[:, number]) for number, (poses, _, _) in enumerate(pairs))
        count = max(steps, int(np.ceil(steps * slow)))
        own = self._fingers - fingers[0]
        for step in range(1, count):
            place = steps * step / count
            before, part = int(place), place % 1.0
            fade = 1.0 - step / count
            palms = [between(one, other, part) for one, other in zip(path[before], path[before + 1], strict=True)]
            posture = fingers[before] + part * (fingers[before + 1] - fingers[before]) + fade * own
            yield Command(self._aims(palms, posture), free[-1].name, "", free[-1].contact)

    def _straight(self, target: np.ndarray, coming: Segment) -> Iterator[Command]:
        count = max(steps_between(*pair, self._rate, self._timing) for pair in zip(self._palm, target, strict=True))
        fingers = self._finger_rows(coming)[0]
        for step in range(1, count):
            part = minimum_jerk(step / count)
            palms = [between(*pair, part) for pair in zip(self._palm, target, strict=True)]
            posture = self._fingers + part * (fingers - self._fingers)
            yield Command(self._aims(palms, posture), coming.name, "", coming.contact)

    def _frames_of(self, segment: Segment) -> tuple[np.ndarray, np.ndarray]:
        """T_F_src and T_F_new at the beginning of a segment."""
        place = self._names.index(segment.frame)
        return to_matrix(self._source.objects[segment.first, place]), self._objects[segment.frame]

    def _poses(self, segment: Segment) -> np.ndarray:
        """Palm poses (T, L, 4, 4) of the limbs that move."""
        rows = self._source.hand[segment.first : segment.last, list(self._columns)]
        return np.array([[to_matrix(pose) for pose in row] for row in rows])

    def _finger_rows(self, segment: Segment) -> np.ndarray:
        return self._source.action[segment.first : segment.last, self._hand].astype(np.float64)

    def _at(self, row: int, palms: np.ndarray, segment: Segment) -> Command:
        fingers = self._source.action[row, self._hand].astype(np.float64)
        return Command(self._aims(palms, fingers), segment.name, segment.frame, segment.contact)

    def _aims(self, palms: Sequence[np.ndarray] | np.ndarray, fingers: np.ndarray) -> dict[str, Aim]:
        """Targets by limb from palms (L, 4, 4) and the concatenated finger joints of all moving limbs."""
        parts = zip(self._limbs, palms, np.split(fingers, self._cuts), strict=True)
        return {limb: Aim(palm, part) for limb, palm, part in parts}


def nearest(sources: Sequence[Episode], place: int, state: np.ndarray, keep: int, random: np.random.Generator) -> int:
    """Draw one of the `keep` sources with the object pose nearest to the current one.

    Args:
        sources: Demonstrations.
        place: Index of the task's object in `Episode.objects`.
        state: Current pose of the object (7,).
        keep: Number of candidates.
        random: Source of the draw.
    """
    distances = []
    for source in sources:
        pose = source.objects[0, place]
        turn = 2.0 * np.arccos(np.clip(abs(float(pose[3:] @ state[3:])), 0.0, 1.0))
        distances.append(float(np.linalg.norm(pose[:3] - state[:3])) + 0.1 * turn)
    order = np.argsort(distances, kind="stable")[: max(1, keep)]
    return int(order[int(random.integers(len(order)))])


def alike(sources: Sequence[Episode], names: Sequence[str], limbs: Sequence[str] = ()) -> list[Episode]:
    """The largest set of demonstrations with the same grasp, which avoids contradictory training data.

    Two demonstrations have the same grasp if their palms, at the end of the first contact, have similar poses in the
    contact's frame.

    Args:
        sources: Demonstrations with segments.
        names: Bodies of their `objects`.
        limbs: Limbs of their `hand`.
    """
    holds = [_hold(source, list(names), limbs) for source in sources]
    groups = [[other for other, pose in enumerate(holds) if _near(hold, pose)] for hold in holds]
    largest = max(groups, key=len, default=[])
    return [sources[number] for number in largest]


def _hold(source: Episode, names: list[str], limbs: Sequence[str] = ()) -> np.ndarray:
    touching = [segment for segment in source.segments if segment.contact and segment.frame]
    if not touching:
        return np.eye(4)
    segment = touching[0]
    frame = to_matrix(source.objects[segment.first, names.index(segment.frame)])
    return np.asarray(transforms.invert(frame) @ to_matrix(source.hand[segment.last - 1, acting(source, limbs)[0]]))


def _near(one: np.ndarray, other: np.ndarray) -> bool:
    apart = float(np.linalg.norm(one[:3, 3] - other[:3, 3]))
    return apart < ALIKE_M and transforms.angle(one[:3, :3].T @ other[:3, :3]) < ALIKE_RAD


def synthesise(driver: Driver, sources: Episodes, start: Start, seed: int, manner: Manner) -> Episode:
    """Synthesise one episode from `start`, successful or with the reason why it was discarded.

    Args:
        driver: Driver of the task's environment.
        sources: Successful demonstrations, in `items`; only those with the most common grasp are used.
        start: Start of the episode.
        seed: Seed of the choice of a source and of the noise.
        manner: Noise, filters, timing.
    """
    environment = driver.environment
    environment.begin(start)
    place = list(environment.bundle.objects).index(environment.task.object)
    shown = alike(list(sources.items.values()), sources.object_names, sources.limb_names)
    random = np.random.default_rng([seed, 0])
    chosen = shown[nearest(shown, place, environment.object_poses()[place], manner.nearest, random)]
    operator = Synthesis(chosen, sources.object_names, environment, manner.timing)
    return driver.run(operator, start, origin="synthesis", noise=manner.noise, filters=manner.filters, seed=seed)
