"""A can on a table in front of a robot with a hand, and the hands of somebody who lifts it; no person made them."""

from __future__ import annotations

from typing import Any

import pytest

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.objects.object import Asset
from dextera_build.artifacts.robots.hand_stream import HandStream
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.sim.experts import candidates, planning, rehearse
from dextera_build.testing import RuleRunner
from tests import factories

STEADY = dict.fromkeys(("tremor_m", "tremor_deg", "jitter_m", "jitter_deg", "drift_m", "drift_deg", "clock_s"), 0.0)
STEADY |= {"losses_per_min": 0.0}


def lift_can(runner: RuleRunner, robot: RobotModel, limbs: list[str]) -> TaskBundle:
    can = factories.box_asset(factories.pose(0.0, 0.0), size=(0.06, 0.06, 0.14), mass=0.2)
    assets = Collection[Asset](items={"can": can})
    scene = runner.run(
        "simulate.scene",
        assets=assets,
        background=factories.background(0.8),
        support=factories.support(0.8),
        camera=factories.camera(),
    )
    task: dict[str, Any] = {
        "name": "LiftCan",
        "primitive": "lift",
        "object": "can",
        "lift": {"height_m": 0.08},
        "timeout_s": 8.0,
    }
    task |= {"limbs": limbs} if limbs else {}
    reset = {"position_m": 0.01, "yaw_deg": 5.0, "dynamics": 0.2}
    made: TaskBundle = runner.run(
        "simulate.task",
        scene=scene,
        assets=assets,
        robot=robot,
        base=factories.placed(factories.pose(-0.55, 0.0, 0.0), "base"),
        options={**task, "reset": reset},
    )
    return made


def shown(
    runner: RuleRunner, bundle: TaskBundle, monkeypatch: pytest.MonkeyPatch, episodes: int = 1, **options: Any
) -> tuple[Episodes, HandStream]:
    """Episodes of the scripted operator, who rehearses little, and hands that would have moved the robot so."""
    for module, name, value in ((planning, "PLANNED", 0), (candidates, "LOOKED", 0), (candidates, "FEW", 6)):
        monkeypatch.setattr(module, name, value)
    for name, value in (("GOOD", 1), ("FINAL", 1), ("STARTS", 1)):
        monkeypatch.setattr(rehearse, name, value)
    script: Episodes = runner.run("demonstrate.operate", bundle=bundle, options={"episodes": episodes})
    options = {"unsteady": STEADY} | options
    hands: HandStream = runner.run("reference.hands", robot=bundle.robot, episodes=script, options=options)
    return script, hands
