"""The viewer: names, joint sliders, switches, the server and its export."""

from __future__ import annotations

import base64
import sys
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from dextera_build.artifacts.base import Collection, File
from dextera_build.artifacts.objects.object import Asset
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.artifacts.spatial.point_cloud import PointCloud
from dextera_build.errors import MachineError, UsageError
from dextera_build.geometry import kinematics, quaternions
from dextera_build.view import framing, invented, save, scene, server
from dextera_build.view.replay import ReplayView
from dextera_build.view.show import show
from dextera_build.view.task import TaskView
from tests import episodes, factories, twins


class Recorder:
    """Stands in for viser: keeps every node and control by its name."""

    def __init__(self) -> None:
        self.nodes: dict[str, Any] = {}
        self.controls: dict[str, Any] = {}
        self.initial_camera = SimpleNamespace()
        self.scene = self.gui = self

    def __getattr__(self, method: str) -> Any:
        if not method.startswith("add_"):
            raise AttributeError(method)

        def add(name: str, *values: Any, **options: Any) -> Any:
            handle = SimpleNamespace(kind=method, name=name, values=values, **{"visible": True, **options})
            handle.on_click = lambda call: setattr(handle, "clicked", call)
            handle.remove_click_callback = lambda which: setattr(handle, "clicked", None)
            if method in ("add_slider", "add_checkbox", "add_dropdown", "add_button", "add_text"):
                handle.value = options.get("initial_value")
                handle.on_update = lambda call: setattr(handle, "moved", call)
                self.controls[name] = handle
            elif method == "add_folder":
                handle = _Folder()
            else:
                self.nodes[name] = handle
            return handle

        return add

    def set_background_image(self, image: Any, **options: Any) -> None:
        self.background = image

    def atomic(self) -> Any:
        return _Folder()

    def on_client_connect(self, call: Any) -> None:
        self.connected = call


class _Folder:
    def __enter__(self) -> None:
        """Open."""

    def __exit__(self, *error: object) -> None:
        """Close."""


@pytest.fixture
def shown() -> Recorder:
    recorder = Recorder()
    assets = {"box": factories.box_asset(factories.pose(-0.2)), "lap": factories.laptop_asset(factories.pose(0.1))}
    table, lens = factories.support(), factories.camera()
    photo = factories.capture(lens, table).photograph.rgb
    scene.show_scene(
        recorder,
        assets,
        factories.background(),
        table,
        lens,
        photo=photo,
        addresses={"lap": "twin/desk:body[lap].asset"},
    )
    return recorder


def test_nodes_bear_the_addresses_of_what_they_show(shown: Recorder) -> None:
    assert "/twin/desk:body[lap].asset/lid/visual" in shown.nodes
    assert "/box/base/visual" in shown.nodes
    assert {"/background/surface", "/camera", "/support", "/world"} <= set(shown.nodes)


def test_a_slider_starts_as_seen_and_moves_the_link(shown: Recorder) -> None:
    slider = shown.controls["hinge [deg]"]
    assert slider.value == pytest.approx(np.degrees(1.9), abs=0.1)
    lid = shown.nodes["/twin/desk:body[lap].asset/lid"]
    slider.value = 30.0
    slider.moved(None)
    wanted = kinematics.link_poses(factories.laptop_asset().body, {"hinge": np.radians(30.0)})["lid"]
    np.testing.assert_allclose(quaternions.to_matrix(np.array(lid.wxyz)), wanted[:3, :3], atol=1e-9)
    np.testing.assert_allclose(lid.position, wanted[:3, 3], atol=1e-9)


def test_collision_pieces_are_hidden_until_asked_for(shown: Recorder) -> None:
    pieces = [node for name, node in shown.nodes.items() if "/piece_" in name]
    assert len(pieces) == 3
    assert not any(piece.visible for piece in pieces)
    box = shown.controls["Collision pieces"]
    box.value = True
    box.moved(None)
    assert all(piece.visible for piece in pieces)


def test_the_frustum_is_the_cameras(shown: Recorder) -> None:
    camera, table = shown.nodes["/camera"], factories.support()
    lens = factories.camera()
    assert camera.fov == pytest.approx(2 * np.arctan(lens.height / 2 / lens.fy))
    np.testing.assert_allclose(camera.position, table.camera_pose.matrix[:3, 3])
    np.testing.assert_allclose(quaternions.to_matrix(camera.wxyz), table.camera_pose.matrix[:3, :3], atol=1e-9)


