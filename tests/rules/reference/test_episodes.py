"""reference.episodes: demonstrations of a twin become episodes of another world, recorded through a cell."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dextera_build.artifacts.objects.object import Asset, Body, Collision, Link, Pieces
from dextera_build.artifacts.robots.cell import Cell
from dextera_build.artifacts.robots.noise import ColourNoise, DepthNoise
from dextera_build.artifacts.shapes.mesh import Hull
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.artifacts.tasks.episode import Episodes, Film, Shard
from dextera_build.artifacts.tasks.task import TaskBundle, View, WorldKind
from dextera_build.errors import RuleError
from dextera_build.geometry import transforms
from dextera_build.policy.layout import of_episodes
from dextera_build.sim.runtime.environment import Environment
from dextera_build.testing import RuleRunner
from tests import factories, gantry, task_bundles
from tests.sim.runtime.cells import CAMERA

HALF = task_bundles.HALF_M
ERROR_M = 0.004
"""Error of the calibration along x of the base."""


def bundle(kind: WorldKind = "twin") -> TaskBundle:
    """Lift the only object, a box."""
    made = task_bundles.lift(reset=gantry.RESET)
    return made.model_copy(update={"kind": kind, "objects": {"box": made.objects["box"]}})


def cell(**changed: Any) -> Cell:
    """A cell without noise, whose calibration is `ERROR_M` off."""
    place = bundle().objects["box"].pose
    mesh = factories.box_mesh((-HALF,) * 3, (HALF,) * 3, colour=(0.5, 0.5, 0.5))
    asset = Asset(
        body=Body(links={"base": Link(mesh=mesh)}, joints=(), pose=place),
        physics=factories.physics({"base": factories.box_inertial((-HALF,) * 3, (HALF,) * 3, 0.1)}),
        collision=Collision(links={"base": Pieces(hulls=(Hull(vertices=mesh.vertices),), method="hull")}),
        pose=place,
        category="box",
    )
    x, y = task_bundles.BOX_M
    eye = factories.look_at((x + 0.45, y - 0.25, 0.4), (x, y, HALF))
    fields: dict[str, Any] = {
        "assets": {"box": asset},
        "camera": CAMERA,
        "mount": Pose(parent="camera", child="base", matrix=transforms.invert(factories.pose(ERROR_M) @ eye)),
        "eye": Pose(parent="base", child="camera", matrix=eye),
        "rate_hz": 10.0,
        "delay_s": 0.0,
        "loss": 0.0,
        "search_s": 1.0,
        "depth_noise": DepthNoise(subpixel_px=0.0, edge_loss=0.0, dropout=0.0, grazing_deg=90.0),
        "colour_noise": ColourNoise(sigma=0.0, vignetting=0.0),
    }
    return Cell(**(fields | changed))


def recorded(folder: Path, count: int, shard: Shard | None = None, **cells: Any) -> tuple[Episodes, RuleRunner]:
    runner = RuleRunner(folder)
    made: Episodes = runner.run(
        "reference.episodes",
        backend="mujoco",
        twin=bundle(),
        world=bundle("reference"),
        sources=gantry.demonstrations(bundle(), 2),
        cell=cell(**cells),
        shard=shard or Shard(first=20, count=count, seed=0),
    )
    return made, runner


@pytest.mark.slow
def test_an_episode_holds_what_the_cell_measures_and_nothing_that_a_simulator_knows(tmp_path: Path) -> None:
    made, runner = recorded(tmp_path, 2)
    assert list(made.items) == ["00020", "00021"]
    assert (made.world, made.attempts, made.tip_names) == ("reference", 2 + len(made.failures), ())
    assert runner.outcome.line.startswith("2 of 2 episodes in the reference world")
    for episode in made.items.values():
        assert (episode.origin, episode.success, episode.contact.shape[1:]) == ("replay", True, (0, 3))
        assert set(episode.sources) <= {"00000", "00001"}
        assert [segment.name for segment in episode.segments][-1] == "lift"
        world = Environment(bundle("reference"))
        world.begin(episode.start)
        seen, true = episode.objects[0, 0, :3], world.object_poses()[0, :3]
        assert seen[0] - true[0] == pytest.approx(ERROR_M, abs=0.002), "the tracker, placed by the calibration"
        assert episode.objects[-1, 0, 2] - seen[2] > 0.08, "the box as it is tracked rises with the hand"
        # The same commands from the same start do the task again.
        for target in episode.executed:
            outcome = world.step(target)
        assert outcome.success
    first = {"items": dict([*made.items.items()][:1])}
    film = _film(tmp_path, made.model_copy(update=first))
    (pixels,) = (film.pixels(name) for name in film.frames)
    assert len(pixels) == len(made.items["00020"].executed)
    assert np.abs(pixels[-1].astype(int) - pixels[0]).max() > 30, "robot and box moved"
    moved = made.items["00020"]
    moved = moved.model_copy(update={"terms": {**moved.terms, "joints": moved.joints + np.float32(0.02)}})
    with pytest.raises(RuleError, match="episode `00020` does not come out again"):
        _film(tmp_path, made.model_copy(update={"items": {"00020": moved}}))
    names = {term.declared.name for term in of_episodes(made, ("rise",)).terms()}
    assert "contact" not in names


def _film(folder: Path, episodes: Episodes) -> Film:
    eye = cell().eye.matrix
    place = factories.placed(task_bundles.WORLD_FROM_BASE @ eye, "camera")
    view = View(camera=CAMERA, camera_pose=place)
    made: Film = RuleRunner(folder).run(
        "demonstrate.recorded_film", backend="mujoco", world=bundle("reference"), episodes=episodes, view=view
    )
    return made


@pytest.mark.slow
def test_a_shard_depends_on_its_index_alone(tmp_path: Path) -> None:
    one, _ = recorded(tmp_path / "1", 1)
    again, _ = recorded(tmp_path / "2", 1)
    other, _ = recorded(tmp_path / "3", 1, Shard(first=21, count=1, seed=0))
    np.testing.assert_array_equal(one.items["00020"].executed, again.items["00020"].executed)
    assert other.items["00021"].start.seed != one.items["00020"].start.seed


def test_failed_attempts_are_kept_apart_with_their_reasons(tmp_path: Path) -> None:
    made, runner = recorded(tmp_path, 1, loss=1.0, search_s=0.2)
    assert (made.items, made.attempts) == ({}, 3)
    assert made.reasons == {"the tracker did not find the object": 3}
    assert {len(episode.action) for episode in made.failures.values()} == {0}
    assert runner.outcome.line == "0 of 1 episodes in the reference world from 3 attempts"


def test_worlds_of_two_tasks_are_refused(tmp_path: Path) -> None:
    with pytest.raises(RuleError, match="`twin` does not hold the task `LiftBox` of the world"):
        RuleRunner(tmp_path).run(
            "reference.episodes",
            backend="stub",
            twin=bundle("reference"),
            world=bundle("reference"),
            sources=gantry.demonstrations(bundle(), 1),
            cell=cell(),
            shard=Shard(first=0, count=1, seed=0),
        )
