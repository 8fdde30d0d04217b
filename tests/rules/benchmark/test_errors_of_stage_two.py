"""Errors of calibrations, bases, placements and scenes against known truths, and the table beside their goals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.cameras.calibration import Calibration
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.objects.object import Body, Placement, Support
from dextera_build.artifacts.objects.view import ObjectView
from dextera_build.artifacts.robots.robot_views import RobotViews
from dextera_build.artifacts.scenes.draw import Arrangement, Draw, Sensor, Viewpoint
from dextera_build.artifacts.scenes.scene_fit import SceneFit
from dextera_build.artifacts.scenes.world import World
from dextera_build.artifacts.spatial.joints import Joints
from dextera_build.artifacts.spatial.pose import Pose, Similarity
from dextera_build.artifacts.table import Cell, Column, Table
from dextera_build.errors import RuleError
from dextera_build.geometry import lie, raycast, transforms
from dextera_build.testing import RuleRunner
from rules.benchmark import errors
from tests import factories
from tests.installed import needs
from tests.rules.benchmark.test_scene_alignment_error import EVIDENCE
from tests.rules.reference.drawn_objects import block
from tests.rules.reference.posed import worlds

needs("open3d")
LENS = Camera(width=320, height=240, fx=300.0, fy=300.0, cx=159.5, cy=119.5)
EYE = factories.look_at((0.1, -0.6, 0.5))
ELSEWHERE = transforms.rigid(lie.rotation(np.array([0.0, 0.0, 0.7])), np.array([0.3, -0.2, 0.0]))
"""T_twin_reference: a twin's world has an origin and a heading of its own."""


def cells(table: Table) -> dict[str, tuple[Cell, ...]]:
    """Quantity -> error and region; of the only subject."""
    assert table.columns == errors.COLUMNS
    return {str(row[1]): row[3:] for row in table.rows}


def world() -> World:
    thing = block((0.12, 0.06, 0.04))
    placed = thing.model_copy(
        update={"pose": Pose(parent="reference", child="thing", matrix=factories.pose(0.02, 0.01, 0.0, 0.4))}
    )
    return worlds.world().model_copy(
        update={
            "objects": {"block": placed},
            "camera": LENS,
            "camera_pose": Pose(parent="reference", child="camera", matrix=EYE),
        }
    )


def view(made: World) -> ObjectView:
    thing = made.objects["block"]
    points = transforms.apply(thing.pose.matrix, thing.surface.vertices.astype(np.float64))
    seen = raycast.render([raycast.Surface(points, thing.surface.faces)], LENS.matrix(), EYE, 240, 320)
    return ObjectView(
        rgb=Image(pixels=np.zeros((240, 320, 3), np.uint8)),
        mask=seen.index >= 0,
        occluder=np.zeros((240, 320), bool),
        camera=LENS,
        phrase="block",
    )


def support() -> Support:
    camera = Pose(parent="world", child="camera", matrix=ELSEWHERE @ EYE)
    return factories.support().model_copy(update={"camera_pose": camera})


def placed(asset: Body, made: World, change: np.ndarray, grown: float = 1.0) -> Placement:
    """The true placement in the twin's world, then moved by `change` (4, 4) about the thing's origin, and grown."""
    own = asset.links["base"].mesh.vertices.astype(np.float64)
    thing = made.objects["block"]
    its = thing.surface.vertices.astype(np.float64)
    scale = float(np.linalg.norm(its[1] - its[0]) / np.linalg.norm(own[1] - own[0]))
    left, _, right = np.linalg.svd((its - its.mean(0)).T @ (own - own.mean(0)))
    turn = left @ np.diag([1, 1, np.sign(np.linalg.det(left @ right))]) @ right
    to_thing = transforms.rigid(turn, its.mean(0) - scale * turn @ own.mean(0))
    pose = ELSEWHERE @ thing.pose.matrix @ change @ to_thing
    covariance = np.diag([1e-6] * 3 + [1e-4] * 3)
    return Placement(
        pose=Pose(parent="world", child="object", matrix=pose, covariance=covariance),
        scale=scale * grown,
        scale_sigma=0.01,
        method="known",
    )


