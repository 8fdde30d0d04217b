"""Worlds that are drawn by index: what falls rests, what is apart stays apart, cameras look where they are told."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest
import trimesh

from dextera_build.artifacts.base import Collection, Folder
from dextera_build.artifacts.scenes.draw import Arrangement, Draw, Sensor, Viewpoint
from dextera_build.artifacts.scenes.world import Thing, World
from dextera_build.errors import RuleError
from dextera_build.geometry import cameras, solids, transforms
from dextera_build.sim.worlds import falling
from dextera_build.testing import RuleRunner
from rules.reference.drawn import places
from tests.rules.reference.drawn_objects import block, blocks

LOW, HIGH = np.array([-0.6, -0.4]), np.array([0.6, 0.4])


def world(tmp_path: Path, contact: str, seed: int = 1, backend: str = "mujoco") -> World:
    drawn: World = RuleRunner(tmp_path).run(
        "reference.draw",
        arrangement=Arrangement(seed=seed, count=5, contact=contact),
        things=Collection[Thing](items=blocks(8)),
        backend=backend,
    )
    return drawn


def posed(thing: Thing) -> solids.Solid:
    return solids.Solid(thing.surface.vertices.astype(np.float64), thing.surface.faces).moved(thing.pose.matrix)


def overlap(world: World) -> float:
    """Largest volume that two things of the world share [m^3]."""
    bodies = [posed(thing) for thing in world.objects.values()]
    return max(solids.intersection(one, other).volume for one, other in itertools.combinations(bodies, 2))


@pytest.mark.medium
@pytest.mark.parametrize("contact", ["apart", "touching", "piled"])
def test_what_fell_rests_on_the_table_and_on_one_another(tmp_path: Path, contact: str) -> None:
    drawn = world(tmp_path, contact)
    assert len(drawn.objects) >= 3
    lowest = {name: float(posed(thing).vertices[:, 2].min()) for name, thing in drawn.objects.items()}
    assert min(lowest.values()) == pytest.approx(0.0, abs=5e-4)
    assert all(height > -5e-4 for height in lowest.values())
    assert overlap(drawn) < 1e-7
    # Nothing moves if it is let go again.
    again = falling.let_fall(drawn.objects, LOW * 2, HIGH * 2, 1.0)
    for name, thing in drawn.objects.items():
        assert np.linalg.norm(again[name][:3, 3] - thing.pose.matrix[:3, 3]) < 2e-3


@pytest.mark.slow
def test_one_seed_gives_one_world_and_another_another(tmp_path: Path) -> None:
    first, same, other = (world(tmp_path, "apart", seed) for seed in (1, 1, 2))
    poses = [{name: thing.pose.matrix.tolist() for name, thing in drawn.objects.items()} for drawn in (first, same)]
    assert poses[0] == poses[1]
    assert set(first.objects) != set(other.objects) or first.lamps != other.lamps


@pytest.mark.medium
def test_the_stub_stands_things_upright(tmp_path: Path) -> None:
    drawn = world(tmp_path, "apart", backend="stub")
    for thing in drawn.objects.values():
        assert np.allclose(thing.pose.matrix[:3, :3], np.eye(3))
        assert float(posed(thing).vertices[:, 2].min()) == pytest.approx(0.0, abs=1e-6)


def test_what_falls_off_is_left_out() -> None:
    over_the_edge = block((0.1, 0.1, 0.1))
    pose = over_the_edge.pose.model_copy(update={"matrix": transforms.rigid(np.eye(3), np.array([0.59, 0.38, 0.2]))})
    things = {"stays": block((0.1, 0.1, 0.1)), "falls": over_the_edge.model_copy(update={"pose": pose})}
    # Its centre of mass is inside, so it stays; moved beyond the edge, it falls.
    assert set(falling.let_fall(things, LOW, HIGH, 2.0)) == {"stays", "falls"}
    beyond = pose.model_copy(update={"matrix": transforms.rigid(np.eye(3), np.array([0.63, 0.0, 0.2]))})
    things["falls"] = over_the_edge.model_copy(update={"pose": beyond})
    assert set(falling.let_fall(things, LOW, HIGH, 2.0)) == {"stays"}


@pytest.mark.parametrize("seed", range(6))
def test_gaps_before_the_fall_are_as_told(seed: int) -> None:
    for contact, least, most in (("apart", places.GAP_M, 1.0), ("touching", places.TOUCHING_M, 0.004)):
        placed = places.scattered(blocks(5), contact, LOW, HIGH, np.random.default_rng(seed))
        outlines = []
        for thing in placed.values():
            corners = transforms.apply(thing.pose.matrix, thing.surface.vertices.astype(np.float64))
            outlines.append(places._outline(corners))
        for number, one in enumerate(outlines):
            others = outlines[:number] + outlines[number + 1 :]
            assert all(places.apart(one, other, 0.9 * least) for other in others)
        if contact == "touching":
            assert any(not places.apart(one, other, most) for one, other in itertools.combinations(outlines, 2))


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> World:
    return world(tmp_path_factory.mktemp("drawn"), "apart", backend="stub")


@pytest.mark.medium
@pytest.mark.parametrize("pitch", [15.0, 45.0, 90.0])
@pytest.mark.parametrize("roll", [0.0, 90.0, 180.0])
def test_the_camera_looks_at_the_middle_from_where_it_is_told(
    tmp_path: Path, drawn: World, pitch: float, roll: float
) -> None:
    viewpoint = Viewpoint(seed=3, distance_m=0.9, pitch_deg=pitch, roll_deg=roll, width_px=320)
    aimed: World = RuleRunner(tmp_path).run("reference.look_at", world=drawn, viewpoint=viewpoint)
    corners = [posed(thing).vertices for thing in drawn.objects.values()]
    middle = np.mean([(own.min(axis=0) + own.max(axis=0)) / 2 for own in corners], axis=0)
    seen = transforms.apply(aimed.camera_pose.inverse().matrix, middle[None])
    assert seen[0, 2] == pytest.approx(0.9)
    pixel = cameras.project(seen, aimed.camera.matrix())[0]
    assert pixel == pytest.approx([(320 - 1) / 2, (240 - 1) / 2])
    down = np.degrees(np.arcsin(-aimed.camera_pose.matrix[2, 2]))
    assert down == pytest.approx(pitch)
    # World up appears up in an upright picture, and upside down after half a turn.
    if pitch < 90.0:
        up = aimed.camera_pose.matrix[:3, :3].T @ [0.0, 0.0, 1.0]
        assert np.degrees(np.arctan2(up[0], -up[1])) % 360 == pytest.approx(-roll % 360, abs=1e-6)


def draws(tmp_path: Path, **options: object) -> Collection[Draw]:
    found: Collection[Draw] = RuleRunner(tmp_path).run("reference.draw_list", options=options)
    return found


def test_more_scenes_begin_with_the_scenes_of_fewer(tmp_path: Path) -> None:
    few, many = draws(tmp_path, scenes=3), draws(tmp_path, scenes=30)
    assert len(few.items) == 6
    assert len(many.items) == 60
    assert all(many.items[label] == draw for label, draw in few.items.items())
    later = draws(tmp_path, scenes=2, first=10)
    assert all(many.items[label] == draw for label, draw in later.items.items())


def test_a_sweep_changes_one_quantity_and_keeps_the_scenes(tmp_path: Path) -> None:
    swept = draws(tmp_path, scenes=2, views=1, sweep={"distance_m": [0.5, 1.5], "noise": [2.0], "contact": ["piled"]})
    plain = draws(tmp_path, scenes=2, views=1)
    assert len(swept.items) == 8
    near = swept.items["distance_m=0.5 0001_0"]
    assert near.viewpoint.distance_m == 0.5
    assert near.arrangement == plain.items["0001_0"].arrangement
    assert near.sensor == plain.items["0001_0"].sensor
    assert swept.items["noise=2.0 0000_0"].sensor.noise == 2.0
    assert swept.items["noise=2.0 0000_0"].viewpoint == plain.items["0000_0"].viewpoint
    assert swept.items["contact=piled 0000_0"].arrangement.contact == "piled"
    assert {draw.axis for draw in swept.items.values()} == {"distance_m", "noise", "contact"}


@pytest.mark.slow
def test_a_worse_sensor_is_noisier_and_has_holes(tmp_path: Path) -> None:
    drawn = world(tmp_path, "apart", backend="stub")
    depths = {}
    for name, noise, dropout in (("clean", 0.0, 0.0), ("good", 1.0, 0.0), ("noisy", 3.0, 0.0), ("holes", 1.0, 0.4)):
        sensor = Sensor(seed=5, noise=noise, dropout=dropout)
        photo = RuleRunner(tmp_path).run("reference.photograph", world=drawn, sensor=sensor, backend="mujoco")
        depths[name] = photo.measured.depth.depth
    valid = (depths["clean"] > 0) & (depths["noisy"] > 0)
    errors = {name: float(np.abs(depths[name] - depths["clean"])[valid].mean()) for name in ("good", "noisy")}
    # Quantisation, the same in both, keeps the ratio a little below 3.
    assert errors["noisy"] == pytest.approx(3 * errors["good"], rel=0.1)
    holes = {name: float((depth == 0).mean()) for name, depth in depths.items()}
    assert holes["holes"] == pytest.approx(0.4 + 0.6 * holes["good"], abs=0.05)


def test_a_catalogue_scales_turns_and_stands_things(tmp_path: Path) -> None:
    # A bottle of 2 x 2 units and 10 high along y, in centimetres, with its base anywhere.
    body = trimesh.creation.box((2.0, 10.0, 2.0))
    body.apply_translation((5.0, 1.0, -3.0))
    folder = Folder(files={"maker/bottle.stl": body.export(file_type="stl")})
    part = {"file": "maker/bottle.stl", "scale": 0.01, "colour": [0.1, 0.2, 0.3]}
    entries = {"bottle": {"up": "y", "category": "bottle", "parts": [part]}}
    found = RuleRunner(tmp_path).run("reference.catalogue", folder=folder, options={"entries": entries})
    thing = found.items["bottle"]
    low, high = thing.surface.vertices.min(axis=0), thing.surface.vertices.max(axis=0)
    assert low == pytest.approx([-0.01, -0.01, 0.0], abs=1e-6)
    assert high == pytest.approx([0.01, 0.01, 0.10], abs=1e-6)
    assert thing.surface.is_closed
    assert thing.matter.mass_kg == pytest.approx(400 * 4e-5, rel=1e-3)
    assert thing.parts["part_0"].mesh.colour == (0.1, 0.2, 0.3)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    entries = {"bottle": {"parts": [{"file": "maker/bottle.stl"}]}}
    with pytest.raises(RuleError, match=r"`bottle` names a file that the folder does not have: `maker/bottle\.stl`"):
        RuleRunner(tmp_path).run(
            "reference.catalogue", folder=Folder(files={"maker/cup.stl": b""}), options={"entries": entries}
        )


def test_a_file_that_is_no_mesh_is_named(tmp_path: Path) -> None:
    entries = {"bottle": {"parts": [{"file": "maker/bottle.stl"}]}}
    with pytest.raises(RuleError, match=r"`bottle\.stl` cannot be read as a mesh"):
        RuleRunner(tmp_path).run(
            "reference.catalogue", folder=Folder(files={"maker/bottle.stl": b"solid"}), options={"entries": entries}
        )


@pytest.mark.slow
def test_pieces_fill_a_thing_and_leave_its_cavity_open(tmp_path: Path) -> None:
    outside, inside = solids.box((0.1, 0.1, 0.1), (0, 0, 0.05)), solids.box((0.08, 0.08, 0.1), (0, 0, 0.07))
    cup = solids.difference(outside, inside)
    plain = block((0.1, 0.1, 0.1))
    mesh = plain.surface.model_copy(
        update={"vertices": cup.vertices.astype(np.float32), "faces": cup.faces.astype(np.int32)}
    )
    thing = plain.model_copy(
        update={"surface": mesh, "parts": {"part_0": plain.parts["part_0"].model_copy(update={"mesh": mesh})}}
    )
    runner = RuleRunner(tmp_path)
    cut = runner.run("reference.convex_pieces", thing=thing).parts["part_0"].pieces
    hulls = [trimesh.convex.convex_hull(piece.vertices) for piece in cut]
    assert sum(hull.volume for hull in hulls) == pytest.approx(cup.volume, rel=0.15)
    assert not any(hull.contains([[0.0, 0.0, 0.06]])[0] for hull in hulls)
    assert len(runner.run("reference.convex_pieces", thing=plain).parts["part_0"].pieces) == 1
