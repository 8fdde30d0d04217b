"""The support plane against rendered tables whose pose is known."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.errors import RuleError
from dextera_build.geometry import cameras, regions, transforms
from dextera_build.testing import RuleRunner
from rules.align.support import choice, surfaces
from tests import factories, tabletops

BOX = tabletops.box(0.1, 0.08, 0.15, (0.8, 0.2, 0.2))


@pytest.fixture
def runner(tmp_path):
    return RuleRunner(tmp_path)


def error_of(support, truth: np.ndarray) -> tuple[float, float]:
    """Angle between the normals [deg] and difference of the camera's heights [mm]."""
    found = support.camera_pose.matrix
    cosine = np.clip(found[2, :3] @ truth[2, :3], -1, 1)
    return float(np.degrees(np.arccos(cosine))), float(abs(found[2, 3] - truth[2, 3]) * 1000)


@pytest.mark.parametrize("wall", [False, True])
@pytest.mark.parametrize("height", [0.25, 0.55, 1.1])
def test_the_table_is_found_before_floor_and_wall(runner, wall, height):
    eye = factories.look_at((0.1, -0.7, height), (0.0, 0.0, 0.05))
    scene = tabletops.tabletop((BOX, factories.pose(0.05, 0.1, yaw=0.4)), eye=eye, wall=wall, noise=1.0)
    angle, offset = error_of(runner.run("align.support", **factories.shot(scene.capture)), scene.world_from_camera)
    assert angle < 0.3
    assert offset < 1.5


def test_the_world_frame_is_as_documented(runner):
    scene = tabletops.tabletop((BOX, factories.pose()))
    support = runner.run("align.support", **factories.shot(scene.capture))
    pose = support.camera_pose.matrix
    assert np.allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-9)
    right, forward = pose[:3, 0], pose[:3, 2]
    assert right[0] > 0.99
    assert abs(right[1]) < 1e-9, "x is the camera's right projected onto the plane"
    assert forward[1] > 0, "y points away from the camera"
    assert pose[2, 3] > 0, "the camera is above"
    assert regions.area(support.polygon) > 0, "counter-clockwise"
    assert regions.centroid(support.polygon) == pytest.approx([0, 0], abs=1e-6)


def test_the_polygon_is_the_seen_table(runner):
    scene = tabletops.tabletop((BOX, factories.pose(0.05, 0.1)), half=0.25)
    support = runner.run("align.support", **factories.shot(scene.capture))
    assert regions.area(support.polygon) == pytest.approx(0.25, rel=0.06)
    corners = np.array([[-0.25, -0.25, 0], [0.25, 0.25, 0]])
    camera = transforms.apply(transforms.invert(scene.world_from_camera), corners)
    here = transforms.apply(support.camera_pose.matrix, camera)
    assert regions.inside_convex(here[:, :2], support.polygon, 0.02).all()
    assert not regions.inside_convex(here[:, :2] * 1.15, support.polygon, 0.0).any()


def test_a_surface_a_little_lower_is_another_one(runner):
    shelf = factories.box_mesh((0.26, -0.3, -0.3), (0.6, 0.3, -0.02))
    scene = tabletops.tabletop((BOX, factories.pose()), (shelf, factories.pose()), half=0.25, noise=1.0)
    support = runner.run("align.support", **factories.shot(scene.capture))
    assert regions.area(support.polygon) == pytest.approx(0.25, rel=0.06)


def test_the_wall_behind_a_table_is_no_part_of_it(runner):
    """The table's plane cuts through a wall 4 cm behind it, which is wider than the table."""
    wall = factories.box_mesh((-2.0, 0.54, -0.8), (2.0, 0.6, 1.5), colour=(0.9, 0.9, 0.85))
    table = factories.box_mesh((-0.3, -0.5, -0.05), (1.5, 0.5, 0.0), colour=(0.65, 0.5, 0.35))
    scene = tabletops.tabletop(
        *((thing, factories.pose()) for thing in (wall, table)),
        (BOX, factories.pose(0.1, 0.2)),
        eye=factories.look_at((-0.2, -0.8, 0.7), (-0.2, 0.3, -0.1)),
        half=0.001,
        noise=1.0,
    )
    support = runner.run("align.support", **factories.shot(scene.capture))
    angle, offset = error_of(support, scene.world_from_camera)
    assert angle < 0.3
    assert offset < 1.5
    corners = np.column_stack([support.polygon, np.zeros(len(support.polygon))])
    camera = transforms.apply(transforms.invert(support.camera_pose.matrix), corners)
    assert transforms.apply(scene.world_from_camera, camera)[:, 0].min() == pytest.approx(-0.3, abs=0.05)
    assert not runner.outcome.warnings


