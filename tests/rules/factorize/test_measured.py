"""What an asset was made from: the label follows what a backend read, not what it was given."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.objects.object import Shape
from dextera_build.code.loader import Library
from dextera_build.errors import RuleError
from dextera_build.rule import Context
from dextera_build.testing import RuleRunner
from tests import factories, object_views, tabletops

Library().find("factorize.mesh")  # mounts the rules
from rules.factorize.measured import Measurements, of_view, of_workspace  # noqa: E402

BOX = object_views.mesh(object_views.bracket())
RED = (0.75, 0.1, 0.1)


@pytest.fixture
def runner(tmp_path):
    return RuleRunner(tmp_path)


@pytest.fixture(scope="module")
def scene():
    return tabletops.tabletop((tabletops.box(0.1, 0.06, 0.14, RED), factories.pose(0.0, 0.0, yaw=0.5)))


@pytest.fixture(scope="module")
def given(scene, tmp_path_factory):
    """The photograph with its depth, its support, and what the CPU found in it."""
    runner, shot = RuleRunner(tmp_path_factory.mktemp("given")), factories.shot(scene.capture)
    support = runner.run("align.support", **shot)
    return {**shot, "support": support, "elements": runner.run("factorize.parse", **shot, support=support)}


def context() -> Context:
    return Context(scratch=Path())


def test_whoever_takes_measurements_labels_the_result():
    measurements = Measurements(context(), 1.5, "")
    assert measurements.source() == "rgb"
    assert measurements.for_check() == 1.5
    assert measurements.source() == "rgb"
    assert measurements.source("rgb", "rgbd") == "rgbd"
    assert measurements.needed() == 1.5
    assert measurements.source("rgb") == "rgbd"


def test_a_backend_that_needs_depth_and_gets_none_says_what_to_do():
    view = object_views.view(BOX, np.eye(4)).view
    with pytest.raises(RuleError) as caught:
        of_view(context(), view, None).needed()
    assert caught.value.code == "DXB-B202"
    assert (
        caught.value.message
        == "this backend makes assets with the help of measured depth, but the capture has no depth"
    )
    assert caught.value.hint is not None
    for part in ("add the depth to the capture", "`--profile picture`", "`scene.yaml`"):
        assert part in caught.value.hint


def test_depth_without_a_support_is_not_enough(scene):
    with pytest.raises(RuleError, match="but the input `support` is not given"):
        of_workspace(context(), scene.capture.photograph, scene.capture.measured, None).needed()


def test_depth_of_another_picture_is_refused(scene):
    small = scene.capture.photograph.model_copy(update={"rgb": Image(pixels=np.zeros((4, 5, 3), np.uint8))})
    with pytest.raises(RuleError, match="the depth is of another picture") as caught:
        of_workspace(context(), small, scene.capture.measured, factories.support())
    assert caught.value.facts == {"photograph": "5 x 4 px", "depth": "320 x 240 px"}
    assert caught.value.hint == "take both from one capture"


@pytest.mark.medium
@pytest.mark.parametrize("profile", ["cpu", "stub"])
def test_every_asset_rule_of_the_cpu_says_rgbd(runner, given, profile):
    given = {name: given[name] for name in ("photograph", "measured", "support")}
    elements = runner.run("factorize.parse", profile=profile, **given)
    found = runner.run("factorize.segment", profile=profile, **given, elements=elements)
    (instance,) = found.items.values()
    mesh = runner.run("factorize.mesh", profile=profile, **object_views.sights(instance))
    body = runner.run("factorize.articulate", profile=profile, shape=mesh, **object_views.whole(instance))
    placed = runner.run("align.object", profile=profile, body=body, **object_views.sights(instance))
    made = (elements, instance.view, mesh, body, placed)
    assert [each.asset_source for each in made] == ["rgbd"] * len(made)


@pytest.mark.parametrize(
    "rule", ["factorize.parse", "factorize.segment", "factorize.mesh"], ids=lambda name: str(name).split(".")[1]
)
@pytest.mark.parametrize("profile", ["cpu", "stub"])
def test_without_depth_the_backends_of_the_cpu_refuse_in_one_way(runner, given, rule, profile):
    asked = {
        "factorize.parse": {name: given[name] for name in ("photograph", "support")},
        "factorize.segment": {name: given[name] for name in ("photograph", "support", "elements")},
        "factorize.mesh": {"view": object_views.view(BOX, np.eye(4)).view},
    }[rule]
    with pytest.raises(RuleError, match="with the help of measured depth, but the capture has no depth"):
        runner.run(rule, profile=profile, **asked)


def test_a_backend_that_reads_the_photograph_alone_is_labelled_rgb(tmp_path):
    """Even if it says something else: the rule sets the label."""

    class Seer:
        @staticmethod
        def complete(ctx, view, measured, common, options):
            made = object_views.shape(BOX)
            return made.model_copy(update={"pose": None, "residual_m": None, "asset_source": "rgbd"})

    instance = object_views.view(BOX, np.eye(4))
    rule = RuleRunner(tmp_path).find("factorize.mesh").rule
    ctx = Context(backend=Seer, scratch=tmp_path)
    found: Shape = rule(ctx, instance.view, instance.measured, options=rule.options())
    assert found.asset_source == "rgb"
    assert ctx.outcome.line.endswith("50 % unseen, rgb")
    assert "residual" not in ctx.outcome.line
    assert "depth residual" not in ctx.outcome.metrics
    assert ctx.outcome.previews
    seen_with_depth = instance.view.model_copy(update={"asset_source": "rgbd"})
    assert rule(ctx, seen_with_depth, None, options=rule.options()).asset_source == "rgbd"
