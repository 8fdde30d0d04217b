"""simulate.describe: what it returns is what the other rules write."""

from __future__ import annotations

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.objects.object import Asset
from dextera_build.sim.model import mjcf
from dextera_build.testing import RuleRunner
from tests import factories


def test_the_scene_is_written_from_it(tmp_path):
    assets = {
        "Box": factories.box_asset(factories.pose(-0.25, 0.1, 0.0, 0.3)),
        "laptop": factories.laptop_asset(factories.pose(0.1, 0.2, 0.0, -0.4)),
    }
    inputs = {
        "assets": Collection[Asset](items=assets),
        "background": factories.background(),
        "support": factories.support(),
        "camera": factories.camera(),
    }
    described = RuleRunner(tmp_path).run("simulate.describe", **inputs)
    scene = RuleRunner(tmp_path).run("simulate.scene", **inputs)
    assert mjcf.write(described) == scene.model
    assert described.bodies == scene.bodies == ("box", "laptop")