def test_a_plane_through_the_camera_is_no_surface():
    """Any depth along a few rows of the picture lies in one plane with the camera."""
    rng = np.random.default_rng(0)
    valid = np.zeros((240, 320), bool)
    valid[200:204] = True
    depth = np.where(valid, rng.uniform(0.6, 0.7, valid.shape), 0.0)
    points = cameras.backproject(depth, tabletops.LENS.matrix())
    assert not surfaces.find(points, valid, 1, 0.002, rng)


def test_the_same_capture_gives_the_same_bytes(runner):
    scene = tabletops.tabletop((BOX, factories.pose()))
    first, second = (runner.run("align.support", **factories.shot(scene.capture)) for _ in range(2))
    assert runner.encode(first) == runner.encode(second)


def test_too_little_depth_is_refused(runner):
    blank = np.zeros((60, 80), np.float32)
    blank[:5, :5] = 0.7
    lens = factories.camera(80, 60)
    capture = factories.rgbd(np.zeros((60, 80, 3), np.uint8), blank, lens)
    with pytest.raises(RuleError, match="too little depth to find a support") as caught:
        runner.run("align.support", **factories.shot(capture))
    assert caught.value.facts["pixels"] == "25 within 4 m"


def test_a_wall_alone_is_no_support(runner):
    wall = factories.box_mesh((-3, 0.1, -3), (3, 0.2, 3))
    eye = factories.look_at((0.0, -0.3, 0.0), (0.0, 0.1, -0.15))
    scene = tabletops.tabletop((wall, factories.pose()), eye=eye, half=0.001)
    with pytest.raises(RuleError, match="no support plane is in view") as caught:
        runner.run("align.support", **factories.shot(scene.capture))
    assert "m^2 tilted" in caught.value.facts["planes"]


def level_before_wall(*things, eye=None):
    """A table seen by a level camera, low above it, with a wall that fills most of the picture."""
    wall = factories.box_mesh((-3, 0.45, -0.8), (3, 0.5, 2.0), colour=(0.9, 0.9, 0.85))
    eye = factories.look_at((0.0, -0.5, 0.08), (0.0, 0.4, 0.1)) if eye is None else eye
    return tabletops.tabletop((wall, factories.pose()), *things, eye=eye, noise=1.0)


def test_a_wall_is_not_taken_for_the_table_of_a_level_camera(runner):
    scene = level_before_wall((BOX, factories.pose(0.05, 0.0, yaw=0.4)))
    support = runner.run("align.support", **factories.shot(scene.capture))
    angle, offset = error_of(support, scene.world_from_camera)
    assert angle < 1.0
    assert offset < 4.0
    assert not runner.outcome.warnings


def two_tables():
    """Two tables of one size, one 0.2 m above the other, with a box on each."""
    other = factories.box_mesh((-0.95, -0.5, -0.27), (-0.05, 0.5, -0.2), colour=(0.3, 0.5, 0.3))
    mine = factories.box_mesh((0.0, -0.5, -0.2), (0.9, 0.5, 0.0), colour=(0.65, 0.5, 0.35))
    return tabletops.tabletop(
        (mine, factories.pose()),
        (other, factories.pose()),
        (BOX, factories.pose(0.2, 0.0)),
        (BOX, factories.pose(-0.3, 0.0, -0.2)),
        eye=factories.look_at((0.0, -0.9, 0.75)),
        half=0.001,
        noise=1.0,
    )


def test_two_supports_in_doubt_are_told_with_the_line_that_chooses(runner):
    shot = factories.shot(two_tables().capture)
    first = runner.run("align.support", **shot).camera_pose.matrix[2, 3]
    (warning,) = runner.outcome.warnings
    assert "two surfaces may be the support" in warning
    assert [caption for caption, _ in runner.outcome.previews] == [
        "support (green), and another surface that may be it (orange)"
    ]
    at = [int(number) for number in warning.split("at_px: [")[1].split("]")[0].split(",")]
    second = runner.run("align.support", **shot, options={"at_px": at}).camera_pose.matrix[2, 3]
    assert abs(first - second) == pytest.approx(0.2, abs=0.005)
    assert not runner.outcome.warnings


def test_a_stated_pixel_is_one_of_the_picture_as_it_was_taken(runner):
    """Of a camera that hung upside down, stating the surface that is found without it changed which side is up."""
    capture = tabletops.tabletop((BOX, factories.pose()), noise=1.0).capture
    assert capture.measured is not None
    pixels, depth = (
        np.ascontiguousarray(np.rot90(each, 2))
        for each in (capture.photograph.rgb.pixels, capture.measured.depth.depth)
    )
    shot = factories.shot(factories.rgbd(pixels, depth, capture.photograph.camera.turned(2)))
    found = runner.run("align.support", **shot)
    middle = np.array([0.25, 0.0, 0.0, 1.0])
    x, y, z = (np.linalg.inv(found.camera_pose.matrix) @ middle)[:3]
    at = shot["photograph"].camera.project(np.array([[x, y, z]]))[0]
    again = runner.run("align.support", **shot, options={"at_px": [int(each) for each in at]})
    assert runner.encode(again) == runner.encode(found)


