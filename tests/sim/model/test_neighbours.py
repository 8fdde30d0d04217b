"""Neighbours whose collision pieces overlap: they part without moving, and the rest of them stays."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from dextera_build.artifacts.objects.object import Asset
from dextera_build.geometry import transforms
from dextera_build.geometry.convex import Convex
from dextera_build.sim.model import model
from dextera_build.sim.model.neighbours import TOUCH_M, Cut, parted
from tests import factories, twins

SIZE = (0.1, 0.1, 0.1)


def box(x: float, y: float = 0.0, z: float = 0.0, yaw: float = 0.0) -> Asset:
    return factories.box_asset(factories.pose(x, y, z, yaw), SIZE)


def pieces(asset: Asset) -> list[Convex]:
    return [
        Convex(transforms.apply(asset.pose.matrix, hull.vertices.astype(np.float64)))
        for link in asset.collision.links.values()
        for hull in link.hulls
    ]


def deepest(first: Asset, second: Asset) -> float:
    return max(one.overlap(other)[0] for one in pieces(first) for other in pieces(second))


def cut(assets: dict[str, Asset], *static: np.ndarray) -> tuple[dict[str, Asset], tuple[Cut, ...]]:
    found = parted(assets, static)
    assert found.feet == {}
    return found.assets, found.cuts


def drift(assets: dict[str, Asset]) -> float:
    """How far a body moves within 2 s [m]."""
    scene = twins.scene(assets)
    loaded = model.compile_folder(scene)
    data = model.at_home(loaded)
    start = data.xpos.copy()
    while data.time < 2.0:
        mujoco.mj_step(loaded, data)
    return float(np.linalg.norm(data.xpos - start, axis=1).max())


def test_what_does_not_overlap_stays_bit_for_bit() -> None:
    assets = {"a": box(-0.06), "b": box(0.06, yaw=0.1), "bowl": factories.bowl_asset(factories.pose(0.4, 0.0))}
    found, cuts = cut(assets)
    assert cuts == ()
    assert all(found[label] is asset for label, asset in assets.items())


@pytest.mark.parametrize("yaw", [0.0, 0.3, 0.8])
def test_neighbours_that_overlap_part_where_they_stand(yaw: float) -> None:
    assets = {"a": box(-0.044), "b": box(0.044, yaw=yaw)}
    before = deepest(assets["a"], assets["b"])
    assert before > 0.01
    found, (told,) = cut(assets)
    assert told.deep_m == pytest.approx(before, abs=1e-6)
    assert 0.0 < told.lost < 0.3
    assert deepest(found["a"], found["b"]) <= TOUCH_M
    assert found[told.by] is assets[told.by]
    assert found[told.body].physics == assets[told.body].physics
    assert found[told.body].body is assets[told.body].body
    kept = sum(piece.volume for piece in pieces(found[told.body]))
    assert kept == pytest.approx((1.0 - told.lost) * 0.1**3, rel=1e-3)
    assert cut(found)[1] == ()
    assert drift(assets) < 0.001


def test_a_box_sunk_into_the_floor_of_a_bowl_stands_on_it() -> None:
    small = factories.box_asset(factories.pose(0.0, 0.0, 0.0), (0.02, 0.02, 0.04))
    bowl = factories.bowl_asset(factories.pose(0.0, 0.0))
    assert deepest(small, bowl) > 0.001
    found, cuts = cut({"small": small, "bowl": bowl})
    assert cuts
    assert deepest(found["small"], found["bowl"]) <= TOUCH_M
    assert drift({"small": small, "bowl": bowl}) < 0.002


def test_the_static_scene_is_never_cut() -> None:
    post = np.array([[x, y, z] for x in (0.04, 0.2) for y in (-0.3, 0.3) for z in (0.0, 0.5)])
    found, (told,) = cut({"a": box(0.0)}, post)
    assert (told.body, told.by) == ("a", "")
    assert told.deep_m == pytest.approx(0.01, abs=1e-6)
    assert pieces(found["a"])[0].corners[:, 0].max() == pytest.approx(0.04, abs=1e-6)


def test_one_thing_inside_another_is_left_as_it_is() -> None:
    assets = {"a": box(0.0), "b": box(0.01)}
    found, cuts = cut(assets)
    assert cuts == ()
    assert found["a"] is assets["a"]
    assert found["b"] is assets["b"]


def test_a_joint_keeps_its_pieces_in_their_links() -> None:
    laptop = factories.laptop_asset(factories.pose(0.0, 0.0))
    left = float(pieces(laptop)[0].corners[:, 0].min())
    beside = factories.box_asset(factories.pose(left - 0.005, 0.0), (0.02, 0.02, 0.01))
    found, cuts = cut({"laptop": laptop, "beside": beside})
    assert len(cuts) == 1
    assert set(found["laptop"].collision.links) == set(laptop.collision.links)
    assert deepest(found["laptop"], found["beside"]) <= TOUCH_M


@pytest.mark.parametrize("gap", [0.003, 0.007, 0.013, 0.029])
def test_a_body_that_hovers_alone_gets_feet_and_stays(gap: float) -> None:
    assets = {"a": box(0.0, z=gap), "far": box(0.3)}
    found = parted(assets, [])
    assert found.feet == {"a": pytest.approx(gap)}
    assert found.cuts == ()
    assert found.assets["far"] is assets["far"]
    (piece,) = pieces(found.assets["a"])
    assert piece.low[2] == pytest.approx(0.0, abs=1e-6)
    assert piece.volume == pytest.approx(0.1**2 * (0.1 + gap), rel=1e-4)
    assert drift(assets) < 0.0005


def test_what_hangs_high_or_leans_on_another_gets_no_feet() -> None:
    assert parted({"a": box(0.0, z=0.04)}, []).feet == {}
    assert parted({"a": box(0.0, z=0.007), "b": box(0.101)}, []).feet == {}


def test_what_stands_on_a_board_of_the_static_scene_gets_no_feet() -> None:
    board = np.array([[x, y, z] for x in (-0.2, 0.2) for y in (-0.2, 0.2) for z in (0.0, 0.018)])
    assets = {"a": box(0.0, z=0.0185)}
    found = parted(assets, [board])
    assert found.feet == {}
    assert found.assets["a"] is assets["a"]


def test_a_thing_in_a_bowl_whose_foot_is_hidden_stands_on_the_bowl() -> None:
    """Its seen part stays where it is: it neither falls nor slides along the bowl's wall."""
    bowl = factories.bowl_asset(factories.pose(0.4, 0.0))
    can = factories.box_asset(factories.pose(0.41, 0.008, 0.022), (0.03, 0.03, 0.06))
    assert drift({"bowl": bowl, "can": can}) < 0.0005
    found = parted({"bowl": bowl, "can": can}, [])
    assert set(found.feet) == {"can"}
    assert found.assets["bowl"] is bowl
    assert found.assets["can"].body is can.body


def test_a_thing_far_above_what_carries_it_gets_no_feet() -> None:
    assert parted({"a": box(0.0), "b": box(0.0, z=0.15)}, []).feet == {}


def test_the_lowest_of_a_stack_that_hovers_gets_feet_and_all_stay() -> None:
    assets = {"a": box(0.0, z=0.208), "b": box(0.01, z=0.108), "c": box(0.0, z=0.008)}
    assert set(parted(assets, []).feet) == {"c"}
    assert drift(assets) < 0.0005
