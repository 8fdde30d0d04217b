"""The empty scene as surfaces: a table before a cupboard and a wall, whose shapes are known."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import PIL.Image
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from dextera_build.artifacts.base import Collection, Folder
from dextera_build.artifacts.cameras.camera import Capture
from dextera_build.artifacts.objects.object import Asset, Support
from dextera_build.artifacts.objects.view import InstanceMap
from dextera_build.artifacts.scenes.scene import Background, Scene, SupportBox
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.geometry import metrics, raycast, transforms
from dextera_build.rule import Context
from dextera_build.sim.model import model as models
from dextera_build.testing import RuleRunner
from rules.background import static_planes
from rules.background.static import StaticOptions, static
from rules.evaluate import other_view
from rules.evaluate.posed import PosedViews
from rules.simulate.scene.scene import scene
from tests import factories

LENS = factories.camera(640, 480)
CAPTURES = Path(__file__).parents[4] / "shared" / "captures"
THINGS = {
    "table": ((-0.5, -0.3, -0.03), (0.5, 0.3, 0.0), (168, 140, 110)),
    "cupboard": ((-1.5, 0.75, -0.8), (0.1, 1.2, 0.15), (150, 30, 40)),
    "wall": ((-3.0, 1.2, -0.8), (3.0, 1.3, 1.6), (190, 195, 190)),
    "carton": ((0.3, 0.05, 0.0), (0.42, 0.17, 0.2), (60, 90, 170)),
}
MUG = ((-0.15, -0.1, 0.0), (-0.07, -0.02, 0.09), (230, 230, 240))
JOINED_M = 0.03
"""Surfaces farther apart in depth are never joined [m]."""


def surfaces(things: dict[str, tuple[tuple[float, ...], ...]]) -> list[raycast.Surface]:
    meshes = [factories.box_mesh(low, high, tuple(c / 255 for c in colour)) for low, high, colour in things.values()]
    return [raycast.Surface(mesh.vertices, mesh.faces, colour=mesh.colour) for mesh in meshes]


NEAR, FAR = factories.look_at((0.1, -1.1, 0.75), (0.0, 0.2, 0.0)), factories.look_at((0.3, -1.5, 1.0), (0.0, -0.2, 0.0))
"""T_world_camera; from afar, one sees the floor before the table."""


def photographed(
    things: dict[str, tuple[tuple[float, ...], ...]], pose: np.ndarray = NEAR
) -> tuple[Capture, np.ndarray, Support]:
    """What the camera sees, with millimetres of noise, and the number of the thing in each pixel; -1 none."""
    corners = np.array([[-0.5, -0.3], [0.5, -0.3], [0.5, 0.3], [-0.5, 0.3]])
    table = factories.support().model_copy(
        update={"camera_pose": factories.placed(pose, "camera"), "polygon": corners * 0.95}
    )
    shapes = surfaces(things)
    seen = raycast.render(shapes, LENS.matrix(), pose, LENS.height, LENS.width)
    noise = np.random.default_rng(0).normal(0.0, 0.002, seen.depth.shape)
    depth = np.where(seen.depth > 0, seen.depth + noise, 0.0).astype(np.float32)
    return factories.rgbd(raycast.shade(shapes, seen), depth, LENS), seen.index, table


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> tuple[Capture, Support, Background]:
    capture, index, table = photographed({**THINGS, "mug": MUG})
    instances = InstanceMap(labels=(index == len(THINGS)).astype(np.int32), fixed=np.zeros(index.shape, bool))
    context = Context(static_planes, static_planes.PlanesOptions(), scratch=tmp_path_factory.mktemp("room"))
    made = static(context, capture.photograph, table, instances, capture.measured, options=StaticOptions())
    return capture, table, made


def surface_of(mesh: Mesh) -> raycast.Surface:
    assert mesh.texture is not None
    return raycast.Surface(mesh.vertices, mesh.faces, mesh.uv, mesh.texture.pixels)


def joins(vertices: np.ndarray, faces: np.ndarray) -> int:
    """Triangles with corners on different things, none of which has all of them within `JOINED_M`."""
    near = [raycast.RayScene((each.vertices, each.faces)).distances(vertices) < JOINED_M for each in surfaces(THINGS)]
    corners = np.array(near)[:, faces]
    return int((corners.any(axis=0).all(axis=1) & ~corners.all(axis=2).any(axis=0)).sum())


@pytest.mark.slow
def test_no_triangle_joins_surfaces_that_are_apart(built: tuple[Capture, Support, Background]) -> None:
    capture, table, made = built
    pose = table.camera_pose.matrix
    assert len(made.mesh.faces) > 1000
    assert joins(made.mesh.vertices, made.mesh.faces) == 0
    own = other_view.Own(
        capture.photograph.rgb.pixels, capture.measured.depth.depth, np.zeros((480, 640), bool), LENS.matrix()
    )
    sheet = other_view.sheet(own)
    naive = joins(transforms.apply(pose, sheet.vertices), sheet.faces)
    assert naive > 500, "one sheet over everything is what this test is there to see"


def steep(made: Background, pose: np.ndarray) -> int:
    """Triangles of surfaces that are no planes, seen or invented, with corners more than `JOINED_M` apart in depth."""
    assert made.invented is not None
    return sum(_steep(mesh, pose) for mesh in (made.mesh, made.invented))


def _steep(mesh: Mesh, pose: np.ndarray) -> int:
    vertices, faces = mesh.vertices.astype(np.float64), mesh.faces
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]]])
    graph = coo_array((np.ones(len(ends)), ends.T), shape=(len(vertices), len(vertices)))
    count, surface = connected_components(graph, directed=False)
    flat = np.zeros(count, bool)
    for number in range(count):
        points = vertices[surface == number] - vertices[surface == number].mean(axis=0)
        if len(points) >= 3:
            normal = np.linalg.svd(points, full_matrices=False)[2][2]
            flat[number] = np.abs(points @ normal).max() < 0.002
    depth = transforms.apply(transforms.invert(pose), vertices)[:, 2]
    return int((np.ptp(depth[faces], axis=1)[~flat[surface[faces[:, 0]]]] > JOINED_M).sum())


def test_steep_places_are_divided_or_open(built: tuple[Capture, Support, Background]) -> None:
    _, table, made = built
    assert steep(made, table.camera_pose.matrix) == 0


def test_everything_but_the_object_stays(built: tuple[Capture, Support, Background]) -> None:
    capture, table, made = built
    bare, _, _ = photographed(THINGS)
    shapes = [surface_of(made.mesh), surface_of(made.invented)]
    seen = raycast.render(shapes, LENS.matrix(), table.camera_pose.matrix, LENS.height, LENS.width)
    off = np.abs(raycast.shade(shapes, seen).astype(int) - bare.photograph.rgb.pixels).max(axis=-1)
    there = bare.measured.depth.depth > 0
    assert (off < 25)[there].mean() > 0.97
    assert np.quantile(np.abs(seen.depth - bare.measured.depth.depth)[there], 0.95) < 0.015
    white = (capture.photograph.rgb.pixels == MUG[2]).all(axis=-1)
    assert white.sum() > 500
    assert not (made.image.pixels == MUG[2]).all(axis=-1).any()


def test_the_room_is_closed(built: tuple[Capture, Support, Background]) -> None:
    made = built[2]
    rng = np.random.default_rng(1)
    ways = rng.normal(size=(4000, 3))
    rays = np.concatenate([np.tile([0.0, 0.0, 0.4], (4000, 1)), ways], axis=1)
    assert (raycast.cast([surface_of(made.mesh), surface_of(made.invented)], rays).index >= 0).all()


@pytest.mark.slow
def test_the_sides_of_a_thin_table_hide_nothing_that_was_seen(tmp_path: Path) -> None:
    low, high, colour = THINGS["table"]
    floor = ((-3.0, -3.0, -0.9), (3.0, 3.0, -0.8), (90, 90, 95))
    capture, index, table = photographed({**THINGS, "floor": floor, "table": ((*low[:2], -0.008), high, colour)}, FAR)
    nothing = InstanceMap(labels=np.zeros(index.shape, np.int32), fixed=np.zeros(index.shape, bool))
    context = Context(static_planes, static_planes.PlanesOptions(), scratch=tmp_path)
    made = static(context, capture.photograph, table, nothing, capture.measured, options=StaticOptions())
    shapes = [surface_of(made.mesh), surface_of(made.invented)]
    seen = raycast.render(shapes, LENS.matrix(), table.camera_pose.matrix, LENS.height, LENS.width)
    assert (seen.depth < capture.measured.depth.depth - 0.05).mean() < 0.005


def test_the_table_is_closed_and_textured_beneath_the_object(built: tuple[Capture, Support, Background]) -> None:
    made = built[2]
    shapes = [surface_of(made.mesh), surface_of(made.invented)]
    places = np.array([[x, y] for x in (-0.4, -0.11, 0.2) for y in (-0.2, -0.06, 0.1)])
    count = len(places)
    down = np.concatenate([places, np.full((count, 1), 0.3), np.tile([0.0, 0.0, -1.0], (count, 1))], axis=1)
    up = np.concatenate([places, np.full((count, 1), -0.3), np.tile([0.0, 0.0, 1.0], (count, 1))], axis=1)
    above, below = raycast.cast(shapes, down), raycast.cast(shapes, up)
    np.testing.assert_allclose(above.depth, 0.3, atol=0.002)
    np.testing.assert_allclose(below.depth, 0.25, atol=0.002)
    colours = raycast.shade(shapes, above).astype(int)
    assert np.abs(colours - THINGS["table"][2]).max() < 25


def test_a_wall_that_was_seen_is_where_it_is_and_others_are_beyond(built: tuple[Capture, Support, Background]) -> None:
    boxes = {box.name: box for box in built[2].boxes}
    faces = [box for name, box in boxes.items() if name.startswith("wall_")]
    near = min(abs(box.centre[1] - box.half_size[1] - 1.2) for box in faces)
    assert near < 0.06
    floor = boxes["floor"]
    assert floor.centre[2] + floor.half_size[2] < -0.7


def test_a_surface_that_was_seen_to_end_does_not_go_on(built: tuple[Capture, Support, Background]) -> None:
    """The cupboard ends at x = 0.1; a plane through its front does not."""
    made = built[2].invented
    assert made is not None
    middle = made.vertices[made.faces].mean(axis=1)
    front = (np.abs(middle[:, 1] - 0.75) < 0.02) & (middle[:, 2] < 0.1) & (middle[:, 2] > -0.7)
    assert front.sum() > 10
    assert middle[front, 0].max() < 0.13


def test_a_ball_lands_on_what_is_drawn(built: tuple[Capture, Support, Background], tmp_path: Path) -> None:
    """On table, cupboard, carton and floor: none falls through, none floats."""
    _, table, made = built
    twin = scene(Context(scratch=tmp_path), Collection[Asset](items={}), made, table, LENS)
    shapes = [surface_of(made.mesh), surface_of(made.invented)]
    for x, y in ((0.1, -0.1), (-0.3, 0.1), (0.36, 0.11), (-0.6, 0.95), (0.7, 0.5), (-0.8, -0.3)):
        down = raycast.cast(shapes, np.array([[x, y, 0.6, 0.0, 0.0, -1.0]]))
        drawn = 0.6 - float(down.depth[0])
        assert -0.01 < landed(twin, x, y, drawn) - drawn < 0.01, (x, y)


def landed(twin: Scene, x: float, y: float, drawn: float) -> float:
    """Height at which the lower side of a ball of 4 cm comes to rest that is let go 0.1 m above `drawn` [m]."""
    root = ElementTree.fromstring(twin.model.files["scene.xml"])
    for keys in root.findall("keyframe"):
        root.remove(keys)
    world = root.find("worldbody")
    assert world is not None
    ball = ElementTree.SubElement(world, "body", name="ball", pos=f"{x} {y} {drawn + 0.12}")
    ElementTree.SubElement(ball, "joint", type="slide", axis="0 0 1", damping="0.1")
    ElementTree.SubElement(ball, "geom", type="sphere", size="0.02", mass="0.05")
    files = {**twin.model.files, "scene.xml": ElementTree.tostring(root)}
    model = models.compile_folder(Folder(files=files))
    data = mujoco.MjData(model)
    for _ in range(round(1.0 / model.opt.timestep)):
        mujoco.mj_step(model, data)
    return float(data.body("ball").xpos[2]) - 0.02


def test_what_stands_in_the_room_collides_but_not_with_objects(built: tuple[Capture, Support, Background]) -> None:
    things = [box for box in built[2].boxes if box.name.startswith("thing_")]
    assert 0 < len(things) <= 48
    middle = np.array([(a + b) / 2 for a, b in zip(MUG[0], MUG[1], strict=True)])
    for box in things:
        away = np.abs(np.array(box.centre) - middle) - np.array(box.half_size)
        assert away.max() > 0.03, box.name
    carton = np.array([(a + b) / 2 for a, b in zip(*THINGS["carton"][:2], strict=True)])
    assert any((np.abs(np.array(box.centre) - carton) < np.array(box.half_size) + 0.1).all() for box in things)


def test_a_level_top_collides_where_it_is(built: tuple[Capture, Support, Background]) -> None:
    boxes = [box for box in built[2].boxes if box.name.startswith(("thing_", "level_"))]
    (left, front, _), (right, back, top), _ = THINGS["cupboard"]
    seen_from, margin = -0.9, 0.08  # the camera's picture cuts the cupboard
    for x in np.linspace(max(left, seen_from) + margin, right - margin, 6):
        for y in np.linspace(front + margin, back - margin, 5):
            assert _highest(boxes, np.array([x, y])) == pytest.approx(top, abs=0.006), (x, y)


def _highest(boxes: list[SupportBox], place: np.ndarray) -> float:
    """Height of the highest box over a place (2,) [m]."""
    found = [-1.0]
    for box in boxes:
        turn = np.array([[np.cos(box.yaw), np.sin(box.yaw)], [-np.sin(box.yaw), np.cos(box.yaw)]])
        if (np.abs(turn @ (place - np.array(box.centre[:2]))) <= np.array(box.half_size[:2])).all():
            found.append(box.centre[2] + box.half_size[2])
    return max(found)


def test_the_floor_catches_what_falls(built: tuple[Capture, Support, Background], tmp_path: Path) -> None:
    _, table, made = built
    fallen = {"box": factories.box_asset(factories.pose(0.75, -0.2, 0.2))}
    twin = scene(Context(scratch=tmp_path), Collection[Asset](items=fallen), made, table, LENS)
    model = models.compile_folder(twin.model)
    data = models.at_home(model)
    for _ in range(round(3.0 / model.opt.timestep)):
        mujoco.mj_step(model, data)
    floor = next(box for box in made.boxes if box.name == "floor")
    assert data.body("box").xpos[2] == pytest.approx(floor.centre[2] + floor.half_size[2], abs=0.1)


@pytest.mark.medium
def test_without_depth_there_is_a_room_too(tmp_path: Path) -> None:
    capture, index, table = photographed(THINGS)
    nothing = InstanceMap(labels=np.zeros(index.shape, np.int32), fixed=np.zeros(index.shape, bool))
    context = Context(static_planes, static_planes.PlanesOptions(), scratch=tmp_path)
    made = static(context, capture.photograph, table, nothing, options=StaticOptions())
    assert made.invented is not None
    assert (made.mesh.vertices[:, 2] == 0).all()


@pytest.mark.slow
def test_a_real_kitchen_is_kept_in_views_that_it_was_not_made_from(tmp_path: Path) -> None:
    folder = CAPTURES / "kitchen_table"
    if not folder.exists():
        pytest.skip("needs shared/captures/kitchen_table")
    given = PosedViews(Context(scratch=tmp_path), Folder(files=_files(folder)))
    runner = RuleRunner(tmp_path)
    capture = runner.run("capture.folder", folder=Folder(files=_files(folder)))
    table = runner.run("align.support", photograph=capture.photograph, measured=capture.measured)
    nothing = InstanceMap(labels=np.zeros((480, 640), np.int32), fixed=np.zeros((480, 640), bool))
    made = runner.run("background.static", instances=nothing, support=table, **factories.shot(capture))
    shapes, k = [surface_of(made.mesh), surface_of(made.invented)], given.camera.matrix()
    own = other_view.Own(capture.photograph.rgb.pixels, capture.measured.depth.depth, nothing.fixed, k)
    likeness, errors, cover = [], [], []
    for view in given.others():
        if view.frame not in (290, 310, 340, 470, 500):
            continue
        move = np.linalg.inv(given.poses[given.own]) @ view.pose
        drawn = raycast.render(shapes, k, table.camera_pose.matrix @ move, 480, 640)
        seen = other_view.seen(own, view.depth, move, 0.05)
        likeness.append(metrics.psnr(raycast.shade(shapes, drawn), view.rgb, seen))
        errors.append(metrics.depth_errors(drawn.depth, view.depth, seen))
        cover.append((drawn.depth > 0).mean())
    assert steep(made, table.camera_pose.matrix) == 0
    # A background without what stands above the table reaches 13.8 dB and 86 mm over all views.
    assert np.mean(likeness) > 19.0
    assert np.median([error.median for error in errors]) < 0.012
    assert np.mean([error.mae for error in errors]) < 0.035
    assert min(cover) > 0.99


@pytest.mark.slow
def test_what_has_no_depth_shows_on_the_room_behind_it(tmp_path: Path) -> None:
    """The far part of a table and the room behind it are out of the depth camera's reach."""
    folder = CAPTURES / "clutter_test_51"
    if not folder.exists():
        pytest.skip("needs shared/captures/clutter_test_51")
    runner = RuleRunner(tmp_path)
    capture = runner.run("capture.folder", folder=Folder(files=_files(folder)))
    table = runner.run("align.support", photograph=capture.photograph, measured=capture.measured)
    labels = np.asarray(PIL.Image.open(folder / "instances.png")).astype(np.int32)
    things = InstanceMap(labels=labels, fixed=np.zeros(labels.shape, bool))
    made = runner.run("background.static", instances=things, support=table, **factories.shot(capture))
    shapes = [surface_of(made.mesh), surface_of(made.invented)]
    drawn = raycast.render(shapes, capture.photograph.camera.matrix(), table.camera_pose.matrix, 480, 640)
    unmeasured = (labels == 0) & (capture.measured.depth.depth == 0)
    assert unmeasured.mean() > 0.3
    # A grey wall in its place reaches 20 dB.
    assert metrics.psnr(raycast.shade(shapes, drawn), capture.photograph.rgb.pixels, unmeasured) > 28.0


def _files(folder: Path) -> dict[str, bytes]:
    return {each.relative_to(folder).as_posix(): each.read_bytes() for each in folder.rglob("*") if each.is_file()}
