"""Terms of a tracked pose: each one's Jacobian is the derivative of what it compares."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.geometry import cameras, lie, transforms
from dextera_build.tracking import outline, terms
from dextera_build.tracking.colours import Colours
from dextera_build.tracking.frame import Frame
from dextera_build.tracking.model import Cast, Model, State
from tests import factories

K = np.array([[300.0, 0, 159.5], [0, 300.0, 119.5], [0, 0, 1]])


def laptop() -> Model:
    body = factories.laptop_asset().body
    return Model({name: (link.mesh.vertices, link.mesh.faces) for name, link in body.links.items()}, body.joints)


def state() -> State:
    pose = transforms.rigid(lie.rotation(np.array([-2.0, 0.3, 0.1])), np.array([0.02, 0.03, 0.7]))
    return State(pose, np.array([1.4]))


def seen(model: Model, at: State) -> Frame:
    """The model before a wall, without noise."""
    cast = model.cast(at, K, (240, 320), rays=10**6)
    depth = np.full((240, 320), 1.5, np.float32)
    rgb = np.full((240, 320, 3), 90, np.uint8)
    assert cast is not None
    depth[np.ix_(cast.rows, cast.columns)] = np.where(cast.drawn, cast.depth, 1.5)
    rgb[np.ix_(cast.rows, cast.columns)] = np.where(cast.drawn[..., None], np.uint8([200, 60, 40]), np.uint8(90))
    return Frame(rgb, depth, K, 0.0)


def stepped(at: State, step: np.ndarray) -> State:
    return State(lie.retract(at.pose, step[:6]), at.joints + step[6:])


@pytest.mark.parametrize("column", range(7))
def test_places_move_as_their_derivative_says(column: int):
    """The hinge too: its column moves the lid only."""
    model, at = laptop(), state()
    cast = model.cast(at, K, (240, 320))
    assert cast is not None
    spots = terms.Spots.of(cast, 200)
    step = np.zeros(7)
    step[column] = 1e-6
    before, after = (terms.Placed.of(model, each, spots) for each in (at, stepped(at, step)))
    assert (after.points - before.points) / 1e-6 == pytest.approx(before.motions[:, :, column], abs=1e-5)
    frame = seen(model, at)
    pixels = [cameras.project(each.points, K) for each in (before, after)]
    assert (pixels[1] - pixels[0]) / 1e-6 == pytest.approx(terms.image_motion(frame, before)[:, :, column], abs=2e-2)
    assert set(spots.link) == {0, 1}


def test_depth_pulls_to_the_surface_and_not_to_what_hides_it():
    model, at = laptop(), state()
    frame = seen(model, at)
    cast = model.cast(at, K, (240, 320))
    assert cast is not None
    spots = terms.Spots.of(cast, 300)
    nearer = stepped(at, np.array([0, 0, 0.004, 0, 0, 0, 0]))
    found = terms.depth(frame, terms.Placed.of(model, nearer, spots), 0.03, 0)
    jacobian, off, weight = found.jacobian, found.off, found.weight
    assert len(off) > 100
    step = (jacobian[:, 2] * weight) @ off / ((jacobian[:, 2] * weight) @ jacobian[:, 2])
    assert step == pytest.approx(-0.004, abs=1e-4)
    frame.depth[:, :160] = 0.4  # a hand before the left half
    kept = terms.depth(frame, terms.Placed.of(model, at, spots), 0.03, 0)
    assert 20 < len(kept.off) < len(off)
    assert np.abs(kept.off).max() < 1e-3


def test_places_of_another_object_do_not_take_part():
    model, at = laptop(), state()
    frame = seen(model, at)
    cast = model.cast(at, K, (240, 320))
    assert cast is not None
    placed = terms.Placed.of(model, at, terms.Spots.of(cast, 300))
    frame.owner[:] = 1
    assert len(terms.depth(frame, placed, 0.03, 0).off) == 0
    assert len(terms.depth(frame, placed, 0.03, 1).off) > 100


@pytest.fixture
def taken() -> tuple[Model, State, Cast, Frame]:
    """A model, as it is cast into a frame whose right half was found to show object 1."""
    model, at = laptop(), state()
    frame, cast = seen(model, at), model.cast(at, K, (240, 320))
    assert cast is not None
    frame.owner[:, 160:] = 1
    return model, at, cast, frame


def test_brightness_of_another_object_is_not_compared(taken):
    model, at, cast, frame = taken
    spots = terms.Spots.of(cast, 300)
    placed = terms.Placed.of(model, at, spots)
    look = terms.Look(spots, np.linspace(0, 255, len(spots.points)), np.eye(3)[2], np.eye(3), np.eye(6))
    counts = [len(terms.brightness(frame, placed, look, number, cast)[0].off) for number in (0, 1)]
    assert 20 < counts[0] < counts[1] - 20


def test_brightness_of_what_a_lid_hides_is_not_compared():
    model, pose = laptop(), transforms.rigid(lie.rotation(np.array([-2.8, 0.3, 0.1])), state().pose[:3, 3])
    cast = model.cast(State(pose, np.array([1.9])), K, (240, 320))
    assert cast is not None
    spots = terms.Spots.of(cast, 300)
    look = terms.Look(spots, np.linspace(0, 255, len(spots.points)), np.eye(3)[2], np.eye(3), np.eye(6))
    counts = []
    for angle in (1.9, 0.05):
        now = State(pose, np.array([angle]))
        there = model.cast(now, K, (240, 320))
        assert there is not None
        placed = terms.Placed.of(model, now, spots)
        found, _ = terms.brightness(seen(model, now), placed, look, 0, there)
        counts.append(int((found.patch < 8).sum()))  # of link 0, the keyboard
    assert counts[0] > 100
    assert counts[1] < counts[0] / 10


def test_an_outline_that_touches_another_object_is_hidden(taken):
    model, at, cast, frame = taken
    edge = outline.Outline.of(cast, frame.shape)
    placed = terms.Placed.of(model, at, edge.spots)
    known = [np.isfinite(outline.seek(frame, placed, edge, Colours(), 7, number).offset) for number in (0, 1)]
    column = cameras.project(placed.points, K)[:, 0]
    assert known[1].all()
    assert known[0][column < 150].all()
    assert not known[0][column > 170].any()
