"""simulate.settle: verdicts, with and without a simulator."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import ModuleType

import pytest

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.objects.object import Asset
from dextera_build.artifacts.scenes.scene import Scene, SettleReport
from dextera_build.errors import RuleError
from dextera_build.rule import Context, Options
from dextera_build.sim.worlds.settle import Motion
from rules.simulate.scene import settle_mujoco, settle_stub
from rules.simulate.scene.scene import scene
from rules.simulate.scene.settle import SettleOptions, settle
from rules.simulate.scene.settle_mujoco import rests
from tests import factories


def placed(tmp_path: Path, **assets: Asset) -> Scene:
    return scene(
        Context(scratch=tmp_path),
        Collection[Asset](items=assets),
        factories.background(),
        factories.support(),
        factories.camera(),
    )


def judge(twin: Scene, tmp_path: Path, backend: ModuleType = settle_mujoco) -> tuple[SettleReport, Context]:
    context = Context(backend=backend, scratch=tmp_path)
    return settle(context, twin, options=SettleOptions(seconds=1.5)), context


@pytest.mark.parametrize("backend", [settle_mujoco, settle_stub])
def test_a_standing_scene_passes(backend: ModuleType, tmp_path: Path) -> None:
    report, context = judge(placed(tmp_path, box=factories.box_asset(), lap=_laptop()), tmp_path, backend)
    assert report.passed
    assert [body.name for body in report.bodies] == ["box", "lap"]
    assert all(body.resting for body in report.bodies)
    assert context.outcome.line.startswith("settles, drift 0.")
    assert context.outcome.previews


def test_a_scene_of_unknown_scale_says_so(tmp_path: Path) -> None:
    twin = placed(tmp_path, box=factories.box_asset()).model_copy(update={"scale": "unknown"})
    _, context = judge(twin, tmp_path, settle_stub)
    assert context.outcome.line.startswith("settles, scale unknown, drift")


def test_held_bodies_are_counted_with_their_reasons(tmp_path: Path) -> None:
    assets = {f"box_{number}": factories.box_asset(factories.pose(0.15 * number - 0.2)) for number in range(4)}
    held = {"mug": "nothing carries it: it would fall by 412 mm", "tin": "it is 9 mm inside mug"}
    twin = placed(tmp_path, **assets).model_copy(update={"held": held})
    report, context = judge(twin, tmp_path, settle_stub)
    assert report.passed
    assert context.outcome.line == (
        "4 of 6 stand free, 2 held: mug (nothing carries it: it would fall by 412 mm), tin (it is 9 mm inside mug), "
        "drift 0.0 mm, penetration 0.0 mm"
    )


def test_a_scene_with_held_bodies_says_as_well_which_of_the_others_do_not_rest(tmp_path: Path) -> None:
    beside = factories.box_asset(factories.pose(0.9))
    twin = placed(tmp_path, box=factories.box_asset(), lost=beside).model_copy(update={"held": {"mug": "it leans"}})
    report, context = judge(twin, tmp_path)
    assert not report.passed
    assert context.outcome.line.startswith("2 of 3 stand free, 1 held: mug (it leans); does not rest: lost, drift")


def test_what_falls_is_named_and_the_report_is_still_made(tmp_path: Path) -> None:
    beside = factories.box_asset(factories.pose(0.9))
    report, context = judge(placed(tmp_path, box=factories.box_asset(), lost=beside), tmp_path)
    assert not report.passed
    assert [body.resting for body in report.bodies] == [True, False]
    assert context.outcome.line.startswith("does not rest: lost")


def test_a_body_that_slides_away_does_not_rest(tmp_path: Path) -> None:
    first, second = factories.box_asset(), factories.box_asset(factories.pose(0.03))
    report, _ = judge(placed(tmp_path, a=first, b=second), tmp_path)
    assert max(body.penetration_m for body in report.bodies) > 0.02


def test_a_body_that_is_pressed_into_another_does_not_rest() -> None:
    still = Motion("box", 0.0, 0.0, 0.0, 0.0, penetration_m=0.0, depth_m=0.0004, speed_m_s=0.0, turn_rad_s=0.0)
    assert rests(still, SettleOptions())
    assert not rests(replace(still, depth_m=0.0006), SettleOptions())


def test_a_report_that_leaves_bodies_out_is_refused(tmp_path: Path) -> None:
    twin = placed(tmp_path, box=factories.box_asset())

    class Forgetful:
        @staticmethod
        def let_go(ctx: Context, scene: Scene, common: SettleOptions, options: Options) -> SettleReport:
            report = settle_stub.let_go(ctx, scene, common, options)
            return report.model_copy(update={"bodies": ()})

    with pytest.raises(RuleError, match="does not name the scene's bodies"):
        settle(Context(backend=Forgetful, scratch=tmp_path), twin, options=SettleOptions())


def _laptop() -> Asset:
    return factories.laptop_asset(factories.pose(0.25, 0.1))
