"""A run of a robot as an attempt at its task: judged from what was measured alone, and overruled by the operator."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dextera_build import digest
from dextera_build.artifacts.tasks.episode import Episode, Start
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.artifacts.tasks.trials import Attempt, Verdicts
from dextera_build.geometry import poses, transforms
from dextera_build.policy.declared import DECLARED
from dextera_build.policy.layout import of_bundle
from dextera_build.policy.observation import Measurement, in_worlds
from dextera_build.policy.robot_run import RobotRun
from dextera_build.sim.model.model import at_home, compile_folder
from dextera_build.sim.primitives import catalogue
from dextera_build.sim.runtime.measured_state import MeasuredState
from dextera_build.sim.runtime.seeds import seed_of

UNSEEN = "the objects were not measured at all times"
UNMOVED = "nothing was sent"
OVERRULED = "the operator saw that it failed"


def attempt(bundle: TaskBundle, run: RobotRun, *, trusts: bool = False) -> Attempt:
    """The attempt that a run was; one in which nothing was sent, or objects were not measured, is excluded.

    The start is the first measurement in the twin's model: dynamics of the robot and of objects are not known, so that
    nothing is scaled.

    Args:
        bundle: The task in the twin.
        run: Its recording.
        trusts: Whether the operator's verdict is enough where objects were not measured at all times; they are then
            assumed where they were seen last, and nothing is judged from them.
    """
    number = seed(run)
    if not len(run.sent) or not (run.complete or (trusts and run.operator is not None)):
        return Attempt(seed=number, excluded=UNSEEN if len(run.sent) else UNMOVED)
    mirror, verdicts, done = MeasuredState(bundle, staged=True), None, False
    if run.complete:
        done = judged(mirror, run, bundle.task.control_hz)
        verdicts = Verdicts(measured=done, operator=run.operator)
    else:
        run = _assumed(bundle, run)
        mirror.begin(run.measured[0])
    success = done if run.operator is None else run.operator
    missing = mirror.missing if verdicts and not done else OVERRULED
    episode = _episode(bundle, run, mirror, number).model_copy(
        update={"success": success, "reason": "" if success else missing or run.ended}
    )
    placed = run.measured[0].objects.astype(np.float32)
    return Attempt(seed=number, episode=episode, placed=placed, stage=mirror.stage, verdicts=verdicts)


def _assumed(bundle: TaskBundle, run: RobotRun) -> RobotRun:
    """The run with every object where it was seen last, or else first, or else photographed."""
    data = at_home(compile_folder(bundle.model))
    base = bundle.base_pose.inverse().matrix
    bodies = [data.body(name) for name in bundle.objects]
    places = [transforms.rigid(each.xmat.reshape(3, 3), each.xpos) for each in bodies]
    photographed = np.array([poses.from_matrix(base @ each) for each in places]).reshape(-1, 7)
    inner = np.array([data.joint(name).qpos[0] for name in bundle.displacement_names]).reshape(-1, 1)
    objects = _last(np.array([each.objects for each in run.measured]), photographed)
    joints = _last(np.array([each.displacement for each in run.measured])[..., None], inner)[..., 0]
    rows = zip(run.measured, objects, joints, strict=True)
    measured = tuple(replace(each, objects=seen, displacement=opened) for each, seen, opened in rows)
    return replace(run, measured=measured)


def _last(rows: np.ndarray, otherwise: np.ndarray) -> np.ndarray:
    """Rows (T, N, K) with NaN replaced by the last row before, else the first one after, else that of (N, K)."""
    found, at = rows.copy(), np.arange(len(rows))
    for number, each in enumerate(otherwise):
        known = np.isfinite(rows[:, number]).all(axis=-1)
        last = np.maximum.accumulate(np.where(known, at, -1))
        found[:, number] = rows[np.where(last < 0, known.argmax(), last), number] if known.any() else each
    return found


def seed(run: RobotRun) -> int:
    """A number of the recording in place of a seed, because starts of a robot are not drawn."""
    parts = (run.times, *(each.joints for each in run.measured), run.requested)
    numbers = b"".join(np.ascontiguousarray(each).tobytes() for each in parts)
    return seed_of("robot", digest.of_value(dict(run.about)), digest.of_bytes(numbers))


def judged(mirror: MeasuredState, run: RobotRun, rate_hz: float) -> bool:
    """Whether the measurements show that the task was done at any time."""
    mirror.begin(run.measured[0])
    return any(mirror.judge(seen, number / rate_hz) for number, seen in enumerate(run.measured[1:], 1))


def _episode(bundle: TaskBundle, run: RobotRun, mirror: MeasuredState, number: int) -> Episode:
    count, first = len(run.sent), run.measured[0]
    layout = replace(of_bundle(bundle), tips=())  # forces are not measured
    goal = np.array(catalogue.of(bundle.task, bundle.objects).goal.numbers(bundle.base_pose.inverse().matrix))
    seen = in_worlds(run.measured[:count], [first.joints, *run.sent[:-1]], [goal] * count)
    terms = {
        term.name: seen.get(term.name, np.zeros((count, *layout.shape(term)))).astype(np.float32)
        for term in DECLARED
        if term.recorded
    }
    return Episode(
        start=_start(mirror, first, number),
        origin="operator" if run.about.get("origin") == "operator" else "policy",
        success=False,
        reason="",
        action=run.requested.astype(np.float32),
        executed=run.sent.astype(np.float32),
        hand=_palms(mirror, run.measured[:count]),
        goal=goal.astype(np.float32),
        terms=terms,
    )


def _start(mirror: MeasuredState, first: Measurement, number: int) -> Start:
    return Start(
        seed=number,
        qpos=mirror.positions(first),
        ctrl=first.joints.copy(),
        mass_scale={},
        friction={},
        gain_scale=1.0,
    )


def _palms(mirror: MeasuredState, measured: Sequence[Measurement]) -> np.ndarray:
    return np.array([mirror.palm_poses(each.joints) for each in measured], np.float32)