def test_a_stated_pixel_without_a_surface_is_refused(runner):
    scene = tabletops.tabletop((tabletops.box(0.3, 0.3, 0.3, (0.8, 0.2, 0.2)), factories.pose()), half=0.3)
    assert scene.capture.measured is not None
    depth = scene.capture.measured.depth.depth.copy()
    depth[:80] = 0.0
    capture = factories.rgbd(scene.capture.photograph.rgb.pixels, depth, scene.capture.photograph.camera)
    with pytest.raises(RuleError, match="no flat surface is at the stated pixel") as caught:
        runner.run("align.support", **factories.shot(capture), options={"at_px": [10, 5]})
    assert caught.value.facts["at_px"] == "[10, 5]"


def flat(normal: tuple[float, float, float], height: float, pixels: int, carried: float) -> surfaces.Surface:
    """A square of 1 m^2, `pixels` of it seen, at `height` below the camera along its normal [m]."""
    region = np.zeros(1000, bool)
    region[:pixels] = True
    square = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
    return surfaces.Surface((np.array(normal), height), region.reshape(20, 50), square, 0.0, carried)


def test_gravity_tells_a_level_table_from_a_leaning_board():
    table, board = flat((0.0, -0.8, -0.6), 0.5, 300, 0.1), flat((0.0, -0.2, -0.98), 0.9, 500, 0.1)
    assert choice.choose([table, board], 0.02) is board
    assert choice.rival([table, board], board, 0.02) is table
    up = np.array([0.0, -0.8, -0.6])
    assert choice.choose([table, board], 0.02, up=up) is table
    assert choice.rival([table, board], table, 0.02, up=up) is None
    assert choice.choose([table, board], 0.02, up=-up) is None


def test_upright_lines_weigh_against_a_leaning_board_but_do_not_exclude_it():
    table, board = flat((0.0, -0.8, -0.6), 0.5, 300, 0.1), flat((0.0, -0.2, -0.98), 0.9, 500, 0.1)
    up = np.array([0.0, -0.8, -0.6])
    assert choice.choose([table, board], 0.02, likely=up) is table
    assert choice.choose([board], 0.02, likely=up) is board
    assert choice.choose([table, flat((0.0, -0.2, -0.98), 0.9, 900, 0.1)], 0.02, likely=up) is not table


def test_the_support_carries_something():
    """A small table is before a large floor, and before the empty seat of a chair beside it."""
    table, seat = flat((0.0, -0.8, -0.6), 0.75, 100, 0.2), flat((0.0, -0.8, -0.6), 0.95, 250, 0.0)
    floor = flat((0.0, -0.8, -0.6), 1.45, 380, 0.0)
    assert choice.choose([floor, seat, table], 0.02) is table


def test_gravity_of_the_wrong_sign_is_told(runner):
    scene = tabletops.tabletop((BOX, factories.pose()), noise=1.0)
    photo, measured = scene.capture.photograph, scene.capture.measured
    assert measured is not None
    down = tuple(-float(x) for x in scene.world_from_camera[2, :3])
    right = photo.model_copy(update={"gravity": down})
    found = runner.run("align.support", photograph=right, measured=measured)
    assert runner.encode(found) == runner.encode(runner.run("align.support", photograph=photo, measured=measured))
    wrong = photo.model_copy(update={"gravity": tuple(-x for x in down)})
    with pytest.raises(RuleError, match="no support plane is in view") as caught:
        runner.run("align.support", photograph=wrong, measured=measured)
    assert "negate `gravity`" in (caught.value.hint or "")


@pytest.mark.medium
def test_the_base_of_a_robot_tells_what_is_level_if_it_stands_on_a_surface(runner):
    scene = tabletops.tabletop((BOX, factories.pose()), noise=1.0)
    base = transforms.invert(scene.world_from_camera)
    shot = factories.shot(scene.capture)
    plain = runner.run("align.support", **shot)
    upright = runner.run("align.support", **shot, robot=factories.placed(base, "base", "camera"))
    askew = np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])
    tilted = base @ transforms.rigid(askew, np.zeros(3))
    leaning = runner.run("align.support", **shot, robot=factories.placed(tilted, "base", "camera"))
    assert runner.encode(plain) == runner.encode(upright) == runner.encode(leaning)
