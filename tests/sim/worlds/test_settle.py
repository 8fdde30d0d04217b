"""Letting scenes go: what stands stays, what cannot stand is reported."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.objects.object import Asset
from dextera_build.geometry import transforms
from dextera_build.sim.model import names, neighbours
from dextera_build.sim.worlds import settle
from tests import factories, twins


def run(assets: dict[str, Asset], seconds: float = 2.0) -> dict[str, settle.Motion]:
    scene = twins.scene(assets)
    result = settle.let_go(scene, tuple(names.body_names(assets).values()), seconds)
    assert not result.diverged
    return {motion.name: motion for motion in result.motions}


def leaning(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return transforms.rigid(np.array([[1, 0, 0], [0, c, -s], [0, s, c]]), np.array([0.0, 0.0, 0.001]))


def test_things_that_stand_stay_where_they_are() -> None:
    motions = run(
        {
            "box": factories.box_asset(factories.pose(-0.25, 0.1, 0.0, 0.3)),
            "bowl": factories.bowl_asset(factories.pose(0.3, -0.2)),
            "laptop": factories.laptop_asset(factories.pose(0.1, 0.2, 0.0, -0.4)),
        }
    )
    for motion in motions.values():
        assert motion.drift_m < 1e-3
        assert motion.tilt_rad < 1e-2
        assert motion.speed_m_s < 1e-3


@pytest.mark.parametrize("restitution", [0.0, 0.05, 0.2, 0.5])
@pytest.mark.parametrize("height", [0.0, 0.0003])
def test_resting_bodies_do_not_chatter(restitution: float, height: float) -> None:
    bowl, box = factories.bowl_asset(factories.pose(-0.2, z=height)), factories.box_asset(factories.pose(0.2, z=height))
    dull = {
        name: asset.model_copy(update={"physics": asset.physics.model_copy(update={"restitution": restitution})})
        for name, asset in (("bowl", bowl), ("box", box))
    }
    for motion in run(dull, seconds=3.0).values():
        assert motion.speed_m_s < 1e-3
        assert motion.turn_rad_s < 1e-2


@pytest.mark.parametrize("opening", [0.3, 1.2, 2.0])
def test_a_lid_holds_its_angle(opening: float) -> None:
    motion = run({"laptop": factories.laptop_asset(opening=opening)}, seconds=3.0)["laptop"]
    assert motion.joints < 2e-3
    assert motion.tilt_rad < 0.02


def test_a_box_on_its_edge_falls_over() -> None:
    motion = run({"box": factories.box_asset(leaning(0.6), (0.2, 0.05, 0.2))})["box"]
    assert motion.tilt_rad > 0.5


def test_a_box_beside_the_table_falls() -> None:
    motion = run({"box": factories.box_asset(factories.pose(0.9))}, seconds=1.0)["box"]
    assert motion.fall_m > 4.0
    assert motion.speed_m_s > 5.0


def test_a_body_dropped_from_four_centimetres_falls_four_centimetres() -> None:
    motion = run({"box": factories.box_asset(factories.pose(z=0.04))})["box"]
    assert motion.fall_m == pytest.approx(0.04, abs=1e-3)
    assert motion.penetration_m == 0.0


@pytest.mark.parametrize("depth", [0.002, 0.008])
def test_penetration_is_measured_and_does_not_throw(monkeypatch: pytest.MonkeyPatch, depth: float) -> None:
    monkeypatch.setattr(neighbours, "parted", lambda assets, static: neighbours.Parted(dict(assets), (), {}))
    motion = run({"box": factories.box_asset(factories.pose(z=-depth), restitution=0.3)})["box"]
    assert motion.penetration_m == pytest.approx(depth, abs=5e-4)
    assert motion.drift_m < depth + 2e-3
    assert motion.tilt_rad < 0.02


def test_energy_rises_in_a_fall_and_dies_at_rest() -> None:
    assets = {"box": factories.box_asset(factories.pose(z=0.05), mass=0.4)}
    scene = twins.scene(assets)
    energy = settle.let_go(scene, ("box",), 2.0).energy_j
    assert len(energy) == 200
    assert energy.max() == pytest.approx(0.4 * 9.81 * 0.05, rel=0.15)
    assert energy[-1] < 1e-6


def test_an_empty_scene_settles() -> None:
    assert run({}, seconds=0.5) == {}
