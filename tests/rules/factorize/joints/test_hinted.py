"""Joints that `scene.yaml` states: a closed door and a shut drawer, which no photograph tells."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.objects.object import JointHint
from dextera_build.errors import RuleError
from dextera_build.geometry import cameras, solids, transforms
from dextera_build.testing import RuleRunner
from tests import factories, object_views
from tests.benchmarks.joints import kinds, sight


@pytest.fixture
def runner(tmp_path):
    return RuleRunner(tmp_path)


class Closed:
    """A closed piece of furniture, seen once."""

    def __init__(self, kind: str) -> None:
        draw = np.random.default_rng(3)
        self.thing = kinds.KINDS[kind](draw)
        self.place = sight.stand(self.thing, draw, 0.4, np.radians(25.0))
        self.seen = sight.look(self.thing, self.place, 5)
        mesh = object_views.mesh(solids.union(list(self.thing.posed().values())))
        self.shape = object_views.shape(mesh).model_copy(update={"pose": factories.placed(self.place.pose)})

    def pixels(self, points: np.ndarray) -> np.ndarray:
        """Pixels (N, 2) of points of the object frame."""
        to_camera = transforms.invert(self.place.eye) @ self.place.pose
        return cameras.project(transforms.apply(to_camera, points), sight.LENS.matrix())

    def front(self, link: str) -> tuple[int, int, int, int]:
        """A box inside the front of a part [px]."""
        vertices = self.thing.links[link].vertices
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        corners = np.array([[x, low[1], z] for x in (low[0], high[0]) for z in (low[2], high[2])])
        left, top = np.ceil(np.sort(self.pixels(corners), axis=0)[:2].max(axis=0)).astype(int)
        right, bottom = np.floor(np.sort(self.pixels(corners), axis=0)[2:].min(axis=0)).astype(int)
        return int(left), int(top), int(right), int(bottom)

    def run(self, runner: RuleRunner, *hints: JointHint):
        traits = self.seen.traits.model_copy(update={"joints": hints})
        return runner.run(
            "factorize.articulate",
            shape=self.shape,
            **{**object_views.whole(self.seen), "traits": traits},
            camera=sight.LENS,
        )


@pytest.mark.slow
def test_a_closed_door_turns_about_the_line_between_two_pixels(runner):
    case = Closed("cupboard")
    (true,) = case.thing.joints
    vertices = case.thing.links["door"].vertices
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    ends = np.array([[true.origin[0], low[1], z] for z in (low[2], high[2])])
    first, second = (tuple(map(float, pixel)) for pixel in case.pixels(ends)[:: int(np.sign(true.axis[2]))])
    hint = JointHint(type="revolute", part_px=case.front("door"), axis_px=(first, second), range=(0.0, 1.5))
    body = case.run(runner, hint)
    (joint,) = body.joints
    assert float(np.dot(joint.axis, true.axis)) > np.cos(np.radians(1.0))
    # The pixels are on the outer side of the door: its own thickness lies between.
    assert np.linalg.norm(np.cross(np.subtract(joint.origin, [true.origin[0], low[1], 0.0]), true.axis)) < 0.003
    assert (joint.lower, joint.upper, joint.position) == (0.0, 1.5, 0.0)
    assert all(link.mesh.is_closed for link in body.links.values())


@pytest.mark.medium
def test_a_shut_drawer_slides_out_of_its_front(runner):
    case = Closed("drawers")
    true = case.thing.joints[0]
    body = case.run(runner, JointHint(type="prismatic", part_px=case.front("drawer_0")))
    (joint,) = body.joints
    assert float(np.dot(joint.axis, true.axis)) > np.cos(np.radians(2.0))
    assert joint.lower == 0.0
    assert joint.upper > 0.08
    moved = body.links["part_1"].mesh.vertices
    assert np.ptp(moved[:, 1]) > 0.1


def test_pixels_beside_the_object_are_refused(runner):
    case = Closed("drawers")
    with pytest.raises(RuleError, match=r"`part_px` of joint 1 holds 0 measured pixels") as caught:
        case.run(runner, JointHint(type="prismatic", part_px=(0, 0, 10, 10)))
    assert "the box of the moving part" in caught.value.hint