def test_the_view_opens_at_the_photographs_camera_with_nothing_before_the_twin(shown: Recorder) -> None:
    pose, lens = factories.support().camera_pose.matrix, factories.camera()
    start = shown.initial_camera
    np.testing.assert_allclose(start.position, pose[:3, 3])
    ahead = np.array(start.look_at) - start.position
    np.testing.assert_allclose(ahead / np.linalg.norm(ahead), pose[:3, 2], atol=1e-9)
    assert start.fov > 2 * np.arctan(lens.height / 2 / lens.fy)  # all rows of the photograph
    assert not any(shown.nodes[name].visible for name in ("/photograph", "/camera", "/support", "/grid", "/world"))
    client = SimpleNamespace(camera=SimpleNamespace(aspect=0.5), atomic=shown.atomic)
    shown.connected(client)
    across = 2 * np.arctan(np.tan(client.camera.fov / 2) * client.camera.aspect)
    assert across > 2 * np.arctan(lens.width / 2 / lens.fx)  # on a phone, all columns


def test_what_the_photograph_does_not_show_is_marked_on_request(shown: Recorder) -> None:
    mark = shown.nodes["/box/base/mark"]
    assert not mark.visible
    switch = shown.controls["Mark what the photograph does not show"]
    switch.value = True
    switch.moved(None)
    assert mark.visible
    vertices, faces = mark.values
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    eye = factories.support().camera_pose.matrix[:3, 3] - factories.box_asset(factories.pose(-0.2)).pose.matrix[:3, 3]
    mesh = factories.box_asset().body.links["base"].mesh
    away = (
        np.cross(*np.diff(mesh.vertices[mesh.faces], axis=1).transpose(1, 0, 2))
        * (eye - mesh.vertices[mesh.faces][:, 0])
    ).sum(axis=1) < 0
    # Of a box, those faces are hidden that are turned away.
    assert len(faces) == away.sum() > 0
    assert ((normals * (eye - corners[:, 0])).sum(axis=1) < 0).all()


def test_what_stands_behind_another_thing_is_not_seen() -> None:
    lens, table = factories.camera(), factories.support()
    world = table.camera_pose.matrix
    near, far, aside = np.eye(4), np.eye(4), np.eye(4)
    for pose, (right, ahead) in zip((near, far, aside), ((0.0, 0.5), (0.0, 0.9), (50.0, 0.9)), strict=True):
        pose[:3, 3] = world[:3, 3] + ahead * world[:3, 2] + right * world[:3, 0]
    small, large = factories.box_mesh((-0.02,) * 3, (0.02,) * 3), factories.box_mesh((-0.1,) * 3, (0.1,) * 3)
    hidden = invented.unseen([(large, near), (small, far), (small, aside)], lens, world)
    assert [each.all() for each in hidden] == [False, True, True]  # beside the picture, nothing is seen either
    (alone,) = invented.unseen([(small, far)], lens, world)
    assert not alone.all()


def test_objects_tell_their_mass_and_material(shown: Recorder) -> None:
    (words,) = shown.nodes["/labels/box"].values
    physics = factories.box_asset().physics
    grams = 1000 * sum(link.mass_kg for link in physics.links.values())
    assert words == f"box · {grams:.0f} g"
    shown.nodes["/box/base/visual"].clicked(None)
    told = shown.nodes["Click an object for its mass, material and friction."].content
    assert f"* material: {physics.material}\n* friction: {physics.friction:.2f}" in told


def test_a_held_object_is_marked_and_tells_why() -> None:
    recorder, table, lens = Recorder(), factories.support(), factories.camera()
    why = "nothing carries it: it would fall by 40 mm"
    assets = {"box": factories.box_asset(), "tin": factories.box_asset(factories.pose(0.2))}
    scene.show_scene(recorder, assets, factories.background(), table, lens, held={"box": why})
    labels = {name: recorder.nodes[f"/labels/{name}"].values[0] for name in assets}
    assert labels["box"].endswith(" · held")
    assert "held" not in labels["tin"]
    recorder.nodes["/box/base/visual"].clicked(None)
    words = recorder.nodes["Click an object for its mass, material and friction."]
    assert f"* held: {why}" in words.content


