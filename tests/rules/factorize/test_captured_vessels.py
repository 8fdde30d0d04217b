"""Vessels from real photographs: what is seen to be hollow must hold a ball."""

from __future__ import annotations

from pathlib import Path

import mujoco
import pytest

from dextera_build.artifacts.base import Folder
from dextera_build.testing import RuleRunner
from tests import factories, object_views

CAPTURES = Path(__file__).parents[4] / "shared" / "captures"


@pytest.mark.slow
@pytest.mark.parametrize("name", ["table_white_bowl", "table_blue_mug"])
def test_a_photographed_vessel_holds_a_ball(name, tmp_path):
    folder = CAPTURES / name
    if not folder.is_dir():
        pytest.skip(f"needs shared/captures/{name}")
    runner = RuleRunner(tmp_path)
    files = {path.name: path.read_bytes() for path in folder.iterdir()}
    capture = runner.run("capture.folder", folder=Folder(files=files))
    support = runner.run("align.support", **factories.shot(capture))
    elements = runner.run("factorize.parse", **factories.shot(capture), support=support)
    found = runner.run("factorize.segment", **factories.shot(capture), support=support, elements=elements).items
    seen = max(found.values(), key=lambda one: int(one.view.mask.sum()))
    body = runner.run(
        "factorize.articulate",
        shape=runner.run("factorize.mesh", **object_views.sights(seen)),
        **object_views.whole(seen),
    )
    assert body.hollow
    collision = runner.run("factorize.collision", body=body)
    assert collision.links["base"].cavity_fill < 0.05
    placement = runner.run("align.object", body=body, **object_views.sights(seen))
    assert placement.scale == pytest.approx(1.0, abs=0.005)
    physics = runner.run("factorize.physics", body=body, traits=seen.traits)
    parts = {"physics": physics, "collision": collision, "placement": placement}
    asset = runner.run("simulate.asset", body=body, traits=seen.traits, **parts)
    path = runner.run("simulate.urdf", asset=asset).export(tmp_path, "urdf")[0]
    height = float(asset.body.links["base"].mesh.extent[2])
    assert 0.0 < ball_rest(path, height) < 0.6 * height


def ball_rest(urdf: Path, height: float) -> float:
    """Height [m] at which a 20 mm ball comes to rest that was let go above the vessel."""
    spec = mujoco.MjSpec.from_file(str(urdf))
    # A falling ball covers the thickness of a floor in one default step.
    spec.option.timestep = 0.0005
    ball = spec.worldbody.add_body(pos=[0.002, 0.001, height + 0.02])
    ball.add_freejoint()
    ball.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.01, 0.0, 0.0], density=500.0)
    model = spec.compile()
    data = mujoco.MjData(model)
    while data.time < 2.0:
        mujoco.mj_step(model, data)
    return float(data.qpos[2])
