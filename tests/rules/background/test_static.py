"""Taking objects out: the empty table is known, so what is filled in can be compared with it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import cv2
import numpy as np
import pytest

from dextera_build.artifacts.cameras.camera import Camera, Capture
from dextera_build.artifacts.cameras.image import LabelImage
from dextera_build.artifacts.objects.object import Support
from dextera_build.artifacts.objects.view import InstanceMap
from dextera_build.artifacts.scenes.scene import Background
from dextera_build.errors import RuleError
from dextera_build.geometry import cameras, raycast, regions, transforms
from dextera_build.rule import Context, Options
from rules.background import static_planes, static_stub
from rules.background.boxes import support_box
from rules.background.layers import apart, split
from rules.background.static import StaticOptions, static
from rules.background.surface import plane_depth
from tests import factories

LENS = factories.camera(320, 240)
CAPTURES = Path(__file__).parents[4] / "shared" / "captures"


def striped_table() -> tuple[Capture, Support]:
    """A table with fine stripes along y, seen in perspective, no objects."""
    table = factories.support(0.45)
    bare = factories.capture(LENS, table)
    points = transforms.apply(table.camera_pose.matrix, cameras.backproject(bare.measured.depth.depth, LENS.matrix()))
    wave = 18 * np.sin(points[..., 0] * 2 * np.pi / 0.03)
    light = 20 * points[..., 1]
    pixels = np.clip(np.array([168, 140, 110]) + (wave + light)[..., None], 0, 255).astype(np.uint8)
    return factories.rgbd(pixels, bare.measured.depth.depth, LENS), table


def with_box(empty: Capture, table: Support, *, shadow: bool = True) -> tuple[Capture, np.ndarray]:
    """The capture with a red box on the table, and its mask."""
    box = factories.box_mesh((-0.06, -0.05, 0.0), (0.06, 0.05, 0.12))
    seen = raycast.render(
        [raycast.Surface(box.vertices, box.faces)], LENS.matrix(), table.camera_pose.matrix, LENS.height, LENS.width
    )
    mask = seen.index >= 0
    pixels = empty.photograph.rgb.pixels.astype(np.float64)
    if shadow:
        soft = cv2.GaussianBlur(np.roll(mask, 12, axis=1).astype(np.float64), (0, 0), 6.0)
        pixels *= 1.0 - 0.35 * soft[..., None]
    pixels[mask] = (200, 30, 30)
    depth = np.where(mask, seen.depth, empty.measured.depth.depth).astype(np.float32)
    return factories.rgbd(pixels.astype(np.uint8), depth, LENS), mask


def segmented(mask: np.ndarray) -> InstanceMap:
    return InstanceMap(labels=mask.astype(np.int32), fixed=np.zeros_like(mask))


def context_of(backend: ModuleType, path: Path) -> Context:
    return Context(backend, static_planes.PlanesOptions() if backend is static_planes else Options(), scratch=path)


def build(capture: Capture, table: Support, mask: np.ndarray, path: Path, backend: ModuleType) -> Background:
    return static(
        context_of(backend, path), capture.photograph, table, segmented(mask), capture.measured, options=StaticOptions()
    )


@pytest.fixture(scope="module")
def cleaned(tmp_path_factory: pytest.TempPathFactory) -> tuple[Capture, Support, np.ndarray, Background]:
    empty, table = striped_table()
    capture, mask = with_box(empty, table)
    return empty, table, mask, build(capture, table, mask, tmp_path_factory.mktemp("s"), static_planes)


@pytest.mark.medium
def test_neither_ghost_nor_shadow_remains(cleaned: tuple[Capture, Support, np.ndarray, Background]) -> None:
    empty, table, mask, background = cleaned
    shadowed, _ = with_box(empty, table)
    wide = cv2.dilate(mask.astype(np.uint8), np.ones((41, 41), np.uint8)) > 0
    blurred = [
        cv2.GaussianBlur(p.astype(np.float32), (0, 0), 5.0)
        for p in (background.image.pixels, empty.photograph.rgb.pixels)
    ]
    error = np.abs(blurred[0] - blurred[1]).mean(axis=-1)[wide]
    shadow = cv2.GaussianBlur(shadowed.photograph.rgb.pixels.astype(np.float32), (0, 0), 5.0)
    before = np.abs(shadow - blurred[1]).mean(axis=-1)
    assert before[wide].mean() > 20
    assert error.mean() < 4
    assert error.max() < 15


def test_the_hole_has_the_tables_texture(cleaned: tuple[Capture, Support, np.ndarray, Background]) -> None:
    empty, _, mask, background = cleaned
    inner = cv2.erode(mask.astype(np.uint8), np.ones((9, 9), np.uint8)) > 0

    def contrast(pixels: np.ndarray) -> float:
        grey = pixels.astype(np.float32).mean(axis=-1)
        return float((grey - cv2.GaussianBlur(grey, (0, 0), 6.0))[inner].std())

    assert contrast(background.image.pixels) == pytest.approx(contrast(empty.photograph.rgb.pixels), rel=0.35)


def test_far_pixels_are_untouched(cleaned: tuple[Capture, Support, np.ndarray, Background]) -> None:
    empty, _, mask, background = cleaned
    far = cv2.dilate(mask.astype(np.uint8), np.ones((161, 161), np.uint8)) == 0
    assert far.mean() > 0.2
    assert (background.image.pixels == empty.photograph.rgb.pixels)[far].all()


def test_depth_behind_the_object_is_the_plane(cleaned: tuple[Capture, Support, np.ndarray, Background]) -> None:
    empty, _, mask, background = cleaned
    np.testing.assert_allclose(background.depth.depth[mask], empty.measured.depth.depth[mask], atol=1e-3)


@pytest.mark.medium
def test_a_thing_across_the_picture_does_not_part_the_table(tmp_path: Path) -> None:
    empty, table = striped_table()
    mask = np.zeros((LENS.height, LENS.width), bool)
    mask[:, 200:250] = True
    mask[100:140, 250:290] = True  # reaches into the smaller part
    depth = np.where(mask, 0.9 * empty.measured.depth.depth, empty.measured.depth.depth)
    capture = factories.rgbd(empty.photograph.rgb.pixels, depth.astype(np.float32), LENS)
    made = build(capture, table, mask, tmp_path, static_planes).depth.depth
    points = transforms.apply(table.camera_pose.matrix, cameras.backproject(empty.measured.depth.depth, LENS.matrix()))
    hidden = mask & regions.inside_convex(points[..., :2], table.polygon)
    assert (made[hidden] == 0).mean() <= 0.01


@pytest.mark.medium
def test_the_table_goes_on_behind_a_thing_farther_than_depth_was_measured(tmp_path: Path) -> None:
    """Depth ends in the middle of the table, whose light changes farther away by more than one colour may differ."""
    empty, table = striped_table()
    points = transforms.apply(table.camera_pose.matrix, cameras.backproject(empty.measured.depth.depth, LENS.matrix()))
    far = points[..., 1] > 0.05
    lit = empty.photograph.rgb.pixels + 60.0 * np.clip(points[..., 1:2] - 0.05, 0.0, None)
    mask = np.zeros((LENS.height, LENS.width), bool)
    mask[40:140, 130:180] = True
    depth = np.where(mask, 0.5, np.where(far, 0.0, empty.measured.depth.depth)).astype(np.float32)
    lit[mask] = (200, 30, 30)
    near = table.model_copy(update={"polygon": table.polygon * [1.0, 0.5] - [0.0, 0.2]})
    capture = factories.rgbd(np.clip(lit, 0, 255).astype(np.uint8), depth, LENS)
    made = build(capture, near, mask, tmp_path, static_planes)
    np.testing.assert_allclose(made.depth.depth[mask], empty.measured.depth.depth[mask], atol=1e-3)
    # The collision box ends where the table was seen to.
    assert made.boxes[0].centre[1] + made.boxes[0].half_size[1] < 0.45


def test_the_surface_lies_exactly_on_the_support_and_faces_up(
    cleaned: tuple[Capture, Support, np.ndarray, Background],
) -> None:
    mesh = cleaned[3].mesh
    assert (mesh.vertices[:, 2] == 0.0).all()
    corners = mesh.vertices[mesh.faces].astype(np.float64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (normals[:, 2] > 0).all()


def test_the_surface_rendered_from_the_camera_is_the_cleaned_picture(
    cleaned: tuple[Capture, Support, np.ndarray, Background],
) -> None:
    _, table, _, background = cleaned
    mesh = background.mesh
    assert mesh.texture is not None
    surface = raycast.Surface(mesh.vertices, mesh.faces, mesh.uv, mesh.texture.pixels)
    seen = raycast.render([surface], LENS.matrix(), table.camera_pose.matrix, LENS.height, LENS.width)
    picture = raycast.shade([surface], seen)
    hit = seen.index >= 0
    assert hit.mean() > 0.5
    difference = np.abs(picture.astype(int) - background.image.pixels.astype(int)).max(axis=-1)
    assert np.quantile(difference[hit], 0.95) < 12


def test_the_box_covers_the_polygon_with_its_top_at_zero(
    cleaned: tuple[Capture, Support, np.ndarray, Background],
) -> None:
    _, table, _, background = cleaned
    box = background.boxes[0]
    assert box.centre[2] + box.half_size[2] == pytest.approx(0.0, abs=1e-12)
    assert (np.abs(table.polygon - box.centre[:2]) + 0.09 < box.half_size[:2]).all()


@pytest.mark.medium
def test_the_same_input_gives_the_same_bytes(
    cleaned: tuple[Capture, Support, np.ndarray, Background], tmp_path: Path
) -> None:
    empty, table, mask, background = cleaned
    capture, _ = with_box(empty, table)
    again = build(capture, table, mask, tmp_path, static_planes)
    stored: list[list[bytes]] = [[], []]
    for value, blobs in zip((background, again), stored, strict=True):
        value.encode(lambda data, blobs=blobs: (blobs.append(data), str(len(blobs)))[1])
    assert stored[0] == stored[1]


def test_a_tilted_table_gets_the_smallest_box() -> None:
    turn = np.array([[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]])
    corners = np.array([[-0.4, -0.2], [0.4, -0.2], [0.4, 0.2], [-0.4, 0.2]]) @ turn.T + [0.1, 0.3]
    box = support_box(corners, 0.0, 0.04)
    assert sorted(box.half_size) == pytest.approx([0.02, 0.2, 0.4])
    assert box.centre == pytest.approx((0.1, 0.3, -0.02))
    local = (corners - box.centre[:2]) @ np.array(
        [[np.cos(box.yaw), -np.sin(box.yaw)], [np.sin(box.yaw), np.cos(box.yaw)]]
    )
    np.testing.assert_allclose(np.abs(local), np.tile(box.half_size[:2], (4, 1)), atol=1e-9)


def test_rays_above_the_horizon_never_meet_the_plane() -> None:
    depth = plane_depth(LENS, factories.look_at((0.0, -1.0, 0.3), (0.0, 0.0, 0.3)))
    assert np.isinf(depth[:100]).all()
    assert np.isfinite(depth[-20:]).all()


@pytest.mark.medium
@pytest.mark.parametrize("backend", [static_stub, static_planes])
def test_every_backend_keeps_the_contract(backend: ModuleType, tmp_path: Path) -> None:
    empty, table = striped_table()
    capture, mask = with_box(empty, table)
    context = context_of(backend, tmp_path)
    result = static(context, capture.photograph, table, segmented(mask), capture.measured, options=StaticOptions())
    assert result.image.pixels.shape == capture.photograph.rgb.pixels.shape
    assert not (result.image.pixels[mask] == (200, 30, 30)).all(axis=-1).any()
    assert context.outcome.previews
    assert "taken out" in context.outcome.line


@pytest.mark.medium
@pytest.mark.parametrize("backend", [static_stub, static_planes])
def test_nothing_to_take_out_leaves_the_photograph(backend: ModuleType, tmp_path: Path) -> None:
    empty, table = striped_table()
    result = build(empty, table, np.zeros((240, 320), bool), tmp_path, backend)
    assert (result.image.pixels == empty.photograph.rgb.pixels).all()


@pytest.mark.medium
def test_a_hole_as_large_as_the_picture_still_gives_a_surface(tmp_path: Path) -> None:
    empty, table = striped_table()
    result = build(empty, table, np.ones((240, 320), bool), tmp_path, static_planes)
    assert len(result.mesh.faces)


@pytest.mark.medium
def test_beyond_the_supports_edge_the_wall_is_filled_with_wall(tmp_path: Path) -> None:
    empty, table = striped_table()
    points = transforms.apply(table.camera_pose.matrix, cameras.backproject(empty.measured.depth.depth, LENS.matrix()))
    rays = cameras.rays(LENS.height, LENS.width, LENS.matrix()) @ table.camera_pose.matrix[:3, :3].T
    wall = (points[..., 1] > 0.45) | (empty.measured.depth.depth == 0)
    depth = np.where(wall, (0.45 - table.camera_pose.matrix[1, 3]) / rays[..., 1], empty.measured.depth.depth).astype(
        np.float32
    )
    pixels = np.where(wall[..., None], np.array([60, 80, 200], np.uint8), empty.photograph.rgb.pixels)
    room = factories.rgbd(pixels, depth, LENS)
    edge = int(np.flatnonzero(~wall[:, 160]).min())
    mask = np.zeros_like(wall)
    mask[edge - 40 : edge + 40, 130:190] = True
    result = build(room, table, mask, tmp_path, static_planes)
    blue = result.image.pixels[..., 2].astype(int) - result.image.pixels[..., 0]
    assert (blue[edge - 40 : edge - 4, 135:185] > 60).mean() > 0.97
    assert (blue[edge + 4 : edge + 40, 135:185] < 0).mean() > 0.97


@pytest.mark.medium
def test_a_plate_level_with_the_table_does_not_widen_it(tmp_path: Path) -> None:
    """A robot's plate behind the table has the height of its top; the wood ends where it was seen to end."""
    empty, table = striped_table()
    pose, level = table.camera_pose.matrix, empty.measured.depth.depth
    points = transforms.apply(pose, cameras.backproject(level, LENS.matrix()))
    down = cameras.rays(LENS.height, LENS.width, LENS.matrix()) @ pose[:3, :3].T
    plate = (level > 0) & (abs(points[..., 0]) < 0.12) & (abs(points[..., 1] - 0.4) < 0.1)
    floor = ((points[..., 1] > 0.3) & ~plate) | (level == 0)
    deep = np.where(down[..., 2] < -0.05, (pose[2, 3] + 0.7) / np.maximum(-down[..., 2], 0.05), 0.0)
    depth = np.where(floor, deep, level).astype(np.float32)
    pixels = np.where(floor[..., None], np.array([60, 80, 200], np.uint8), empty.photograph.rgb.pixels)
    pixels = np.where(plate[..., None], np.array([40, 42, 48], np.uint8), pixels)
    edge = int(np.flatnonzero(points[:, 100, 1] <= 0.3).min())
    mask = np.zeros_like(floor)
    mask[edge - 12 : edge + 30, 90:115] = True  # a thing that hides a piece of the table's back edge, beside the plate
    result = build(factories.rgbd(pixels.astype(np.uint8), depth, LENS), table, mask, tmp_path, static_planes)
    blue = result.image.pixels[..., 2].astype(int) - result.image.pixels[..., 0]
    assert (blue[edge - 10 : edge - 3, 93:112] > 0).all()
    assert (blue[edge + 3 : edge + 28, 93:112] < 0).mean() > 0.97
    assert abs(result.boxes[0].centre[1] + result.boxes[0].half_size[1] - 0.3) < 0.05