def test_the_photograph_lies_on_its_own_pixels_however_much_is_shown(shown: Recorder) -> None:
    picture, lens, pose = shown.nodes["/photograph"], factories.camera(), factories.support().camera_pose.matrix
    slider = shown.controls["Photograph [%]"]
    for share, columns in ((100, lens.width), (25, round(0.25 * lens.width))):
        slider.value = share
        slider.moved(None)
        # The corners of the plane, seen through the camera, are those of the first columns of the photograph.
        half = np.array([picture.render_width, picture.render_height]) / 2
        turn = quaternions.to_matrix(np.array(picture.wxyz))
        for sign, pixel in ((-1, (-0.5, -0.5)), (1, (columns - 0.5, lens.height - 0.5))):
            corner = picture.position + turn @ [sign * half[0], sign * half[1], 0.0]
            seen = lens.matrix() @ pose[:3, :3].T @ (corner - pose[:3, 3])
            np.testing.assert_allclose(seen[:2] / seen[2], pixel, atol=1e-6)
        assert picture.image.shape == (lens.height, columns, 3)
    client = SimpleNamespace(camera=SimpleNamespace(aspect=1.0), atomic=shown.atomic)
    shown.controls["Look from the camera"].clicked(SimpleNamespace(client=client))
    np.testing.assert_allclose(client.camera.position, pose[:3, 3])
    assert client.camera.fov == pytest.approx(2.1 * np.arctan(lens.width / 2 / lens.fx))  # as wide as the window
    assert not shown.nodes["/camera"].visible
    shown.controls["By"].value = "Blend"
    slider.moved(None)
    assert picture.image.shape == (lens.height, lens.width, 4)
    assert picture.image[0, 0, 3] == 64
    slider.value = 0
    slider.moved(None)
    assert not picture.visible


@pytest.mark.parametrize(
    "artifact",
    [
        factories.box_asset(),
        factories.laptop_asset().body,
        factories.bowl_asset().collision,
        factories.background(),
        factories.support(),
        factories.capture(),
        factories.capture().photograph,
        factories.capture().photograph.rgb,
        PointCloud(points=np.eye(3, dtype=np.float32)),
        factories.splats(5),
        twins.described({"box": factories.box_asset()}, eye=np.eye(4)),
        Collection[Mesh](items={"a": factories.box_mesh((0, 0, 0), (1, 1, 1))}),
    ],
    ids=lambda artifact: artifact.name(),
)
def test_every_shape_is_shown_under_its_name(artifact: Any) -> None:
    recorder = Recorder()
    show(artifact, recorder, "/thing")
    assert recorder.nodes
    assert all(name.startswith("/thing") for name in recorder.nodes)


@pytest.mark.parametrize(
    "artifact",
    [
        factories.box_asset(factories.pose(3.0)),
        factories.laptop_asset().body,
        factories.background(),
        factories.box_mesh((5, 5, 5), (6, 6, 6)),
        Collection[Mesh](items={"a": factories.box_mesh((0, 0, 0), (1, 1, 1))}),
    ],
    ids=lambda artifact: artifact.name(),
)
def test_the_view_of_one_artifact_holds_it(artifact: Any) -> None:
    recorder = Recorder()
    framing.look_at(recorder, artifact)
    start, points = recorder.initial_camera, framing.spread(artifact)
    ahead = np.array(start.look_at) - start.position
    ahead /= np.linalg.norm(ahead)
    off = points - start.position
    angles = np.arccos((off @ ahead) / np.linalg.norm(off, axis=1))
    assert np.degrees(angles).max() < 75 / 2  # viser's own field of view
    assert np.degrees(angles).max() > 10  # nor is it a speck


def test_the_view_of_gaussians_holds_most_of_them_however_far_single_ones_are() -> None:
    made = factories.splats(400)
    means = np.random.default_rng(0).uniform(-1, 1, (400, 3)).astype(np.float32)
    means[:3] = 500.0
    opacities = np.full(400, 0.9, np.float32)
    opacities[3:6], means[3:6] = 0.01, -300.0
    recorder = Recorder()
    framing.look_at(recorder, made.model_copy(update={"means": means, "opacities": opacities}))
    assert np.abs(recorder.initial_camera.look_at).max() < 0.2
    assert np.linalg.norm(recorder.initial_camera.position) < 6
    nothing = Recorder()
    framing.look_at(nothing, PointCloud(points=np.zeros((0, 3), np.float32)))
    assert not hasattr(nothing.initial_camera, "position")


def test_what_has_no_shape_says_what_has(shown: Recorder) -> None:
    with pytest.raises(UsageError, match="a File has no shape to view") as caught:
        show(File(data=b""), shown, "/x")
    assert "Mesh" in caught.value.facts["shapes"]


@pytest.fixture
def started() -> Iterator[tuple[Any, str]]:
    pytest.importorskip("viser")
    running, url = server.start(port=18080)
    yield running, url
    server.stop(running)


