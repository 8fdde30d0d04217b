"""A scaled twin closes: on the compiled model, its pivots are where its scaled links turn."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from dextera_build.artifacts.objects.object import Asset, Joint, Placement
from dextera_build.geometry import kinematics
from dextera_build.sim.model import model, touching
from dextera_build.testing import RuleRunner
from tests import factories, object_views, twins


@pytest.fixture
def runner(tmp_path):
    return RuleRunner(tmp_path)


def scaled(runner: RuleRunner, made: Asset, scale: float) -> Asset:
    where = factories.placed(factories.pose(0.1, 0.2, 0.0, 0.4))
    placement = Placement(pose=where, scale=scale, scale_sigma=0.0, method="test")
    traits = object_views.view(made.body.links["base"].mesh, np.eye(4), category="laptop").traits
    parts = {"body": made.body, "physics": made.physics, "collision": made.collision}
    asset: Asset = runner.run("simulate.asset", placement=placement, traits=traits, **parts)
    return asset


def deepest(asset: Asset) -> float:
    """Deepest overlap of base and lid between the limits [m]."""
    found = []
    (joint,) = asset.body.joints
    for position in np.linspace(joint.lower, joint.upper, 12):
        poses = kinematics.link_poses(asset.body, {joint.name: float(position)})
        base, lid = (
            touching.Piece(asset.collision.links[name].hulls[0].vertices).at(poses[name]) for name in ("base", "lid")
        )
        found.append(base.overlap_m(lid))
    return max(found)


def compiled(asset: Asset):
    return model.compile_folder(twins.scene({"laptop": asset}))


@pytest.mark.parametrize("scale", [0.5, 2.0])
def test_a_scaled_twin_has_scaled_pivots_and_closes_without_collision(runner, scale):
    made = factories.laptop_asset()
    asset = scaled(runner, made, scale)
    loaded = compiled(asset)
    assert loaded.body("laptop_lid").pos == pytest.approx(scale * np.array(made.body.joints[0].origin))
    assert deepest(asset) < 5e-4
    data = model.at_home(loaded)
    for position in np.linspace(0.0, made.body.joints[0].upper, 12):
        data.joint("laptop_lid_hinge").qpos[0] = position
        mujoco.mj_forward(loaded, data)
        own = [c for c in data.contact if {loaded.geom(c.geom1).bodyid[0], loaded.geom(c.geom2).bodyid[0]} == {1, 2}]
        assert all(contact.dist > -5e-4 for contact in own)


def test_unscaled_pivots_would_sink_the_lid(runner):
    """The check above fails where scaling leaves the joint's origin as it was."""
    made = factories.laptop_asset()
    asset = scaled(runner, made, 2.0)
    wrong = asset.model_copy(update={"body": asset.body.model_copy(update={"joints": made.body.joints})})
    assert deepest(wrong) > 2e-3
    assert compiled(wrong).body("laptop_lid").pos != pytest.approx(2.0 * np.array(made.body.joints[0].origin))


def test_a_lid_that_falls_lands_on_its_base(runner):
    """Without its limit and its friction, contact alone stops it."""
    made = factories.laptop_asset(opening=0.9)
    loaded = compiled(made)
    hinge = loaded.joint("laptop_lid_hinge")
    loaded.jnt_range[hinge.id] = (-1.5, 2.3)
    loaded.dof_frictionloss[:] = 0.0
    data = model.at_home(loaded)
    for _ in range(2000):
        mujoco.mj_step(loaded, data)
    assert float(data.joint("laptop_lid_hinge").qpos[0]) == pytest.approx(0.0, abs=0.02)


def test_a_door_needs_less_force_than_a_lid_and_both_stay_where_they_were_seen(runner):
    """Gravity turns a lid about a level axis, and no door about a plumb one."""
    made = factories.laptop_asset(opening=1.0)
    standing = Joint(
        name="hinge", type="revolute", parent="base", child="lid", origin=(0.0, 0.11, 0.0165), axis=(0.0, 0.0, 1.0),
        lower=0.0, upper=1.5, position=0.4,
    )  # fmt: skip
    door = made.model_copy(update={"body": made.body.model_copy(update={"joints": (standing,)})})
    friction = {}
    for name, asset in (("lid", made), ("door", door)):
        loaded = compiled(asset)
        data = model.at_home(loaded)
        before = float(data.joint("laptop_lid_hinge").qpos[0])
        friction[name] = float(loaded.dof_frictionloss[loaded.joint("laptop_lid_hinge").dofadr[0]])
        for _ in range(1000):
            mujoco.mj_step(loaded, data)
        assert float(data.joint("laptop_lid_hinge").qpos[0]) == pytest.approx(before, abs=0.01)
    assert 0.0 < friction["door"] < 0.05 * friction["lid"]
