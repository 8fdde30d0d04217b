"""A reference world from its description: closed surfaces, true sizes, and what is refused."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dextera_build.artifacts.world import World
from dextera_build.errors import RuleError
from dextera_build.geometry import cameras, transforms
from dextera_build.testing import RuleRunner
from tests.rules.capture.cameras import CAMERA

WORLD: dict[str, Any] = {
    "camera": CAMERA,
    "objects": {
        "laptop": {"kind": "laptop", "at_m": (-0.22, 0.1), "yaw_deg": 10.0},
        "mug": {"kind": "mug", "at_m": (0.12, -0.1)},
        "carton": {"kind": "carton", "at_m": (0.3, 0.1), "size_m": (0.1, 0.06, 0.15)},
        "bowl": {"kind": "bowl", "at_m": (-0.1, -0.2)},
        "can": {"kind": "cylinder", "at_m": (0.12, 0.12), "radius_m": 0.03, "height_m": 0.1},
    },
    "lamps": ({"direction": (0.3, 0.5, -1.0), "strength": 0.6, "shadow": True},),
}


def changed(path: str, value: object) -> dict[str, Any]:
    """`WORLD` with one value replaced; dots lead inwards."""
    world = copy.deepcopy(WORLD)
    inner = world
    *outer, last = path.split(".")
    for name in outer:
        inner = inner[name]
    inner[last] = value
    return world


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    made: World = RuleRunner(tmp_path_factory.mktemp("world")).run("capture.world", options=WORLD)
    return made


def test_every_part_and_every_surface_is_closed(world: World) -> None:
    for thing in [*world.objects.values(), *world.fixtures.values()]:
        assert thing.surface.is_closed
        assert all(part.mesh.is_closed for part in thing.parts.values())


@pytest.mark.parametrize(
    ("name", "size"),
    [
        ("carton", (0.1, 0.06, 0.15)),
        ("bowl", (0.15, 0.15, 0.0592)),
        ("can", (0.06, 0.06, 0.1)),
        ("mug", (0.041 + 0.041 + 0.030, 0.082, 0.095)),
    ],
)
def test_sizes_are_as_described(world: World, name: str, size: tuple[float, float, float]) -> None:
    np.testing.assert_allclose(world.objects[name].surface.extent, size, atol=1e-3)


def test_things_stand_on_the_table_where_told(world: World) -> None:
    for name, thing in world.objects.items():
        points = transforms.apply(thing.world_from_thing, thing.surface.vertices)
        assert abs(points[:, 2].min()) < 1e-6
        np.testing.assert_allclose(thing.world_from_thing[:2, 3], WORLD["objects"][name]["at_m"])


def volume(world: World, name: str) -> float:
    mesh = world.objects[name].surface
    a, b, c = (mesh.vertices[mesh.faces[:, i]].astype(np.float64) for i in range(3))
    return float((a * np.cross(b, c)).sum() / 6)


def test_containers_are_hollow_and_boxes_are_not(world: World) -> None:
    assert volume(world, "carton") == pytest.approx(0.1 * 0.06 * 0.15, rel=1e-6)
    assert volume(world, "can") == pytest.approx(np.pi * 0.03**2 * 0.1, rel=0.01)
    outer = np.pi * 0.041**2 * 0.095
    assert volume(world, "mug") < 0.35 * outer
    assert volume(world, "bowl") < 0.3 * np.pi * 0.075**2 * 0.058


def test_the_lid_opens_by_the_angle_told(world: World) -> None:
    lid = world.objects["laptop"].parts["lid"].mesh
    middle = lid.vertices - lid.vertices.mean(axis=0)
    normal = np.linalg.svd(middle.astype(np.float64), full_matrices=False)[2][2]
    # The display's plane and the table meet at 180 - 110 degrees.
    tilt = np.degrees(np.arccos(abs(normal[2])))
    assert tilt == pytest.approx(70.0, abs=0.5)


def test_the_camera_looks_at_its_target(world: World) -> None:
    target = transforms.apply(transforms.invert(world.world_from_camera), np.array([[0.0, 0.0, 0.05]]))
    np.testing.assert_allclose(cameras.project(target, world.camera.matrix()), [[150.0, 95.0]], atol=1e-9)
    assert world.world_from_camera[2, 1] < 0  # image down is world down


def test_the_same_description_gives_the_same_digest(world: World, tmp_path: Path) -> None:
    runner = RuleRunner(tmp_path)
    assert runner.encode(runner.run("capture.world", options=WORLD)) == runner.encode(world)
    other = changed("objects.carton.seed", 99)
    assert runner.encode(runner.run("capture.world", options=other)) != runner.encode(world)


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("objects.mug.at_m", (2.0, 0.0), "`mug` does not stand on the table"),
        ("objects.mug.at_m", (0.3, 0.1), "`mug` and `carton` run into each other"),
        ("camera.target_m", (0.0, 0.6, 0.05), "is not wholly in the picture"),
        ("camera.target_m", (0.0, -0.8, 0.0), "the camera looks straight up or down"),
    ],
)
def test_impossible_worlds_are_refused(tmp_path: Path, path: str, value: object, message: str) -> None:
    with pytest.raises(RuleError, match=message) as error:
        RuleRunner(tmp_path).run("capture.world", options=changed(path, value))
    assert error.value.hint


def test_an_unknown_kind_is_named(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="'teapot'"):
        RuleRunner(tmp_path).run("capture.world", options=changed("objects.mug.kind", "teapot"))