def placements(tmp_path: Path, change: np.ndarray, grown: float = 1.0) -> dict[str, tuple[Cell, ...]]:
    run, made = RuleRunner(tmp_path), world()
    asset = run.run("reference.perfect_asset", world=made, view=view(made))
    assert not np.allclose(np.ptp(asset.links["base"].mesh.vertices, axis=0), [0.12, 0.06, 0.04], atol=0.005)
    table = run.run(
        "benchmark.pose_errors",
        world=made,
        assets=Collection[Body](items={"gray_box": asset}),
        placements=Collection[Placement](items={"gray_box": placed(asset, made, change, grown)}),
        support=support(),
    )
    assert {row[0] for row in table.rows} == {"block"}
    return cells(table)


def test_the_true_placement_has_no_error(tmp_path: Path) -> None:
    found = placements(tmp_path, np.eye(4))
    assert found["object"][0] == pytest.approx(0.0, abs=0.01)
    assert found["object angle"][0] == pytest.approx(0.0, abs=0.05)
    assert found["object scale"][0] == pytest.approx(0.0, abs=0.01)
    assert [row[1] for row in found.values()] == [True, True, True]


def test_a_half_turn_of_a_box_is_no_error_and_a_shift_is_its_length(tmp_path: Path) -> None:
    half = transforms.rigid(np.diag([-1.0, -1.0, 1.0]), np.array([0.004, 0.0, 0.0]))
    found = placements(tmp_path, half)
    assert found["object"][0] == pytest.approx(4.0, abs=0.02)
    assert found["object angle"][0] == pytest.approx(0.0, abs=0.05)
    assert found["object"][1] is False


def test_a_quarter_turn_and_another_size_are_errors(tmp_path: Path) -> None:
    quarter = lie.rotation(np.array([0.0, 0.0, np.pi / 2]))
    found = placements(tmp_path, transforms.rigid(quarter, np.zeros(3)), 1.05)
    assert found["object angle"][0] == pytest.approx(90.0, abs=0.1)
    assert found["object angle"][1] is None
    assert found["object scale"][0] == pytest.approx(100 * np.log(1.05), abs=0.01)
    assert found["object scale"][1] is False


def test_a_mask_of_no_thing_is_refused(tmp_path: Path) -> None:
    made = world()
    nothing = np.zeros((240, 320), bool)
    nothing[:20, :20] = True
    with pytest.raises(RuleError, match="no single thing"):
        RuleRunner(tmp_path).run(
            "reference.perfect_asset", world=made, view=view(made).model_copy(update={"mask": nothing})
        )


def calibrated(tmp_path: Path, change: np.ndarray, zero: float = 0.0) -> dict[str, tuple[Cell, ...]]:
    run = RuleRunner(tmp_path)
    names = ("turn", "lean", "roll", "pitch")
    true = Joints(names=names, stamps=np.arange(2.0), positions=np.array([[0.1, 0.2, 0.0, 0.1], [0.4, -0.2, 0.3, 0.0]]))
    read = true.model_copy(update={"positions": true.positions + np.array([zero, 0, 0, 0])})
    capture = factories.capture()
    views = RobotViews(captures={"a": capture, "b": capture}, mount="eye_on_base", joints=read)
    covariance = np.diag([1e-6] * 3 + [1e-6] * 3)
    pose = Pose(parent="base", child="camera", matrix=worlds.truth() @ change, covariance=covariance)
    table = run.run(
        "benchmark.calibration_error",
        world=worlds.world(),
        robot=worlds.robot(),
        views=views,
        postures=true,
        calibration=Calibration(mount="eye_on_base", pose=pose),
    )
    return cells(table)


def test_a_shifted_camera_shifts_the_hand_as_far(tmp_path: Path) -> None:
    found = calibrated(tmp_path, transforms.rigid(np.eye(3), np.array([0.0, 0.003, 0.004])))
    assert found["hand"][0] == pytest.approx(5.0)
    assert found["camera"] == (pytest.approx(5.0), False)
    assert found["camera angle"][0] == pytest.approx(0.0, abs=1e-6)


