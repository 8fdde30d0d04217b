"""What `align.dynamics` finds out about worlds whose truth is drawn.

`python -m tests.benchmarks.dynamics PROJECT TASK [--weighed] [--worlds 20] [--recordings 5]`, in which nodes `task`
and `sources` are built. Each world is a perturbed twin (`simulate.perturbed`, its defaults) with drawn latency and dry
friction. The targets of demonstrations in the twin are sent there; joints are read by encoders and poses of objects by
a tracker, with noise and delay. Constants of `rules/align/dynamics` were chosen with seeds 0 to 2; seeds here begin at
1000.
"""

from __future__ import annotations

import argparse
import tempfile
from collections import defaultdict
from pathlib import Path
from statistics import NormalDist

import numpy as np

from dextera_build.artifacts.tasks.dynamics import DynamicsEstimate, Estimate
from dextera_build.artifacts.tasks.episode import Episode, Episodes
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.geometry import lie, poses, transforms
from dextera_build.policy import layout
from dextera_build.project.project import find
from dextera_build.running import called
from dextera_build.session import Session
from dextera_build.sim.model.compose import ROBOT
from dextera_build.sim.model.machine import Machine
from dextera_build.sim.model.model import compile_folder
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.runtime.rollout import open_loop
from dextera_build.sim.worlds import perturb
from dextera_build.statistics import wilson
from dextera_build.testing import RuleRunner

FIRST = 1000
"""Seed of the first world."""
LATENCY_S = 0.04
"""Latencies are drawn up to this [s]."""
ENCODER = 1e-4
"""Standard deviation of an encoder [rad or m]."""
TRACKER_M, TRACKER_RAD, TRACKER_HZ, TRACKER_S = 0.0015, 0.0087, 15.0, 0.06
"""Noise per axis, rate and delay of the tracker."""
LOGARITHMIC = ("mass_kg", "stiffness", "lag_s")
"""Quantities whose standard deviation is that of the logarithm."""


def world_of(bundle: TaskBundle, seed: int) -> TaskBundle:
    """A world whose truth is drawn."""
    random = np.random.default_rng([seed, 77])
    machine = Machine(
        seed=seed,
        gain_spread=0.08,
        arm_friction=float(random.uniform(0.002, 0.02)),
        hand_friction=0.03,
        skin_spread=0.15,
        timestep_s=0.001,
        latency_s=float(random.uniform(0.0, LATENCY_S)),
    )
    most = perturb.Disturbance(size_sigma=0.02, dynamics=1.0, hinge_sigma=0.15, centre_m=0.003, contact_sigma=0.3)
    return perturb.build(bundle, most, machine, {})[0]


def recorded(world: TaskBundle, sources: Episodes, count: int, seed: int) -> Episodes:
    """The targets of `sources` sent in that world, as hardware records it; failures are among the items, too."""
    environment, random = Environment(world), np.random.default_rng([seed, 78])
    items = {}
    for name, source in sources.in_order()[:count]:
        still = {"mass_scale": {}, "friction": {}, "size_scale": {}, "gain_scale": 1.0}
        done = open_loop(environment, source.start.model_copy(update=still), source.executed)
        items[name] = _measured(done, world.task.control_hz, random)
    return layout.gathered(world, items, {}, len(items))


def _measured(episode: Episode, hz: float, random: np.random.Generator) -> Episode:
    truth, times = episode.objects.astype(np.float64), np.arange(len(episode.executed)) / hz
    stamps = np.arange(0.0, times[-1] + 1e-9, 1.0 / TRACKER_HZ)
    seen = np.array([[_tracked(pose, random) for pose in truth[round(stamp * hz)]] for stamp in stamps])
    arrived = np.maximum(np.searchsorted(stamps + TRACKER_S, times + 1e-9) - 1, 0)
    joints = episode.joints + ENCODER * random.standard_normal(episode.joints.shape)
    terms = {**episode.terms, "joints": joints.astype(np.float32), "objects": seen[arrived].astype(np.float32)}
    return episode.model_copy(update={"terms": terms})


def _tracked(pose: np.ndarray, random: np.random.Generator) -> np.ndarray:
    turn = lie.rotation(TRACKER_RAD * random.standard_normal(3))
    return poses.from_matrix(poses.to_matrix(pose) @ transforms.rigid(turn, TRACKER_M * random.standard_normal(3)))