def test_a_sheet_at_the_edge_is_a_part_of_the_table() -> None:
    empty, table = striped_table()
    pose = table.camera_pose.matrix
    points = transforms.apply(pose, cameras.backproject(empty.measured.depth.depth, LENS.matrix()))
    whole = split(empty.photograph, empty.measured.depth.depth, table, np.zeros((240, 320), bool), 0.015)
    sheet = whole.behind & (abs(points[..., 0]) < 0.1) & (points[..., 1] > 0.25)
    beyond = whole.behind & (points[..., 1] > 0.4)
    wood = replace(whole, behind=whole.behind & ~beyond, level=whole.level & ~beyond)
    kept = apart(wood, ~sheet)
    np.testing.assert_array_equal(kept.behind, wood.behind)
    wider = sheet | (beyond & (abs(points[..., 0]) < 0.1))
    plate = replace(wood, behind=wood.behind | wider, level=wood.level | wider)
    assert not apart(plate, ~(wider & beyond)).behind[wider & beyond].any()


@pytest.mark.medium
def test_the_robot_is_taken_out_too(tmp_path: Path) -> None:
    empty, table = striped_table()
    capture, mask = with_box(empty, table, shadow=False)
    nothing = segmented(np.zeros_like(mask))
    robot = LabelImage(labels=mask.astype(np.int32))
    context = Context(static_planes, static_planes.PlanesOptions(), scratch=tmp_path)
    result = static(context, capture.photograph, table, nothing, capture.measured, robot, options=StaticOptions())
    assert (
        np.abs(
            result.image.pixels[mask].astype(float).mean(axis=0) - empty.photograph.rgb.pixels[mask].mean(axis=0)
        ).max()
        < 8
    )