def test_a_wrong_zero_moves_the_hand_and_not_the_camera(tmp_path: Path) -> None:
    found = calibrated(tmp_path, np.eye(4), zero=0.01)
    assert 0.5 < found["hand"][0] < 5.0
    assert found["camera"] == (pytest.approx(0.0, abs=1e-9), True)


def test_a_base_is_compared_by_height_and_lean(tmp_path: Path) -> None:
    tilt = lie.rotation(np.array([np.radians(1.5), 0.0, 0.0]))
    base = Pose(parent="world", child="base", matrix=transforms.rigid(tilt, np.array([5.0, 7.0, 0.002])))
    found = cells(RuleRunner(tmp_path).run("benchmark.base_error", world=worlds.world(), base=base))
    assert found["base height"] == (pytest.approx(2.0), None)
    assert found["base lean"][0] == pytest.approx(1.5)


def test_a_scene_is_compared_at_its_true_size(tmp_path: Path) -> None:
    first = world()
    viewpoint = Viewpoint(seed=3, distance_m=1.0, pitch_deg=45, roll_deg=0, width_px=640)
    run = RuleRunner(tmp_path)
    moved = run.run("reference.move_camera", world=first, options={"shift_m": [0.1, 0, 0], "turn_deg": [0, -6, 0]})
    true = transforms.invert(moved.camera_pose.matrix) @ first.camera_pose.matrix
    covariance = np.diag([1e-6] * 6 + [1e-6])
    motion = Similarity(parent="camera", child="scene", matrix=true, scale=1.01 / viewpoint.unit, covariance=covariance)
    fit = SceneFit(motion=motion, evidence=EVIDENCE)
    found = cells(run.run("benchmark.scale_error", world=first, moved=moved, fit=fit, viewpoint=viewpoint))
    assert found["scene scale"] == (pytest.approx(100 * np.log(1.01)), False)
    assert found["scene camera"][0] == pytest.approx(1000 * 0.1 * (1 - 1 / 1.01), rel=0.02)
    assert found["scene camera angle"][0] == pytest.approx(0.0, abs=1e-6)


def gathered(*rows: tuple[Cell, ...]) -> Table:
    return Table(title="Errors", columns=(Column(name="case"), *errors.COLUMNS), rows=rows)


def test_goals_are_judged_by_the_median_and_failures_lack_in_the_count(tmp_path: Path) -> None:
    draw = Draw(
        arrangement=Arrangement(seed=1, count=2, contact="apart"),
        viewpoint=Viewpoint(seed=1, distance_m=1.0, pitch_deg=40.0, roll_deg=0.0, width_px=320),
        sensor=Sensor(seed=1, noise=1.0, dropout=0.0),
    )
    ours = gathered(
        ("a", "", "hand", "mm", 1.0, True), ("b", "", "hand", "mm", 3.0, False), ("a", "cup", "object", "mm", 7.0, None)
    )
    table = RuleRunner(tmp_path).run(
        "benchmark.error_limits",
        tables=Collection[Table](items={"ours": ours}),
        drawn=Collection[Draw](items={"a": draw, "b": draw, "c": draw}),
        objects=Table(title="True", columns=(Column(name="case"),), rows=(("a",), ("b",))),
        options={"medians": {"hand": 2.0, "object": 5.0}},
    )
    names = [column.name for column in table.columns]
    hand, thing = (dict(zip(names, row, strict=True)) for row in table.rows)
    assert (hand["Expected"], hand["Count"], hand["Median"], hand["Reached"]) == (3, 2, 2.0, "yes")
    assert (hand["In region"], hand["Region of"]) == (1, 2)
    assert hand["Low"] <= hand["Median"] <= hand["High"]
    assert (thing["Expected"], thing["Count"], thing["Reached"], thing["In region"]) == (2, 1, "no", None)