def truth_of(world: TaskBundle) -> dict[str, float]:
    """The truth by the names of `DynamicsEstimate.estimates`."""
    model, name = compile_folder(world.model), world.task.object
    found = {
        f"mass_kg of {name}": float(model.body_subtreemass[model.body(name).id]),
        f"friction of {name}": world.objects[name].friction,
        "latency_s": world.latency_s,
    }
    for joint in world.robot.joints:
        if joint.group == "arm":
            number = model.actuator(ROBOT + joint.name).id
            stiffness, damping = float(model.actuator_gainprm[number, 0]), -float(model.actuator_biasprm[number, 2])
            found[f"stiffness of {joint.name}"] = stiffness
            found[f"lag_s of {joint.name}"] = damping / stiffness
            found[f"friction of {joint.name}"] = float(
                model.dof_frictionloss[model.joint(ROBOT + joint.name).dofadr[0]]
            )
    return found


def z_of(name: str, estimate: Estimate, truth: float) -> float:
    """Error in standard deviations."""
    off = np.log(estimate.value / truth) if name.split(" ")[0] in LOGARITHMIC else estimate.value - truth
    return float(off / estimate.sigma)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("project", type=Path)
    parser.add_argument("task")
    parser.add_argument("--weighed", action="store_true", help="the object is weighed, with an error of 2 %%")
    parser.add_argument("--worlds", type=int, default=20)
    parser.add_argument("--recordings", type=int, default=5)
    args = parser.parse_args()
    project = find(args.project)
    with called.shown(project.library):
        session = Session(project, args.task, last=True)
        bundle, sources = session.artifact("task"), session.artifact("sources")
    assert isinstance(bundle, TaskBundle)
    assert isinstance(sources, Episodes)
    rows: dict[str, list[tuple[bool, float, float, float]]] = defaultdict(list)
    for seed in range(FIRST, FIRST + args.worlds):
        world = world_of(bundle, seed)
        truth = truth_of(world)
        mass = truth[f"mass_kg of {bundle.task.object}"]
        weighed = {"mass_kg": mass * float(np.exp(0.02 * np.random.default_rng([seed, 79]).standard_normal()))}
        with tempfile.TemporaryDirectory() as scratch:
            found = RuleRunner(Path(scratch)).run(
                "align.dynamics",
                bundle=bundle,
                episodes=recorded(world, sources, args.recordings, seed),
                options=weighed if args.weighed else {},
            )
        assert isinstance(found, DynamicsEstimate)
        for name, each in found.estimates.items():
            kind = name if bundle.task.object in name or name == "latency_s" else f"{name.split(' ')[0]} of joints"
            relative = abs(each.value / truth[name] - 1.0)
            rows[kind].append((each.identified, abs(each.value - truth[name]), relative, z_of(name, each, truth[name])))
        thing = found.objects[bundle.task.object]
        print(
            f"{seed}: mass {mass:.4f} kg, {thing.mass_kg.value:.4f} ± {100 * thing.mass_kg.sigma:.1f} %"
            f"{' kept' if thing.mass_kg.why else ''}; friction {truth[f'friction of {bundle.task.object}']:.3f}, "
            f"{thing.friction.value:.3f} ± {thing.friction.sigma:.3f}{' kept' if thing.friction.why else ''}; "
            f"{found.periods}, {1000 * found.residual:.2f} mrad",
            flush=True,
        )
    print(table(rows))


def table(rows: dict[str, list[tuple[bool, float, float, float]]]) -> str:
    """Markdown."""
    lines = [
        "| quantity | identified | error: median, largest | relative | in the 90 % interval | in the 95 % interval |",
        "|---|---|---|---|---|---|",
    ]
    for kind, every in rows.items():
        kept = np.array([each[1:] for each in every if each[0]]).reshape(-1, 3)
        cells = [kind, f"{len(kept)} of {len(every)}"]
        if len(kept):
            cells += [f"{np.median(kept[:, 0]):.3g}, {kept[:, 0].max():.3g}"]
            cells += [f"{100 * np.median(kept[:, 1]):.1f}, {100 * kept[:, 1].max():.1f} %"]
            for share in (0.9, 0.95):
                inside = int((np.abs(kept[:, 2]) <= NormalDist().inv_cdf(0.5 + share / 2)).sum())
                low, high = wilson(inside, len(kept))
                cells.append(f"{inside} of {len(kept)} [{100 * low:.0f}, {100 * high:.0f}] %")
        lines.append("| " + " | ".join([*cells, *[""] * (6 - len(cells))]) + " |")
    return "\n".join(lines)


if __name__ == "__main__":
    main()