def test_the_real_server_answers_and_saves(
    started: tuple[Any, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    running, url = started
    assert capsys.readouterr().out == ""
    empty = save.write(running, tmp_path / "empty.viser").stat().st_size
    table, lens = factories.support(), factories.camera()
    assets: dict[str, Asset] = {"box": factories.box_asset(), "lap": factories.laptop_asset(factories.pose(0.2))}
    photo = factories.capture(lens, table).photograph.rgb
    scene.show_scene(running, assets, factories.background(), table, lens, photo=photo)
    with urllib.request.urlopen(url, timeout=60) as page:
        assert b"<html" in page.read().lower()
    assert save.write(running, tmp_path / "out" / "scene.viser").stat().st_size > empty + 1000
    with pytest.raises(UsageError, match="not a file that the viewer writes"):
        save.write(running, tmp_path / "scene.usd")


def test_without_rerun_a_file_for_it_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(MachineError, match="rerun-sdk, which is not installed"):
        save.check(Path("scene.rrd"))


def test_physics_is_played_and_an_episode_is_recorded(started: tuple[Any, str], tmp_path: Path) -> None:
    running, _ = started
    view = TaskView(running, "/task", episodes.bundle(), {"box": "wood"})
    assert view.figure.labels[0].text == "box · 100 g"
    raised = view.environment.data.joint("box").qpos.copy()
    raised[2] += 0.05
    view.environment.data.joint("box").qpos[:] = raised
    view.transport.play()
    deadline = time.monotonic() + 10.0
    while view.environment.steps < 10 and time.monotonic() < deadline:
        time.sleep(0.01)
    view.transport.pause()
    height = episodes.BOX_HALF_M[2]
    box = running.scene.get_handle_by_name("/task/box")
    assert box.position[2] == pytest.approx(height, abs=2e-3)
    view.transport.step()
    view.reset()
    assert (view.environment.steps, box.position[2]) == (0, pytest.approx(height, abs=1e-9))
    view.transport.end()

    made = episodes.small(2, 12)
    replay = ReplayView(running, "/replay", episodes.bundle(), made, {})
    assert list(replay.episodes) == ["0 · success", "1 · success", "2 · failed: box: not lifted"]
    replay.choose("1 · success")
    target = save.write(running, tmp_path / "episode.html", replay.recording())
    moved = running.scene.get_handle_by_name("/replay/box").position
    expected = episodes.WORLD_FROM_BASE[:3, :3] @ made.items["1"].objects[-1, 0, :3] + episodes.WORLD_FROM_BASE[:3, 3]
    np.testing.assert_allclose(moved, expected, atol=1e-6)
    replay.transport.end()
    inner = recording(target.read_text())
    assert inner["durationSeconds"] == pytest.approx(11 / made.rate_hz)
    times = {time for time, message in inner["messages"] if message.get("name") == "/replay/box"}
    assert len(times) > 6  # the box rises in the second half


def test_the_time_slider_moves_the_bodies_to_what_was_recorded() -> None:
    recorder, made = Recorder(), episodes.small(2, 12)
    view = ReplayView(recorder, "/replay", episodes.bundle(), made, {})
    slider, box = recorder.controls["Time [s]"], recorder.nodes["/replay/box"]
    slider.value = 8 / made.rate_hz
    slider.moved(None)
    turn, place = episodes.WORLD_FROM_BASE[:3, :3], episodes.WORLD_FROM_BASE[:3, 3]
    np.testing.assert_allclose(box.position, turn @ made.items["0"].objects[8, 0, :3] + place, atol=1e-6)
    assert (view.at, slider.max) == (8, 11 / made.rate_hz)
    view.transport.play()
    deadline = time.monotonic() + 10.0
    while view.transport.playing and time.monotonic() < deadline:
        time.sleep(0.01)
    assert (view.at, slider.value) == (11, 11 / made.rate_hz)
    recorder.controls["Episode"].value = "1 · success"
    recorder.controls["Episode"].moved(None)
    np.testing.assert_allclose(box.position, turn @ made.items["1"].objects[0, 0, :3] + place, atol=1e-6)
    view.transport.end()


def recording(page: str) -> dict[str, Any]:
    """What the page of a recording holds."""
    import msgspec
    import zstandard

    packed = base64.b64decode(page.partition('__VISER_EMBED_DATA__="')[2].partition('"')[0])
    data = zstandard.ZstdDecompressor().decompressobj().decompress(packed[8:])
    size = int.from_bytes(data[:8], "little")
    decoded: dict[str, Any] = msgspec.msgpack.decode(data[8 : 8 + size])
    return decoded
