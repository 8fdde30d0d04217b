"""evaluate.objects on twins whose faults are known."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.cameras.image import DepthImage, Image, LabelImage
from dextera_build.artifacts.objects.object import Body, Joint, Link, Placement, Support
from dextera_build.artifacts.scenes.scene import Truth, TruthObject
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.artifacts.table import Table
from dextera_build.errors import RuleError
from dextera_build.geometry import raycast, transforms
from dextera_build.testing import RuleRunner
from tests import factories

CAMERA = Camera(width=240, height=160, fx=220.0, fy=220.0, cx=117.7, cy=80.6)
COLOUR = (0.8, 0.2, 0.2)
CORNERS = np.array([[i & 1, i >> 1 & 1, i >> 2 & 1] for i in range(8)], np.float32)
FACES = np.array(
    [
        *([0, 2, 1], [1, 2, 3], [4, 5, 6], [5, 7, 6], [0, 1, 4], [1, 5, 4]),
        *([2, 6, 3], [3, 6, 7], [0, 4, 2], [2, 4, 6], [1, 3, 5], [3, 7, 5]),
    ],
    np.int32,
)
# The truth's world and the twin's differ by a turn and a shift, as they do where a twin finds its own table.
TWIN_FROM_TRUE = transforms.rigid(np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]), np.array([0.3, -0.2, 0.05]))
PLACES = {"left": (-0.25, 0.0, 0.0), "right": (0.15, 0.05, 0.0)}


def box(low: tuple[float, float, float], size: float = 0.1) -> Mesh:
    return Mesh(vertices=(CORNERS * size + np.array(low)).astype(np.float32), faces=FACES, colour=COLOUR)


def look() -> np.ndarray:
    place = np.array([0.0, -0.6, 0.5])
    forward = -place / np.linalg.norm(place)
    right = np.array([1.0, 0.0, 0.0])
    return transforms.rigid(np.stack([right, np.cross(forward, right), forward], axis=1), place)


@dataclass(frozen=True)
class Asset:
    """A body and its place."""

    body: Body
    placement: Placement


def asset(mesh: Mesh, shift: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Asset:
    """A rigid asset that stands in the twin's world where `mesh` stands in the true one, moved by `shift` [m]."""
    return placed(Body(links={"base": Link(mesh=mesh)}, pose=factories.placed(np.eye(4))), shift)


def placed(body: Body, shift: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Asset:
    pose = factories.placed(TWIN_FROM_TRUE @ transforms.rigid(np.eye(3), np.array(shift)))
    return Asset(body, Placement(pose=pose, scale=1.0, method="by hand"))


@pytest.fixture(scope="module")
def truth() -> Truth:
    meshes = {name: box(low) for name, low in PLACES.items()}
    surfaces = [raycast.Surface(m.vertices, m.faces, colour=m.colour) for m in meshes.values()]
    seen = raycast.render(surfaces, CAMERA.matrix(), look(), CAMERA.height, CAMERA.width)
    return Truth(
        objects={name: TruthObject(mesh=mesh, label=i) for i, (name, mesh) in enumerate(meshes.items(), 1)},
        labels=LabelImage(labels=seen.index + 1),
        rgb=Image(pixels=raycast.shade(surfaces, seen)),
        depth=DepthImage(depth=seen.depth.astype(np.float32)),
        camera=CAMERA,
        camera_pose=factories.placed(look(), "camera", "reference"),
    )


def evaluate(
    tmp_path: Path,
    truth: Truth,
    assets: dict[str, Asset],
    camera: Camera = CAMERA,
    scale: str = "depth",
    factor: float = 1.0,
    **options: object,
) -> tuple[Table, RuleRunner]:
    runner = RuleRunner(tmp_path)
    support = Support(
        camera_pose=factories.placed(TWIN_FROM_TRUE @ look(), "camera"),
        polygon=np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]]),
        residual_m=0.0,
        inlier_fraction=1.0,
        scale=scale,
        factor=factor,
    )
    table = runner.run(
        "evaluate.objects",
        truth=truth,
        bodies=Collection[Body](items={name: known.body for name, known in assets.items()}),
        placements=Collection[Placement](items={name: known.placement for name, known in assets.items()}),
        support=support,
        camera=camera,
        options=options,
    )
    return table, runner


def cell(table: Table, row: str, column: str) -> object:
    names = [known.name for known in table.columns]
    return next(cells for cells in table.rows if cells[0] == row)[names.index(column)]


def test_a_perfect_twin_has_perfect_numbers_in_another_world_frame(tmp_path: Path, truth: Truth) -> None:
    table, runner = evaluate(tmp_path, truth, {name: asset(box(low)) for name, low in PLACES.items()})
    for row in ("left", "right", "mean"):
        assert cell(table, row, "Mask IoU") == pytest.approx(1.0, abs=0.005)
        assert cell(table, row, "Boundary F1") == 1.0
        assert cell(table, row, "F-score@1cm") == 1.0
        for column in ("RGB MAE", "Delta E76", "Depth MAE", "Centroid", "Chamfer-L1"):
            assert cell(table, row, column) == pytest.approx(0.0, abs=1e-4)
    assert cell(table, "count", "Mask IoU") == 2
    assert runner.outcome.line.startswith("2 of 2 found, 0 spurious")


