"""reference.exchange: something else stands where an object of a reference world stood."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.scenes.world import Thing, World
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.errors import RuleError
from dextera_build.testing import RuleRunner
from tests import factories
from tests.rules.reference.drawn_objects import block

PLACES_M = {"basket": (0.0, 0.1, 0.0), "carton": (0.2, 0.0, 0.0)}


def world() -> World:
    """Two blocks on a table."""
    pose = {name: Pose(parent="reference", child="thing", matrix=factories.pose(*at)) for name, at in PLACES_M.items()}
    return World(
        objects={name: block((0.1, 0.1, 0.1)).model_copy(update={"pose": pose[name]}) for name in PLACES_M},
        fixtures={},
        lamps=(),
        ambient=0.4,
        camera=factories.camera(),
        camera_pose=Pose(parent="reference", child="camera", matrix=factories.look_at((0.0, -0.5, 0.5))),
    )


def exchanged(tmp_path: Path, things: dict[str, Thing], **options: Any) -> World:
    found: World = RuleRunner(tmp_path).run(
        "reference.exchange",
        world=world(),
        things=Collection[Thing](items=things),
        options={"objects": {"basket": {"thing": "crate", "mass_kg": 0.4, **options}}},
    )
    return found


def test_what_replaces_an_object_stands_where_it_stood(tmp_path: Path) -> None:
    found = exchanged(tmp_path, {"crate": block((0.1, 0.06, 0.04))}, yaw_deg=90.0, scale=2.0)
    crate = found.objects["basket"]
    corners = crate.pose.matrix[:3, :3] @ crate.surface.vertices.T + crate.pose.matrix[:3, 3:]
    np.testing.assert_allclose(corners.min(axis=1), [-0.06, 0.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(corners.max(axis=1), [0.06, 0.2, 0.08], atol=1e-6)
    part = crate.parts["part_0"]
    for vertices in (part.mesh.vertices, part.pieces[0].vertices):
        np.testing.assert_allclose(np.ptp(vertices, axis=0), [0.2, 0.12, 0.08], atol=1e-6)
    assert crate.matter is not None
    assert crate.matter.mass_kg == 0.4
    before = world().objects["carton"]
    np.testing.assert_array_equal(found.objects["carton"].surface.vertices, before.surface.vertices)
    np.testing.assert_array_equal(found.objects["carton"].pose.matrix, before.pose.matrix)


def test_what_cannot_stand_there_is_refused(tmp_path: Path) -> None:
    hollow = block((0.1, 0.1, 0.1))
    bare = {name: part.model_copy(update={"pieces": ()}) for name, part in hollow.parts.items()}
    with pytest.raises(RuleError, match="run into each other"):
        exchanged(tmp_path, {"crate": block((0.5, 0.3, 0.1))})
    with pytest.raises(RuleError, match="there is no thing `crate`"):
        exchanged(tmp_path, {"box": hollow})
    with pytest.raises(RuleError, match="has no convex pieces"):
        exchanged(tmp_path, {"crate": hollow.model_copy(update={"parts": bare})})
    surface = hollow.surface.model_copy(update={"faces": hollow.surface.faces[1:]})
    torn = {name: part.model_copy(update={"mesh": surface}) for name, part in hollow.parts.items()}
    with pytest.raises(RuleError, match="is open"):
        exchanged(tmp_path, {"crate": hollow.model_copy(update={"parts": torn})})


def test_repeated_corners_of_a_textured_file_are_one_corner(tmp_path: Path) -> None:
    crate = block((0.1, 0.1, 0.1))
    mesh = crate.parts["part_0"].mesh
    count = len(mesh.faces)
    torn = mesh.model_copy(
        update={
            "vertices": mesh.vertices[mesh.faces].reshape(-1, 3),
            "faces": np.arange(3 * count, dtype=np.int32).reshape(-1, 3),
        }
    )
    assert not torn.is_closed
    parts = {"part_0": crate.parts["part_0"].model_copy(update={"mesh": torn})}
    found = exchanged(tmp_path, {"crate": crate.model_copy(update={"parts": parts})}).objects["basket"]
    whole = found.parts["part_0"].mesh
    assert whole.is_closed
    assert len(whole.faces) == count
    np.testing.assert_allclose(np.sort(whole.vertices, axis=0), np.sort(mesh.vertices, axis=0))
