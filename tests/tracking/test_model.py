"""The model of a tracked object: where its surface is seen, and how its joints move it."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.geometry import raycast, transforms
from dextera_build.tracking.model import Model, State
from tests import factories

K = np.array([[300.0, 0, 159.5], [0, 300.0, 119.5], [0, 0, 1]])
SHAPE = (240, 320)


def box() -> Model:
    mesh = factories.box_asset().body.links["base"].mesh
    return Model({"base": (mesh.vertices, mesh.faces)})


def test_a_cast_is_the_render_at_its_pixels():
    model, pose = box(), transforms.rigid(np.eye(3), np.array([0.02, -0.1, 0.8]))
    cast = model.cast(State(pose, np.zeros(0)), K, SHAPE)
    mesh = factories.box_asset().body.links["base"].mesh
    whole = raycast.render([raycast.posed(mesh.vertices, mesh.faces, pose)], K, np.eye(4), *SHAPE)
    assert cast is not None
    expected = whole.depth[np.ix_(cast.rows, cast.columns)]
    assert (cast.drawn == (expected > 0)).all()
    assert cast.depth[cast.drawn] == pytest.approx(expected[cast.drawn], abs=1e-5)
    assert transforms.apply(pose, cast.points[cast.drawn])[:, 2] == pytest.approx(expected[cast.drawn], abs=1e-5)


@pytest.mark.parametrize("place", [(0, 0, -1.0), (5.0, 0, 1.0), (0, 0, 0.01)])
def test_what_is_not_before_the_camera_has_no_cast(place: tuple[float, float, float]):
    assert box().cast(State(transforms.rigid(np.eye(3), np.array(place)), np.zeros(0)), K, SHAPE) is None


def test_a_joint_moves_what_is_beyond_it_within_its_limits():
    body = factories.laptop_asset().body
    model = Model({name: (link.mesh.vertices, link.mesh.faces) for name, link in body.links.items()}, body.joints)
    assert model.limited(np.array([9.0])) == pytest.approx([2.3])
    closed, open_ = model.link_poses(np.array([0.0])), model.link_poses(np.array([1.0]))
    assert closed[0] == pytest.approx(open_[0])
    assert np.abs(closed[1] - open_[1]).max() > 0.1
    assert model.chains.tolist() == [[False], [True]]
