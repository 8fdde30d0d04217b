"""Verdicts of MuJoCo Warp beside those of MuJoCo on the same actions, and steps per second of batches.

    python -m tests.benchmarks.stepping.batch task/kl/lift_mustard_bottle:attempts task/lift_blue_mug:sources

Every recorded episode is replayed from its start, and from that of another one, which its actions were not made for.
Objects have their nominal sizes, because worlds of a batch share meshes. Needs the extra `batch`.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Sequence

import mujoco
import numpy as np
from mujoco import rollout

from dextera_build import Project
from dextera_build.artifacts.tasks.episode import Episode, Episodes, Start
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.sim.runtime.batch import Batch
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.runtime.rollout import open_loop

from . import ours

LINGER_S = 1.0
"""Time to hold the last target, because success needs time to be confirmed [s]."""
STEPS = 100
"""Steps that are timed."""


def replays(episodes: Sequence[Episode]) -> tuple[list[Start], list[np.ndarray]]:
    """Starts with nominal sizes and joint targets (T, A): every episode's own, then the actions of the next one."""
    moved = [episode for episode in episodes if len(episode.executed)]
    starts = [episode.start.model_copy(update={"size_scale": {}}) for episode in moved]
    actions = [np.asarray(episode.executed, np.float64) for episode in moved]
    return [*starts, *starts], [*actions, *actions[1:], actions[0]]


def in_turn(
    bundle: TaskBundle, starts: Sequence[Start], actions: Sequence[np.ndarray]
) -> tuple[list[bool], list[float]]:
    """Successes of MuJoCo, and simulated time over processor time; the time includes the recording of episodes."""
    environment = Environment(bundle)
    found: list[Episode] = []
    verdicts, speeds = [], []
    for start, each in zip(starts, actions, strict=True):
        spent = ours.seconds(lambda now=start, sent=each: found.append(open_loop(environment, now, sent, LINGER_S)))
        verdicts.append(found[-1].success)
        speeds.append(environment.steps * environment.period_s / spent)
    return verdicts, speeds


def at_once(bundle: TaskBundle, starts: Sequence[Start], actions: Sequence[np.ndarray]) -> list[bool]:
    """Successes of MuJoCo Warp."""
    batch = Batch(bundle, starts, "cpu")
    linger = round(LINGER_S / batch.worlds[0].period_s)
    verdicts: list[bool | None] = [None] * len(starts)
    for period in range(max(map(len, actions)) + linger):
        outcomes = batch.step(np.array([each[min(period, len(each) - 1)] for each in actions]))
        for world, (each, outcome) in enumerate(zip(actions, outcomes, strict=True)):
            if verdicts[world] is None and (outcome.over or period >= len(each) + linger - 1):
                verdicts[world] = outcome.success
        if None not in verdicts:
            break
    return [bool(verdict) for verdict in verdicts]


def rate(work: Callable[[], object], steps: int) -> float:
    """Steps per second of processor time, the middle one of nine runs."""
    work()
    return steps / float(np.median([ours.seconds(work) for _ in range(9)]))


def rates(bundle: TaskBundle, worlds: int) -> dict[str, float]:
    """Steps per second and core, from the photograph with the robot at home, where all bodies are awake."""
    environment = Environment(bundle)
    model, cores, data = environment.model, os.cpu_count() or 1, environment.data
    kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
    state = np.zeros((1, mujoco.mj_stateSize(model, kind)))
    mujoco.mj_getState(model, data, state[0], kind)
    datas = [mujoco.MjData(model) for _ in range(cores)]
    control = np.broadcast_to(data.ctrl, (worlds, STEPS, model.nu)).copy()
    batch = Batch(bundle, [environment.start] * worlds, "cpu")
    actions = np.tile(environment.previous_action, (worlds, 1))

    def alone() -> None:
        mujoco.mj_resetData(model, data)
        mujoco.mj_setState(model, data, state[0], kind)
        data.ctrl[:] = control[0, 0]
        mujoco.mj_step(model, data, STEPS)

    return {
        "`mj_step`": rate(alone, STEPS),
        f"`mujoco.rollout`, {worlds} worlds, {cores} threads": rate(
            lambda: rollout.rollout(model, datas, np.repeat(state, worlds, 0), control), STEPS * worlds
        ),
        f"MuJoCo Warp, {worlds} worlds, verdicts included": rate(
            lambda: batch.step(actions), environment.substeps * worlds
        ),
    }


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("nodes", nargs="+", help="nodes of tasks that return episodes")
    parser.add_argument("--worlds", type=int, default=64, help="worlds that are timed")
    arguments = parser.parse_args()
    project = Project.find()
    replayed = []
    print("| task | replays | x real time, median | least |\n|---|---|---|---|")
    for node in arguments.nodes:
        bundle, shown = project.get(node.partition(":")[0] + ":task"), project.get(node)
        assert isinstance(bundle, TaskBundle)
        assert isinstance(shown, Episodes)
        starts, actions = replays([*shown.items.values(), *shown.failures.values()])
        verdicts, speeds = in_turn(bundle, starts, actions)
        print(f"| {bundle.task.name} | {len(speeds)} | {np.median(speeds):.0f} | {min(speeds):.0f} |", flush=True)
        replayed.append((bundle, starts, actions, verdicts))
    print(
        "\n| task | replays | succeed in MuJoCo | in MuJoCo Warp | verdicts alike |\n|---|---|---|---|---|", flush=True
    )
    for bundle, starts, actions, one in replayed:
        other = at_once(bundle, starts, actions)
        alike = sum(a == b for a, b in zip(one, other, strict=True))
        print(f"| {bundle.task.name} | {len(one)} | {sum(one)} | {sum(other)} | {alike} |", flush=True)
    for bundle, *_ in replayed:
        print(f"\n{bundle.task.name}\n\n| backend | steps per second and core |\n|---|---|")
        for name, value in rates(bundle, arguments.worlds).items():
            print(f"| {name} | {value:,.0f} |", flush=True)


if __name__ == "__main__":
    main()
