"""The viewer: names, joint sliders, switches, the server and its export."""

from __future__ import annotations

import urllib.request
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from dextera_build.artifacts.base import Collection, File
from dextera_build.artifacts.geometry import Mesh
from dextera_build.artifacts.object import Asset
from dextera_build.artifacts.point_cloud import PointCloud
from dextera_build.errors import UsageError
from dextera_build.geometry import kinematics, quaternions
from dextera_build.sim.model.description import describe
from dextera_build.view import scene, server
from dextera_build.view.show import show
from tests import factories


class Recorder:
    """Stands in for viser: keeps every node and control by its name."""

    def __init__(self) -> None:
        self.nodes: dict[str, Any] = {}
        self.controls: dict[str, Any] = {}
        self.greeters: list[Any] = []
        self.scene = self.gui = self

    def __getattr__(self, method: str) -> Any:
        if not method.startswith("add_"):
            raise AttributeError(method)

        def add(name: str, *values: Any, **options: Any) -> Any:
            handle = SimpleNamespace(kind=method, values=values, **{"visible": True, **options})
            if method in ("add_slider", "add_checkbox"):
                handle.value = options["initial_value"]
                handle.on_update = lambda call: setattr(handle, "moved", call)
                self.controls[name] = handle
            elif method == "add_folder":
                handle = _Folder()
            else:
                self.nodes[name] = handle
            return handle

        return add

    def on_client_connect(self, call: Any) -> None:
        self.greeters.append(call)


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
    assert camera.image.shape == (lens.height, lens.width, 3)


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
        describe({"box": factories.box_asset()}, factories.background(), factories.camera(), np.eye(4)),
        Collection[Mesh](items={"a": factories.box_mesh((0, 0, 0), (1, 1, 1))}),
    ],
    ids=lambda artifact: artifact.name(),
)
def test_every_shape_is_shown_under_its_name(artifact: Any) -> None:
    recorder = Recorder()
    show(artifact, recorder, "/thing")
    assert recorder.nodes
    assert all(name.startswith("/thing") for name in recorder.nodes)


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


def test_the_real_server_answers_and_exports(
    started: tuple[Any, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    running, url = started
    assert capsys.readouterr().out == ""
    empty = server.static_export(running, tmp_path / "empty").stat().st_size
    table, lens = factories.support(), factories.camera()
    assets: dict[str, Asset] = {"box": factories.box_asset(), "lap": factories.laptop_asset(factories.pose(0.2))}
    scene.show_scene(running, assets, factories.background(), table, lens)
    with urllib.request.urlopen(url, timeout=60) as page:
        assert b"<html" in page.read().lower()
    assert server.static_export(running, tmp_path / "out").stat().st_size > empty + 1000
