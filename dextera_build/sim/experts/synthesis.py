"""Object-centric trajectory synthesis: demonstrations, adapted to the objects' current poses (Eq. 4 of the paper).

Segments that belong to a body keep the palm's pose relative to that body's frame F (Eq. 4a); the motion between is
interpolated, positions by LERP (4b) and rotations by SLERP (4c), timed by speed instead of a fixed number of steps;
noise (4d) perturbs the executed command, never the label. This is not a screw motion.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from dextera_build.artifacts.tasks.episode import Episode, Episodes, Start
from dextera_build.geometry import transforms
from dextera_build.geometry.poses import to_matrix
from dextera_build.sim.control.ik import ArmKinematics
from dextera_build.sim.control.operator import BASE, FREE, Command, GaveUp, PoseControl, State
from dextera_build.sim.experts.adapt import Timing, bent, slowed, steps_between, transfer
from dextera_build.sim.experts.drive import Driver
from dextera_build.sim.experts.filters import Filters
from dextera_build.sim.experts.motion import minimum_jerk
from dextera_build.sim.experts.noise import FADE, Noise
from dextera_build.sim.experts.paths import Path
from dextera_build.sim.experts.recovery import Recovery, recovering
from dextera_build.sim.experts.retime import Limits, accelerations, durations, moments, slower
from dextera_build.sim.experts.runs import Run
from dextera_build.sim.experts.soft import overpowered, softened
from dextera_build.sim.experts.sources import Source, nearest, sources_of
from dextera_build.sim.runtime.environment import Environment

LOOSE = 10.0
"""Factor on speed limits while a path is solved for its joints, which retiming needs as it was shown."""
SPARE_SPEED, SPARE_ACCELERATION = 0.95, 0.6
"""Parts of the limits that a retimed path uses; noise needs the rest."""
SPARE_PERTURBED = 0.8
"""Part of the limit of acceleration that a perturbed path uses."""
PARTS = (1.0, 0.7, 0.5, 0.35, 0.25)
"""Parts of a perturbation that are tried."""
SPARE_FINGERS = 0.6
"""Part of their speed limits that fingers use: a thumb that loses the resistance of fingers which open springs forward,
up to 1.5 times as fast as they are moved."""
REVISIONS = 8
"""Maximum number of times that a path is retimed."""
PATIENCE, HOPELESS = 3, 1.7
"""Revisions after which a path is given up that is still too fast by the square of this factor: then a joint is at its
limit or near a singularity, where slower motion does not help."""


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
    recovery: Recovery = field(default_factory=Recovery)
    """Perturbations with a corrective label."""
    soften: bool = False
    """Whether fingers press less in any case, see `soft`."""


@dataclass
class _Planned:
    """The adapted motion of one limb."""

    run: Run
    palms: np.ndarray
    """(T, 4, 4) T_base_palm from the run's first step on."""
    fingers: np.ndarray
    """(T, H) [rad]."""
    least: np.ndarray
    """(T,) shortest durations of the steps to these rows [control periods]."""
    frames: tuple[np.ndarray, np.ndarray]
    """T_F_src and T_F_new (4, 4)."""