@pytest.mark.medium
@pytest.mark.parametrize("backend", [static_stub, static_planes])
def test_what_is_no_object_stays(backend: ModuleType, tmp_path: Path) -> None:
    empty, table = striped_table()
    capture, mask = with_box(empty, table, shadow=False)
    fixed = InstanceMap(labels=np.zeros(mask.shape, np.int32), fixed=mask)
    result = static(
        context_of(backend, tmp_path), capture.photograph, table, fixed, capture.measured, options=StaticOptions()
    )
    assert (result.image.pixels == capture.photograph.rgb.pixels).all()


@pytest.mark.parametrize("backend", [static_stub, static_planes])
def test_a_robot_of_another_picture_is_refused(backend: ModuleType, tmp_path: Path) -> None:
    empty, table = striped_table()
    nothing = segmented(np.zeros((240, 320), bool))
    robot = LabelImage(labels=np.zeros((10, 10), np.int32))
    with pytest.raises(RuleError, match="of another picture"):
        static(
            context_of(backend, tmp_path),
            empty.photograph,
            table,
            nothing,
            empty.measured,
            robot,
            options=StaticOptions(),
        )


@pytest.mark.medium
@pytest.mark.parametrize("backend", [static_stub, static_planes])
def test_without_depth_the_support_is_the_surface(backend: ModuleType, tmp_path: Path) -> None:
    empty, table = striped_table()
    capture, mask = with_box(empty, table, shadow=False)
    context = context_of(backend, tmp_path)
    result = static(context, capture.photograph, table, segmented(mask), options=StaticOptions())
    assert result.asset_source == "rgb"
    assert np.abs(result.mesh.vertices[:, 2]).max() < 1e-6
    np.testing.assert_allclose(result.depth.depth[mask], empty.measured.depth.depth[mask], atol=1e-3)
    assert (result.image.pixels[mask] != capture.photograph.rgb.pixels[mask]).any(axis=-1).mean() > 0.9


