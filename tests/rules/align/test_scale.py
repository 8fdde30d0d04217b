"""align.scale: one stated size gives all lengths of a world."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.objects.object import Body, Placement, Support
from dextera_build.errors import RuleError
from dextera_build.testing import RuleRunner
from tests import factories, object_views

BOX = object_views.mesh(object_views.solids.box((0.2, 0.1, 0.4), (0.0, 0.0, 0.2)))


@pytest.fixture
def run(tmp_path):
    runner = RuleRunner(tmp_path)

    def call(support: Support, *names: str, **options: object) -> Support:
        bodies = {name: object_views.body(BOX) for name in names or ("box",)}
        place = factories.placed(factories.pose(0.3, 0.1, 0.0, 0.4))
        placements = {name: Placement(pose=place, scale=2.0, method="test") for name in bodies}
        found: Support = runner.run(
            "align.scale",
            support=support,
            bodies=Collection[Body](items=bodies),
            placements=Collection[Placement](items=placements),
            options=options,
        )
        return found

    call.runner = runner
    return call


def unknown() -> Support:
    return factories.support().model_copy(update={"scale": "unknown"})


def test_a_stated_size_scales_the_world_about_its_origin(run):
    raw = unknown()
    found = run(raw, size_m=0.2)
    # The box of 0.4 is placed twice as large, so a unit of the world is a quarter of a metre.
    assert found.factor == pytest.approx(0.25)
    assert found.scale == "size"
    assert found.polygon == pytest.approx(0.25 * raw.polygon)
    assert found.camera_pose.matrix[:3, 3] == pytest.approx(0.25 * raw.camera_pose.matrix[:3, 3])
    assert np.array_equal(found.camera_pose.matrix[:3, :3], raw.camera_pose.matrix[:3, :3])
    assert run.runner.outcome.line.startswith("scale by the size of box, 200 mm")


def test_what_is_known_or_stays_unknown_is_handed_on(run):
    for support, line in ((factories.support(), "scale by the depth"), (unknown(), "scale unknown")):
        assert run.runner.encode(run(support)) == run.runner.encode(support)
        assert run.runner.outcome.line == line


def test_an_object_without_a_size_is_refused(run):
    with pytest.raises(RuleError, match="`object: box` has no size"):
        run(unknown(), object="box")


def test_a_second_scale_is_refused(run):
    with pytest.raises(RuleError, match="the scale is known by the depth, and `size_m` states it again") as caught:
        run(factories.support(), size_m=0.2)
    assert caught.value.hint == "leave out `size_m`"


def test_of_several_objects_one_is_named(run):
    with pytest.raises(RuleError, match="`size_m` is the size of which object") as caught:
        run(unknown(), "bottle", "box", size_m=0.2)
    assert caught.value.facts["objects"] == "bottle, box"
    assert caught.value.hint == "set `object`"
    with pytest.raises(RuleError, match="no object is called `botle`") as caught:
        run(unknown(), "bottle", "box", size_m=0.2, object="botle")
    assert caught.value.hint == "did you mean `bottle`?"
    assert run(unknown(), "bottle", "box", size_m=0.2, object="box").factor == pytest.approx(0.25)