class Synthesis:
    """An operator that repeats source demonstrations relative to the objects' current poses.

    At the beginning of every run (see `runs`) its frame is read and its source is chosen, if no other limb is in the
    middle of a run of another source.

    Args:
        sources: Demonstrations with the same structure, the most common grasp first, `sources_of`.
        environment: The task, begun; its current palms, finger targets and control rate are used.
        control: Inverse kinematics of the label, for retiming; None: paths are as fast as they were shown.
        manner: Settings.
        seed: Seed of the episode.
    """

    def __init__(
        self,
        sources: Sequence[Source],
        environment: Environment,
        control: PoseControl | None,
        manner: Manner,
        seed: int,
    ) -> None:
        self._sources, self._control, self._manner = sources, control, manner
        self._random = np.random.default_rng([seed, 0])
        robot, task = environment.bundle.robot, environment.task
        self._limbs, self._object, self._rate = list(robot.limb_names), task.object, task.control_hz
        self._names = [joint.name for joint in robot.joints]
        self._speeds = np.array([joint.velocity for joint in robot.joints])
        self._accelerations = np.array([joint.acceleration for joint in robot.joints])
        most = manner.filters.speed
        judged = sources if np.isfinite(most) else ()
        self._fast = {each.name for each in judged if each.fastest(self._speeds, self._rate) > most}
        self._hands = {limb: [self._names.index(name) for name in robot.limbs[limb].hand] for limb in self._limbs}
        palms = environment.palm_poses()
        self._palms = {limb: to_matrix(palms[row]) for row, limb in enumerate(self._limbs)}
        self._fingers = {limb: environment.previous_action[self._hands[limb]] for limb in self._limbs}
        # Speeds of all joints at the end of the last window; those of limbs that it did not move are 0.
        self._last = np.zeros(len(self._names))
        self._objects: Mapping[str, np.ndarray] = {}
        self._commands: Iterator[Command] = iter(())
        self.used: list[str] = []
        """Names of the demonstrations used so far, in order."""

    def begin(self, state: State) -> None:
        """Record the objects' poses."""
        self._objects = state.objects
        self._commands = self._walk()

    def command(self, state: State) -> Command | None:
        """The next command; frames of later runs use the objects' poses at that time.

        Raises:
            GaveUp: A path cannot be retimed to the limits of the arms.
        """
        self._objects = state.objects
        return next(self._commands, None)

    def _walk(self) -> Iterator[Command]:
        plans: dict[str, _Planned] = {}
        source = self._sources[0]
        perturbed = self._manner.recovery.drawn(self._random)
        self._from_targets()
        for stage in range(len(source.starts)):
            first = source.starts[stage]
            if all(
                plan.run.last <= first or any(run.first == first for run in source.runs if run.limb == limb)
                for limb, plan in plans.items()
            ):
                candidates = self._candidates(source, stage)
            else:
                candidates = [source]
            source, plans, commands = self._adapted(candidates, stage, plans)
            # The hands are empty until the first contact, and nothing is lost if they stray.
            yield from self._perturbed(commands) if perturbed else commands
            perturbed = False

    def _perturbed(self, commands: list[Command]) -> list[Command]:
        """The commands with the largest part of a drawn perturbation that the arms can follow; else unchanged."""
        seed = int(self._random.integers(2**32))
        for part in PARTS if self._control else PARTS[:1]:
            made = list(recovering(commands, self._manner.recovery.times(part), np.random.default_rng(seed)))
            if self._control is None or self._followed(made):
                return made
        return commands

    def _followed(self, commands: Sequence[Command]) -> bool:
        """Whether the arms can follow label and hand from here, with a share of their acceleration left for noise."""
        assert self._control is not None
        limbs = tuple(commands[0].aims)
        arms = self._control.arms(limbs)
        most = SPARE_PERTURBED * self._limits([self._names.index(name) for name in arms.joints]).acceleration
        for followed in ([{**each.aims, **each.off} for each in commands], [each.aims for each in commands]):
            sent = self._joints(arms, [np.array([aims[limb].palm for limb in limbs]) for aims in followed], 1.0)
            if (accelerations(sent, np.zeros(len(arms.joints)), 1.0 / self._rate) > most).any():
                return False
        return True

    def _adapted(
        self, candidates: Sequence[Source], stage: int, plans: Mapping[str, _Planned]
    ) -> tuple[Source, dict[str, _Planned], list[Command]]:
        """The first source that the arms can repeat from here, the plans with its runs, and the commands of its window.

        Raises:
            GaveUp: There is none; the reason is that of the first.
        """
        reasons: list[GaveUp] = []
        for source in candidates:
            first, last = [*source.starts, len(source.episode.action)][stage : stage + 2]
            made = dict(plans)
            for run in (run for run in source.runs if run.first == first):
                made[run.limb] = self._planned(source, run, made)
            active = [plan for plan in made.values() if plan.run.first <= first < plan.run.last]
            try:
                commands = self._window(source, active, first, last)
            except GaveUp as reason:
                reasons.append(reason)
                continue
            if self.used[-1:] != [source.name]:
                self.used.append(source.name)
            return source, made, commands
        raise reasons[0]

    def _from_targets(self) -> None:
        """Begin at the targets of the arms, from which gravity and a previous motion keep the hands a bit away."""
        if self._control is not None:
            for limb in self._limbs:
                arm = self._control.arms((limb,))
                joints = self._control.targets[[self._names.index(name) for name in arm.joints]]
                self._palms[limb] = arm.pose(joints)

    def _candidates(self, last: Source, stage: int) -> list[Source]:
        """Sources of the runs that begin: one drawn by the current pose of their frame, then the others by distance.

        The most common grasp comes first; another one is used only where the arms cannot repeat any demonstration of
        it, because a policy would learn contradictory motions from both. Later, the hand keeps the grasp that it has.
        Within a grasp, those come first in which no joint was faster than the filters allow: fingers that overpower the
        thumb push it, and do so again however slow the motion is.
        """
        runs = [run for run in last.runs if run.first == last.starts[stage]]
        frame = next((run.frame for run in runs if run.frame), BASE)
        frame = self._object if frame == BASE and stage == 0 else frame
        if frame == BASE:
            return [last]
        found: list[Source] = []
        kinds = {source.name: (source.grasp, source.name in self._fast) for source in self._sources}
        for kind in sorted({kind for kind in kinds.values() if stage == 0 or kind[0] == last.grasp}):
            group = [source for source in self._sources if kinds[source.name] == kind]
            shown = [source.pose(frame, source.starts[stage]) for source in group]
            order = nearest(shown, self._objects[frame], self._manner.nearest, self._random)
            found += [group[number] for number in order]
        return found

    def _planned(self, source: Source, run: Run, plans: Mapping[str, _Planned]) -> _Planned:
        episode, limb, column = source.episode, run.limb, self._limbs.index(run.limb)
        shown = np.array([to_matrix(pose) for pose in episode.hand[run.first : run.last, column]])
        fingers = episode.action[run.first : run.last, self._hands[limb]].astype(np.float64)
        free, palm = run.enters - run.first, self._palms[limb]
        frames, least = (shown[0], palm), np.ones(len(shown))
        if run.frame:
            frames = self._frames(source, run, plans)
        palms = transfer(shown, *frames) @ self._regrasped(source, run, shown[0])
        if run.frame and free:
            old, path = shown[: free + 1], bent(shown[: free + 1], palm, palms[free])
            palms[:free], least[: free + 1] = path[:-1], slowed(old, path)
        fade = np.clip(1.0 - np.arange(len(shown)) / max(free, 1), 0.0, 1.0)
        fingers = fingers + fade[:, None] * (self._fingers[limb] - fingers[0]) * (free > 0)
        return _Planned(run, palms, fingers, least, frames)

    def _frames(self, source: Source, run: Run, plans: Mapping[str, _Planned]) -> tuple[np.ndarray, np.ndarray]:
        """T_F_src and T_F_new: coordinated limbs share the transform of the one that is at the frame already."""
        for plan in (plans[limb] for limb in run.limbs if limb in plans and len(run.limbs) > 1):
            if plan.run.frame == run.frame and plan.run.first < run.first < plan.run.last:
                return plan.frames
        now = np.eye(4) if run.frame == BASE else self._objects[run.frame]
        # At the same moment in both: an object in the other hand is still on its way.
        return source.pose(run.frame, run.first), now

    def _regrasped(self, source: Source, run: Run, shown: np.ndarray) -> np.ndarray:
        """T_shown_palm (4, 4) of a hand that holds the object otherwise than shown, and takes it to another frame."""
        if not run.holds or run.frame in (FREE, self._object):
            return np.eye(4)
        held = transforms.invert(source.pose(self._object, run.first)) @ shown
        holds = transforms.invert(self._objects[self._object]) @ self._palms[run.limb]
        return np.asarray(transforms.invert(held) @ holds)

    def _window(self, source: Source, plans: Sequence[_Planned], first: int, last: int) -> list[Command]:
        """Commands of all limbs from `first` to `last`, between which no run begins."""
        limbs = tuple(plan.run.limb for plan in plans)
        rows = [slice(first - plan.run.first, last - plan.run.first) for plan in plans]
        parts = list(zip(limbs, plans, rows, strict=True))
        path = Path(
            limbs,
            np.stack([np.concatenate([self._palms[limb][None], plan.palms[row]]) for limb, plan, row in parts], axis=1),
            tuple(np.concatenate([self._fingers[limb][None], plan.fingers[row]]) for limb, plan, row in parts),
            np.max([plan.least[row] for _, plan, row in parts], axis=0),
            [source.parts(row, self._limbs) for row in range(first, last)],
        )
        if any(plan.run.first == plan.run.enters == first for plan in plans):
            pairs = zip(path.palms[0], path.palms[1], strict=True)
            path = path.led(max(steps_between(*pair, self._rate, self._manner.timing) for pair in pairs))
        else:
            path = path.started()
        try:
            places = self._places(path)
        except GaveUp:
            path = self._in_joints(path)
            places = self._places(path)
        for number, limb in enumerate(limbs):
            self._palms[limb], self._fingers[limb] = path.palms[-1, number], path.fingers[number][-1]
        commands = [path.command(place) for place in places]
        contact = [command.contact for command in commands]
        return [
            replace(command, nears=any(contact[number : number + FADE + 1])) for number, command in enumerate(commands)
        ]

    def _in_joints(self, path: Path) -> Path:
        """The path with its free beginning straight in the arms' joints, away from their limits and singularities.

        Raises:
            GaveUp: There is no free beginning, or the arms do not reach its end.
        """
        assert self._control is not None
        arms, free = self._control.arms(path.limbs), path.free
        first, *_, last = self._joints(arms, path.palms[1 : free + 1], LOOSE) if free else (None, None)
        found = arms.solve(path.palms[free], seed=last) if free else None
        if found is None or not found.reached():
            raise GaveUp("no slower motion keeps the arm within its acceleration")
        parts = [minimum_jerk(step / free) for step in range(free)]
        return path.begun(np.array([arms.poses(first + part * (found.joints - first)) for part in parts]))

    def _places(self, path: Path) -> np.ndarray:
        """Places on the path at the ends of control periods, retimed to the limits of the arms.

        Raises:
            GaveUp: It cannot be.
        """
        if self._control is None:
            return moments(path.least)
        period, arms = 1.0 / self._rate, self._control.arms(path.limbs)
        moved = [self._names.index(name) for name in arms.joints]
        limits, before = self._spared(moved), self._last[moved]
        shown = self._joints(arms, path.palms[1:], LOOSE)
        least = np.maximum(path.least, self._closing(path))
        for revision in range(REVISIONS):
            least = durations(shown, least, limits, before, period)
            places = moments(least)
            # Redundant joints move with time, and otherwise at their limits: look at what will really be sent.
            sent = self._joints(arms, [path.palms_at(place) for place in places], 1.0)
            excess = np.sqrt(accelerations(sent, before, period) / limits.acceleration).max(axis=1)
            if excess.max() <= 1.0:
                break
            if revision + 1 >= PATIENCE and excess.max() > HOPELESS:
                segment = path.command(places[int(excess.argmax())]).segment
                raise GaveUp(f"no slower motion keeps the arm within its acceleration in `{segment}`")
            least = slower(least, places, excess)
        self._check_reached(path, places, arms, sent[1:])
        self._last[:] = 0.0
        self._last[moved] = (sent[-1] - sent[-2]) / period
        return places

    def _check_reached(self, path: Path, places: np.ndarray, arms: ArmKinematics, sent: np.ndarray) -> None:
        """Raise if the palms at targets (M, A) [rad] are too far from the path at places (M,).

        Raises:
            GaveUp: The filter of lag would discard the episode.
        """
        for place, joints in zip(places, sent, strict=True):
            away = arms.poses(joints)[:, :3, 3] - path.palms_at(place)[:, :3, 3]
            if np.linalg.norm(away, axis=1).max() > self._manner.filters.lag_m:
                segment = path.command(place).segment
                raise GaveUp(f"limits of the arm's joints would hold the hand back in `{segment}`")

    def _closing(self, path: Path) -> np.ndarray:
        """Shortest durations (N,) of the steps of a path that the fingers need [control periods]."""
        needed = [
            np.abs(np.diff(fingers, axis=0)) * self._rate / (SPARE_FINGERS * self._speeds[self._hands[limb]])
            for limb, fingers in zip(path.limbs, path.fingers, strict=True)
        ]
        return np.asarray(np.concatenate(needed, axis=1).max(axis=1, initial=0.0))

    def _limits(self, places: Sequence[int]) -> Limits:
        """Limits of some joints, beyond which an episode is discarded."""
        return Limits(self._speeds[places], self._manner.filters.acceleration * self._accelerations[places])

    def _spared(self, places: Sequence[int]) -> Limits:
        """Limits of some joints, to which motions are slowed."""
        limits = self._limits(places)
        return Limits(SPARE_SPEED * limits.speed, SPARE_ACCELERATION * limits.acceleration)

    def _joints(self, arms: ArmKinematics, palms: Sequence[np.ndarray] | np.ndarray, loose: float) -> np.ndarray:
        """Joints (N + 1, A) [rad] from the present targets along palms (N, L, 4, 4), at `loose` times their speeds."""
        assert self._control is not None
        rows = [self._control.targets[[self._names.index(name) for name in arms.joints]]]
        for each in palms:
            posture = self._control.posture(arms, rows[-1])
            rows.append(arms.track(each, rows[-1], loose / self._rate, posture=posture))
        return np.array(rows)


def synthesise(driver: Driver, sources: Episodes, start: Start, seed: int, manner: Manner) -> Episode:
    """Synthesise one episode from `start`, successful or with the reason why it was discarded.

    Args:
        driver: Driver of the task's environment.
        sources: Successful demonstrations, in `items`; those with the most common grasp are used where they can be.
        start: Start of the episode.
        seed: Seed of the choice of sources, of the noise and of the perturbation.
        manner: Noise, filters, timing.
    """
    environment = driver.environment
    environment.begin(start)
    shown = sources_of(sources)
    if manner.soften or overpowered(shown, environment, manner.filters.speed):
        shown = [softened(each, environment, start.gain_scale) for each in shown]
    operator = Synthesis(shown, driver.environment, driver.control, manner, seed)
    made = driver.run(operator, start, origin="synthesis", noise=manner.noise, filters=manner.filters, seed=seed)
    return made.model_copy(update={"sources": tuple(operator.used)})
