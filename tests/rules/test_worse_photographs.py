"""A worse photograph of the same scene gives wider intervals, and starts that are drawn from wider ranges."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.objects.object import Asset
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.sim.runtime.environment import Environment
from dextera_build.testing import RuleRunner
from tests import episodes, factories, object_views

OBJECTS = {
    "carton": {"kind": "carton", "at_m": [0.18, 0.0], "yaw_deg": 20, "seed": 5},
    "bowl": {"kind": "bowl", "at_m": [-0.12, 0.0], "seed": 6},
}
WORLD: dict[str, Any] = {
    "table": {"centre_m": [0.0, 0.0], "size_m": [1.2, 0.9, 0.035]},
    "room": {"wall": [0.9, 0.89, 0.86], "pedestal_m": [0.0, 0.6, 0.2, -0.02]},
    "objects": OBJECTS,
    "ambient": 0.5,
    "lamps": [{"direction": [0.4, 0.5, -1.0], "strength": 0.5, "shadow": True}],
}
RESET = {"position_m": 0.0, "yaw_deg": 0.0, "clutter_m": 0.0}
"""Only what is uncertain is drawn."""
DRAWS = 60
LEAST = {"mass": 1.0}
"""Things of known mass decide that interval, and grow slowly in number with the doubt about the size."""


@dataclass(frozen=True)
class Twin:
    """What came of one photograph."""

    assets: dict[str, Asset]
    bundle: TaskBundle
    camera_pose: Pose


def camera(width: int, distance: float) -> dict[str, Any]:
    """A camera of the same field of view at another resolution and distance [m]."""
    height, focal = width * 9 // 16, 0.71 * width
    eye = distance * np.array([0.0, -0.74, 0.67])
    lens = {"width_px": width, "height_px": height, "fx_px": focal, "fy_px": focal}
    middle = {"cx_px": (width - 1) / 2, "cy_px": (height - 1) / 2}
    return {**lens, **middle, "eye_m": [float(x) for x in eye], "target_m": [0.03, 0.0, 0.05]}


def twin(folder: Path, lens: dict[str, Any], noise: dict[str, float]) -> Twin:
    """From a photograph of the world to a task, by the rules of `twin/from_photo`."""
    runner = RuleRunner(folder)
    world = runner.run("reference.world", options={**WORLD, "camera": lens})
    shot = factories.shot(runner.run("reference.photograph", world=world, options={"depth_noise": noise, "seed": 3}))
    support = runner.run("align.support", **shot)
    elements = runner.run("factorize.parse", **shot, support=support)
    found = runner.run("factorize.segment", **shot, support=support, elements=elements)
    assets = {one.traits.category: asset(runner, one, support) for one in found.items.values()}
    shown = {"photograph": shot["photograph"], "measured": shot["measured"]}
    background = runner.run("background.static", **shown, support=support, instances=found.map)
    held = {"assets": Collection[Asset](items=assets)}
    lens_of = shot["photograph"].camera
    scene = runner.run("simulate.scene", **held, background=background, support=support, camera=lens_of)
    base = factories.placed(factories.pose(0.0, -0.8, 0.0, yaw=1.5), "base")
    options = {"name": "Lift", "primitive": "lift", "object": "box", "reset": RESET}
    bundle = runner.run("simulate.task", **held, scene=scene, robot=episodes.robot(), base=base, options=options)
    return Twin(assets, bundle, scene.camera_pose)


def asset(runner: RuleRunner, seen: Any, support: Any) -> Asset:
    sights, traits = object_views.sights(seen), {"traits": seen.traits}
    shape = runner.run("factorize.mesh", **sights)
    body = {"body": runner.run("factorize.articulate", shape=shape, **sights, **traits)}
    parts = {
        "physics": runner.run("factorize.physics", **body, **traits),
        "collision": runner.run("factorize.collision", **body),
        "placement": runner.run("align.object", **body, **sights, support=support),
    }
    made: Asset = runner.run("simulate.asset", **body, **parts, **traits, support=support)
    return made


def intervals(made: Asset) -> dict[str, float]:
    """Widths of what the asset states."""
    assert made.pose.covariance is not None
    assert made.scale_sigma is not None
    low, high = (
        sum(getattr(link, end) for link in made.physics.links.values()) for end in ("mass_low_kg", "mass_high_kg")
    )
    x, y, yaw = np.sqrt(np.diag(made.pose.covariance))[[0, 1, 5]]
    return {
        "mass": float(np.log(high / low)),
        "friction": made.physics.friction_sigma,
        "scale": made.scale_sigma,
        "position": float(np.hypot(x, y)),
        "yaw": float(yaw),
    }


def spreads(bundle: TaskBundle, name: str) -> dict[str, float]:
    """Standard deviations of what starts draw for one object."""
    environment = Environment(bundle)
    drawn = [environment.draw(seed) for seed in range(DRAWS)]
    first = environment.model.joint(name).qposadr[0]
    places = np.array([start.qpos[first : first + 2] for start in drawn])
    return {
        "friction": float(np.std([start.friction[name] for start in drawn])),
        "mass": float(np.std(np.log([start.mass_scale[name] for start in drawn]))),
        "scale": float(np.std(np.log([start.size_scale[name] for start in drawn]))),
        "position": float(np.linalg.norm(places.std(axis=0))),
    }


@pytest.fixture(scope="module")
def good(tmp_path_factory) -> Twin:
    return twin(tmp_path_factory.mktemp("good"), camera(960, 1.0), {"subpixel_px": 0.03})


@pytest.fixture(scope="module")
def worse(tmp_path_factory) -> Twin:
    """From farther away, with fewer pixels, twice the noise and gaps."""
    return twin(tmp_path_factory.mktemp("worse"), camera(640, 1.3), {"subpixel_px": 0.08, "dropout": 0.1})


@pytest.mark.slow
@pytest.mark.parametrize("name", ["box", "bowl"])
def test_every_interval_is_wider(good, worse, name):
    first, second = intervals(good.assets[name]), intervals(worse.assets[name])
    if name == "bowl":
        assert first.pop("yaw") == second.pop("yaw"), "nothing is known of the turn of a round body"
        assert first.pop("friction") <= second.pop("friction"), "both photographs are sure that it is a vessel"
    for what, width in first.items():
        assert second[what] > LEAST.get(what, 1.02) * width > 0.0, what
    spread, wider = spreads(good.bundle, name), spreads(worse.bundle, name)
    if name == "bowl":
        assert 0.99 * spread.pop("friction") <= wider.pop("friction")
    for what, width in spread.items():
        assert wider[what] > LEAST.get(what, 1.01) * width > 0.0, what


@pytest.mark.slow
def test_the_pose_of_the_camera_is_less_certain_too(good, worse):
    first, second = (np.diag(made.camera_pose.covariance)[2:5] for made in (good, worse))
    assert (second > first).all()
    assert (first > 0.0).all()
