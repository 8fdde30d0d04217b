"""A reference world from its description: closed surfaces, true sizes, and what is refused."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import manifold3d
import numpy as np
import pytest
from pydantic import ValidationError

from dextera_build.artifacts.scenes.world import Thing, World
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.errors import RuleError
from dextera_build.geometry import cameras, lie, transforms
from dextera_build.testing import RuleRunner
from tests.rules.capture.cameras import CAMERA

WORLD: dict[str, Any] = {
    "camera": CAMERA,
    "objects": {
        "laptop": {"kind": "laptop", "at_m": (-0.22, 0.1), "yaw_deg": 10.0},
        "mug": {"kind": "mug", "at_m": (0.12, -0.1)},
        "carton": {"kind": "carton", "at_m": (0.3, 0.1), "size_m": (0.1, 0.06, 0.15)},
        "bowl": {"kind": "bowl", "at_m": (-0.1, -0.2)},
        "basket": {"kind": "basket", "at_m": (0.1, -0.3), "radius_m": 0.08, "foot_radius_m": 0.07, "height_m": 0.06},
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
    made: World = RuleRunner(tmp_path_factory.mktemp("world")).run("reference.world", options=WORLD)
    return made


@pytest.mark.medium
def test_every_part_and_every_surface_is_closed(world: World) -> None:
    for thing in [*world.objects.values(), *world.fixtures.values()]:
        assert thing.surface.is_closed
        assert all(part.mesh.is_closed for part in thing.parts.values())


@pytest.mark.parametrize(
    ("name", "size"),
    [
        ("carton", (0.1, 0.06, 0.15)),
        ("bowl", (0.15, 0.15, 0.0592)),
        ("basket", (0.16, 0.16, 0.061)),
        ("can", (0.06, 0.06, 0.1)),
        ("mug", (0.041 + 0.041 + 0.030, 0.082, 0.095)),
    ],
)
def test_sizes_are_as_described(world: World, name: str, size: tuple[float, float, float]) -> None:
    np.testing.assert_allclose(world.objects[name].surface.extent, size, atol=1e-3)


def test_things_stand_on_the_table_where_told(world: World) -> None:
    for name, thing in world.objects.items():
        points = transforms.apply(thing.pose.matrix, thing.surface.vertices)
        assert abs(points[:, 2].min()) < 1e-6
        np.testing.assert_allclose(thing.pose.matrix[:2, 3], WORLD["objects"][name]["at_m"])


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
    # A flat floor and a thin wall of rope.
    assert volume(world, "basket") < np.pi * 0.006 * (0.07**2 + 2 * 0.075 * 0.06)


def test_the_lid_opens_by_the_angle_told(world: World) -> None:
    lid = world.objects["laptop"].parts["lid"].mesh
    middle = lid.vertices - lid.vertices.mean(axis=0)
    normal = np.linalg.svd(middle.astype(np.float64), full_matrices=False)[2][2]
    # The display's plane and the table meet at 180 - 110 degrees.
    tilt = np.degrees(np.arccos(abs(normal[2])))
    assert tilt == pytest.approx(70.0, abs=0.5)


def test_things_have_masses_of_their_own_and_fixtures_have_none(world: World) -> None:
    masses = {name: thing.matter.mass_kg for name, thing in world.objects.items() if thing.matter}
    assert masses == {"laptop": 1.6, "mug": 0.31, "carton": 0.46, "bowl": 0.42, "basket": 0.35, "can": 0.4}
    assert all(thing.matter is None for thing in world.fixtures.values())
    assert [name for name, thing in world.objects.items() if thing.hinge] == ["laptop"]


def test_the_hinge_is_where_the_lid_turns(world: World) -> None:
    laptop = world.objects["laptop"]
    hinge = laptop.hinge
    assert hinge is not None
    assert np.degrees(hinge.position) == pytest.approx(110.0)
    # Turned back by its position, the lid lies flat on the base, a millimetre above it.
    axis, origin = np.array(hinge.axis), np.array(hinge.origin)
    turn = lie.rotation(-hinge.position * axis)
    flat = (laptop.parts["lid"].mesh.vertices - origin) @ turn.T + origin
    assert flat[:, 2].min() == pytest.approx(0.017, abs=1e-4)
    assert flat[:, 2].max() == pytest.approx(0.024, abs=1e-4)


def solid(mesh: Mesh) -> manifold3d.Manifold:
    return manifold3d.Manifold(manifold3d.Mesh64(mesh.vertices.astype(np.float64), mesh.faces.astype(np.uint64)))


def filled(thing: Thing) -> manifold3d.Manifold:
    """What the convex pieces fill together."""
    pieces = [piece.vertices.astype(np.float64) for part in thing.parts.values() for piece in part.pieces]
    hulls = [manifold3d.Manifold.hull_points(points) for points in pieces]
    return manifold3d.Manifold.batch_boolean(hulls, manifold3d.OpType.Add)


@pytest.mark.parametrize(
    ("name", "spare"),
    [("carton", 1e-4), ("can", 1e-4), ("laptop", 1e-4), ("mug", 0.04), ("bowl", 0.08), ("basket", 0.2)],
)
def test_convex_pieces_fill_the_thing_and_little_more(world: World, name: str, spare: float) -> None:
    pieces, whole = filled(world.objects[name]), solid(world.objects[name].surface)
    assert (whole - pieces).volume() < 1e-3 * whole.volume()
    assert (pieces - whole).volume() < spare * whole.volume()


@pytest.mark.parametrize("name", ["mug", "bowl", "basket"])
def test_cavities_are_open(world: World, name: str) -> None:
    pieces, shell = filled(world.objects[name]), solid(world.objects[name].parts["shell"].mesh)
    cavity = shell.hull() - shell
    assert (cavity ^ pieces).volume() < 0.05 * cavity.volume()


def test_the_camera_looks_at_its_target(world: World) -> None:
    target = transforms.apply(transforms.invert(world.camera_pose.matrix), np.array([[0.0, 0.0, 0.05]]))
    np.testing.assert_allclose(cameras.project(target, world.camera.matrix()), [[150.0, 95.0]], atol=1e-9)
    assert world.camera_pose.matrix[2, 1] < 0  # image down is world down


@pytest.mark.slow
def test_the_same_description_gives_the_same_digest(world: World, tmp_path: Path) -> None:
    runner = RuleRunner(tmp_path)
    assert runner.encode(runner.run("reference.world", options=WORLD)) == runner.encode(world)
    other = changed("objects.carton.seed", 99)
    assert runner.encode(runner.run("reference.world", options=other)) != runner.encode(world)


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("objects.mug.at_m", (2.0, 0.0), "`mug` does not stand on the table"),
        ("objects.mug.at_m", (0.3, 0.1), "`carton` and `mug` run into each other"),
        ("camera.target_m", (0.0, 0.6, 0.05), "is not wholly in the picture"),
        ("camera.target_m", (0.0, -0.8, 0.0), "the camera looks straight up or down"),
        ("objects.laptop.opening_deg", 140.0, "`laptop` stands beyond its hinge's limits"),
        ("objects.laptop.lid_kg", 2.0, "the lid of `laptop` is heavier than the whole"),
    ],
)
def test_impossible_worlds_are_refused(tmp_path: Path, path: str, value: object, message: str) -> None:
    with pytest.raises(RuleError, match=message) as error:
        RuleRunner(tmp_path).run("reference.world", options=changed(path, value))
    assert error.value.hint


@pytest.mark.parametrize(("option", "value"), [("mass_kg", 0.0), ("friction", -0.1), ("restitution", 1.0)])
def test_no_thing_has_an_impossible_mass_friction_or_restitution(tmp_path: Path, option: str, value: float) -> None:
    with pytest.raises(ValueError, match=f"mug.{option}"):
        RuleRunner(tmp_path).run("reference.world", options=changed(f"objects.mug.{option}", value))


def test_an_unknown_kind_is_named(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="'teapot'"):
        RuleRunner(tmp_path).run("reference.world", options=changed("objects.mug.kind", "teapot"))


@pytest.mark.parametrize(
    ("option", "value", "message"),
    [("rope_m", 0.1, "the rope is as thick as the basket"), ("seam_m", 0.003, "the seams cut the rope")],
)
def test_ropes_that_make_no_basket_are_refused(tmp_path: Path, option: str, value: float, message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        RuleRunner(tmp_path).run("reference.world", options=changed(f"objects.basket.{option}", value))
