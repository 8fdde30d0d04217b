"""simulate.canonical: an asset in its canonical frame stays where it is, with all its parts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.objects import similar
from dextera_build.artifacts.objects.canonical import CanonicalFrame
from dextera_build.artifacts.objects.object import Asset
from dextera_build.artifacts.spatial.pose import Pose, Similarity
from dextera_build.geometry import kinematics, lie, transforms
from dextera_build.testing import RuleRunner
from tests import factories


def test_every_part_of_a_box_is_in_the_stated_frame_and_stays_in_the_world(tmp_path: Path) -> None:
    upright = factories.box_asset(factories.pose(0.2, 0.1, 0.06, 0.5), (0.06, 0.09, 0.12))
    askew = transforms.rigid(lie.rotation(np.array([np.pi / 2, 0.0, 0.0])), np.array([0.3, -0.2, 0.1]))
    made = similar.asset(upright, Similarity(parent="object", child="object", matrix=askew, scale=1.0))
    pose = Pose(parent="canonical", child="object", matrix=transforms.invert(askew))
    runner = RuleRunner(tmp_path)
    found: Asset = runner.run("simulate.canonical", asset=made, frame=CanonicalFrame(pose=pose, method="stated"))
    assert "turned by 90 deg" in runner.outcome.line
    for mine, true in ((found.pose.matrix, upright.pose.matrix), (_surface(found), _surface(upright))):
        np.testing.assert_allclose(mine, true, atol=1e-6)
    (link,), (true_link,) = found.physics.links.values(), upright.physics.links.values()
    np.testing.assert_allclose(link.inertia, true_link.inertia, atol=1e-9)
    for piece, true_piece in zip(_pieces(found), _pieces(upright), strict=True):
        np.testing.assert_allclose(piece, true_piece, atol=1e-6)


def _surface(asset: Asset) -> np.ndarray:
    return kinematics.posed_surface(asset.body)[0]


def _pieces(asset: Asset) -> list[np.ndarray]:
    return [hull.vertices for link in asset.collision.links.values() for hull in link.hulls]


@pytest.mark.medium
def test_the_hinge_of_a_laptop_turns_the_same_lid_in_the_canonical_frame(tmp_path: Path) -> None:
    made, runner = factories.laptop_asset(factories.pose(0.1, -0.2, 0.0, 0.7)), RuleRunner(tmp_path)
    frame = runner.run("align.canonical", body=made.body)
    found: Asset = runner.run("simulate.canonical", asset=made, frame=frame)
    assert _surface(found).min(axis=0)[2] == pytest.approx(0.0, abs=1e-6)
    for opening in (0.0, 1.0):
        before, after = (
            transforms.apply(each.pose.matrix, kinematics.posed_surface(each.body, {"hinge": opening})[0])
            for each in (made, found)
        )
        np.testing.assert_allclose(after, before, atol=1e-6)