def test_a_lifted_box_is_off_by_the_lift(tmp_path: Path, truth: Truth) -> None:
    twins = {name: asset(box(low), (0.0, 0.0, 0.02)) for name, low in PLACES.items()}
    table, _ = evaluate(tmp_path, truth, twins)
    assert cell(table, "left", "Centroid") == pytest.approx(0.02, abs=1e-6)
    # Two faces of six move by 0.02 along their normal; the others slide in their own plane.
    assert 0.02 * 2 / 6 < cell(table, "left", "Chamfer-L1") < 0.02 * 0.6  # type: ignore[operator]
    assert cell(table, "left", "F-score@1cm") < 0.85  # type: ignore[operator]
    assert cell(table, "left", "Depth MAE") > 0.003  # type: ignore[operator]


def test_colours_are_compared_in_srgb(tmp_path: Path, truth: Truth) -> None:
    other = {name: asset(box(low).model_copy(update={"colour": (0.8, 0.2, 0.5)})) for name, low in PLACES.items()}
    table, _ = evaluate(tmp_path, truth, other)
    assert cell(table, "mean", "RGB MAE") == pytest.approx(0.1, abs=0.002)


def test_missed_and_spurious_things_are_counted_never_dropped(tmp_path: Path, truth: Truth) -> None:
    twins = {"thing_1": asset(box(PLACES["left"])), "ghost": asset(box((0.0, 0.3, 0.0)))}
    table, runner = evaluate(tmp_path, truth, twins)
    assert cell(table, "left", "Asset") == "thing_1"
    assert cell(table, "right", "Asset") == "missed"
    assert cell(table, "right", "Mask IoU") == 0.0
    assert cell(table, "right", "Chamfer-L1") is None
    assert cell(table, "mean", "Mask IoU") == pytest.approx(0.5, abs=0.005)
    assert cell(table, "mean", "F-score@1cm") == 1.0
    assert (cell(table, "count", "Mask IoU"), cell(table, "count", "Chamfer-L1")) == (2, 1)
    assert runner.outcome.metrics["missed"] == (1.0, "")
    assert runner.outcome.metrics["spurious"] == (1.0, "")
    assert "1 missed; 1 spurious assets (ghost)" in table.notes[0]


def test_a_twin_without_any_asset_scores_zero(tmp_path: Path, truth: Truth) -> None:
    table, runner = evaluate(tmp_path, truth, {})
    assert cell(table, "mean", "Mask IoU") == 0.0
    assert cell(table, "mean", "Depth MAE") is None
    assert runner.outcome.line.startswith("0 of 2 found")


def test_links_stand_where_their_joints_put_them(tmp_path: Path, truth: Truth) -> None:
    hinge = Joint(
        name="hinge",
        type="revolute",
        parent="base",
        child="lid",
        origin=PLACES["left"],
        axis=(0.0, 1.0, 0.0),
        lower=-2.0,
        upper=2.0,
        position=0.7,
    )
    lid = box(PLACES["left"])
    c, s = np.cos(-0.7), np.sin(-0.7)
    turn = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    back = transforms.rigid(turn, np.array(PLACES["left"]) - turn @ np.array(PLACES["left"]))
    folded = lid.model_copy(update={"vertices": transforms.apply(back, lid.vertices).astype(np.float32)})
    speck = box((-0.2, 0.05, 0.04), 0.001)
    body = Body(
        links={"base": Link(mesh=speck), "lid": Link(mesh=folded)}, joints=(hinge,), pose=factories.placed(np.eye(4))
    )
    table, _ = evaluate(tmp_path, truth, {"a": placed(body), "b": asset(box(PLACES["right"]))})
    assert cell(table, "left", "Mask IoU") == pytest.approx(1.0, abs=0.005)
    assert cell(table, "left", "Chamfer-L1") == pytest.approx(0.0, abs=2e-3)  # the speck of a base lies inside


def test_the_paper_row_and_the_definitions_are_printed(tmp_path: Path, truth: Truth) -> None:
    table, _ = evaluate(tmp_path, truth, {})
    assert cell(table, "paper, Ours: mean", "Mask IoU") == 0.731
    assert cell(table, "paper, Ours: mean", "F-score@1cm") == 0.906
    notes = " ".join(table.notes)
    for word in (
        "tolerance 3 px at 240 x 160 px",
        "half the sum",
        "by area, seed 0",
        "sRGB",
        "Table II",
        "86 instances",
    ):
        assert word in notes


def test_another_camera_is_refused(tmp_path: Path, truth: Truth) -> None:
    other = CAMERA.model_copy(update={"fx": 300.0})
    with pytest.raises(RuleError, match="the truth was seen through another camera"):
        evaluate(tmp_path, truth, {}, other)


