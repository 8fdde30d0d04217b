"""simulate.identified: a twin takes over what recordings have shown, and nothing else."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.tasks.dynamics import DynamicsEstimate, Estimate, JointDynamics, ObjectDynamics
from dextera_build.artifacts.tasks.task import Reset, TaskBundle
from dextera_build.errors import RuleError
from dextera_build.policy.layout import embodiment
from dextera_build.sim.runtime.environment import Environment
from dextera_build.testing import RuleRunner
from tests import gate, task_bundles


def _known(value: float, sigma: float) -> Estimate:
    return Estimate(value=value, sigma=sigma, prior=value, prior_sigma=4 * sigma)


def _kept(value: float) -> Estimate:
    return Estimate(value=value, sigma=1.0, prior=value, prior_sigma=1.0, why="never seen")


def dynamics(bundle: TaskBundle, **changed: Estimate) -> DynamicsEstimate:
    """Mass, and one rail of the gantry."""
    rail = {"stiffness": _known(1800.0, 0.02), "lag_s": _known(0.06, 0.01), "friction": _known(2.5, 0.1)}
    thing = {"mass_kg": _known(0.2, 0.03), "friction": _known(0.6, 0.02)}
    return DynamicsEstimate(
        task=bundle.task.name,
        embodiment=embodiment(bundle.robot),
        objects={"box": ObjectDynamics(**{name: changed.get(name, each) for name, each in thing.items()})},
        joints={"z": JointDynamics(**{name: changed.get(name, each) for name, each in rail.items()})},
        latency_s=changed.get("latency_s", _known(0.015, 0.001)),
        periods={"free": 1, "carried": 1, "pushed": 1},
        runs=1,
        residual=1e-4,
    )


def identified(folder: Path, bundle: TaskBundle, found: DynamicsEstimate) -> TaskBundle:
    made = RuleRunner(folder).run("simulate.identified", bundle=bundle, dynamics=found)
    assert isinstance(made, TaskBundle)
    return made


def test_model_intervals_and_starts_follow(tmp_path: Path) -> None:
    before = task_bundles.lift(reset=Reset(position_m=0.01))
    after = identified(tmp_path, before, dynamics(before))
    one, other = Environment(before), Environment(after)
    box = other.model.body("box")
    assert box.mass[0] == pytest.approx(0.2)
    assert box.inertia == pytest.approx(2 * one.model.body("box").inertia, rel=1e-6)
    assert other.model.body("case").mass == pytest.approx(one.model.body("case").mass)
    assert other.model.geom_friction[other.model.geom_bodyid == box.id, 0] == pytest.approx(0.6)
    rail = other.model.actuator("robot/z")
    assert (rail.gainprm[0], rail.biasprm[1], rail.biasprm[2]) == pytest.approx((1800.0, -1800.0, -108.0))
    assert other.model.joint("robot/z").frictionloss[0] == pytest.approx(2.5)
    assert other.model.actuator("robot/x").gainprm[0] == 2000.0
    assert after.latency_s == 0.015
    thing = after.objects["box"]
    assert thing.mass_scale == pytest.approx((np.exp(-1.645 * 0.03), np.exp(1.645 * 0.03)), rel=1e-4)
    assert (thing.friction, thing.friction_sigma) == (0.6, 0.02)
    assert str(after.objects["case"]) == str(before.objects["case"])
    assert np.array_equal(after.base_pose.matrix, before.base_pose.matrix)
    assert (after.task, after.robot) == (before.task, before.robot)
    assert one.start.qpos == pytest.approx(other.start.qpos, abs=1e-5)
    drawn = [other.draw(seed) for seed in range(20)]
    assert all(0.95 < start.mass_scale["box"] < 1.06 for start in drawn)
    assert np.std([start.friction["box"] for start in drawn]) < 0.03
    assert min(start.mass_scale["case"] for start in drawn) < 0.9


def test_gains_of_an_identified_joint_are_drawn_from_less(tmp_path: Path) -> None:
    before = task_bundles.lift(reset=Reset())
    after = identified(tmp_path, before, dynamics(before))
    assert after.gain_share == {"z": 0.25}
    environment = Environment(after)
    environment.begin(environment.start.model_copy(update={"gain_scale": 1.08}))
    gains = {name: environment.model.actuator(f"robot/{name}").gainprm[0] for name in "xz"}
    assert gains == pytest.approx({"x": 1.08 * 2000.0, "z": 1.02 * 1800.0})
    # A second time, of the same twin, what was left is narrowed.
    assert identified(tmp_path, after, dynamics(after)).gain_share == {"z": 0.0625}


def test_what_was_not_identified_stays(tmp_path: Path) -> None:
    before = task_bundles.lift()
    names = ("mass_kg", "stiffness", "lag_s", "latency_s")
    after = identified(tmp_path, before, dynamics(before, **{name: _kept(9.0) for name in names}))
    one, other = Environment(before), Environment(after)
    assert other.model.body("box").mass == pytest.approx(one.model.body("box").mass)
    assert after.objects["box"].mass_scale == before.objects["box"].mass_scale
    rails = [each.model.actuator("robot/z") for each in (one, other)]
    assert rails[1].gainprm[0] == pytest.approx(rails[0].gainprm[0])
    assert rails[1].biasprm[:3] == pytest.approx(rails[0].biasprm[:3])
    assert (after.latency_s, after.gain_share) == (before.latency_s, {})


def test_dynamics_of_another_robot_or_object_are_refused(tmp_path: Path) -> None:
    bundle = task_bundles.lift()
    with pytest.raises(RuleError, match="the dynamics are those of another robot"):
        identified(tmp_path, gate.bundle(), dynamics(bundle))
    without = bundle.model_copy(update={"objects": {"case": bundle.objects["case"]}})
    with pytest.raises(RuleError, match="the task has no object `box`, of which dynamics were estimated"):
        identified(tmp_path, without, dynamics(bundle))
    with pytest.raises(RuleError, match="but this task is in a perturbed world"):
        identified(tmp_path, bundle.model_copy(update={"kind": "perturbed"}), dynamics(bundle))