def test_a_segmentation_of_another_size_is_refused(tmp_path: Path) -> None:
    empty, table = striped_table()
    with pytest.raises(RuleError, match="of another picture"):
        build(empty, table, np.zeros((10, 10), bool), tmp_path, static_stub)


@pytest.mark.slow
def test_a_real_table_loses_its_object(tmp_path: Path) -> None:
    folder = CAPTURES / "table_mustard"
    if not folder.exists():
        pytest.skip("needs shared/captures/table_mustard")
    from PIL import Image as Pillow

    from rules.align.support.support import SupportOptions, support

    facts = json.loads((folder / "capture.json").read_text())
    lens = Camera(**{name: facts[name] for name in ("width", "height", "fx", "fy", "cx", "cy")})
    depth = np.asarray(Pillow.open(folder / "depth.png")).astype(np.float32) * np.float32(facts["depth_scale_m"])
    pixels = np.array(Pillow.open(folder / "rgb.png").convert("RGB"))
    capture = factories.rgbd(pixels, depth, lens)
    table = support(Context(scratch=tmp_path), capture.photograph, capture.measured, options=SupportOptions())
    world = transforms.apply(table.camera_pose.matrix, cameras.backproject(depth, lens.matrix()))
    mask = (depth > 0) & (world[..., 2] > 0.006) & (world[..., 2] < 0.4)
    mask = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, np.ones((5, 5), np.uint8)) > 0
    result = build(capture, table, mask, tmp_path, static_planes)

    def yellow(picture: np.ndarray) -> int:
        hsv = cv2.cvtColor(picture[150:350, 330:490], cv2.COLOR_RGB2HSV)
        return int(((hsv[..., 0] > 20) & (hsv[..., 0] < 35) & (hsv[..., 1] > 170)).sum())

    assert yellow(pixels) > 5000
    assert yellow(result.image.pixels) < 50
    assert abs(np.median(result.mesh.vertices[:, 2])) < 1e-6