def test_the_table_says_what_the_assets_were_made_from(tmp_path: Path, truth: Truth) -> None:
    twins = {name: asset(box(low)) for name, low in PLACES.items()}
    twins["left"] = replace(twins["left"], body=twins["left"].body.model_copy(update={"asset_source": "rgbd"}))
    table, _ = evaluate(tmp_path, truth, twins)
    made = {row[0]: row[1] for row in table.rows}
    assert made["mean"] == "1 asset, rgb; 1 asset, rgbd"
    assert made["paper, Ours: mean"] == "86 instances, rgb"
    assert any("rgbd: made with the help of the photograph's depth" in note for note in table.notes)


def test_a_twin_of_unknown_scale_is_not_compared(tmp_path: Path, truth: Truth) -> None:
    with pytest.raises(RuleError, match="the scale of this twin is unknown, so it cannot be compared") as caught:
        evaluate(tmp_path, truth, {name: asset(box(low)) for name, low in PLACES.items()}, scale="unknown")
    assert "`size_m` of `align.scale`" in str(caught.value.hint)


def test_bodies_are_scaled_as_assets_are(tmp_path: Path, truth: Truth) -> None:
    # In the unit of the placement all lengths are half as long; `factor` makes them metres.
    def halved(low: tuple[float, float, float]) -> Asset:
        small = box(low).model_copy(update={"vertices": box(low).vertices / np.float32(4.0)})
        pose = TWIN_FROM_TRUE.copy()
        pose[:3, 3] /= 2.0
        body = Body(links={"base": Link(mesh=small)}, pose=factories.placed(np.eye(4)))
        return Asset(body, Placement(pose=factories.placed(pose), scale=2.0, method="by hand"))

    table, _ = evaluate(tmp_path, truth, {name: halved(low) for name, low in PLACES.items()}, factor=2.0)
    assert cell(table, "mean", "Mask IoU") == pytest.approx(1.0, abs=0.005)
    assert cell(table, "mean", "Centroid") == pytest.approx(0.0, abs=1e-5)


def test_objects_that_are_mostly_hidden_do_not_count(tmp_path: Path, truth: Truth) -> None:
    # A cover hides all but a strip of the left box.
    labels = truth.labels.labels.copy()
    columns = np.flatnonzero((labels == 1).any(axis=0))
    labels[:, columns[0] : columns[-len(columns) // 5]] = 0
    covered = truth.model_copy(update={"labels": LabelImage(labels=labels)})
    table, _ = evaluate(tmp_path, covered, {"right": asset(box(PLACES["right"]))})
    assert cell(table, "right", "Visible") == pytest.approx(1.0, abs=0.05)
    assert cell(table, "left", "Asset") == "missed"
    assert 0.1 < cell(table, "left", "Visible") < 0.35  # type: ignore[operator]
    table, runner = evaluate(tmp_path, covered, {"right": asset(box(PLACES["right"]))}, least_visible=0.4)
    assert [row[0] for row in table.rows[:2]] == ["right", "mean"]
    assert runner.outcome.line.startswith("1 of 1 found")
    counted = RuleRunner(tmp_path).run("evaluate.visible", truth=covered, options={"least_visible": 0.4})
    assert [row[0] for row in counted.rows] == ["right"]


def test_an_object_cut_by_the_border_is_partly_visible(tmp_path: Path, truth: Truth) -> None:
    # The picture begins at the middle of the left box.
    first = int(np.median(np.nonzero(truth.labels.labels == 1)[1]))
    half = CAMERA.model_copy(update={"width": CAMERA.width - first, "cx": CAMERA.cx - first})
    surfaces = [raycast.Surface(m.mesh.vertices, m.mesh.faces) for m in truth.objects.values()]
    seen = raycast.render(surfaces, half.matrix(), look(), half.height, half.width)
    cut = truth.model_copy(
        update={
            "labels": LabelImage(labels=seen.index + 1),
            "camera": half,
            "rgb": Image(pixels=raycast.shade(surfaces, seen)),
            "depth": DepthImage(depth=seen.depth.astype(np.float32)),
        }
    )
    table, _ = evaluate(tmp_path, cut, {}, half)
    inside = {name: float((seen.index == n).sum()) for n, name in enumerate(truth.objects)}
    whole = {name: float((truth.labels.labels == n + 1).sum()) for n, name in enumerate(truth.objects)}
    for name, pixels in inside.items():
        assert cell(table, name, "Visible") == pytest.approx(pixels / whole[name], abs=0.04)
    assert 0.3 < inside["left"] / whole["left"] < 0.7
    table, _ = evaluate(tmp_path, cut, {}, half, whole=True)
    assert [row[0] for row in table.rows[:2]] == ["right", "mean"]


def test_without_a_summary_there_are_objects_and_spurious_assets_only(tmp_path: Path, truth: Truth) -> None:
    twins = {"left": asset(box(PLACES["left"])), "ghost": asset(box((0.0, 0.3, 0.0)))}
    table, _ = evaluate(tmp_path, truth, twins, summary=False)
    assert [row[:2] for row in table.rows] == [("left", "left"), ("right", "missed"), ("-", "ghost")]
