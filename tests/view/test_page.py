"""The page that `dxb view` writes and serves, in a browser: its panel works without a server."""

from __future__ import annotations

import asyncio
import http
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from dextera_build.artifacts.cameras.image import Image
from dextera_build.geometry import kinematics, quaternions
from dextera_build.view import panel, save, scene, server
from dextera_build.view.guard import Guard
from dextera_build.view.show import show
from tests import factories
from tests.teleop.chromium import Screen, chromium

LABEL = "[...document.querySelectorAll('#dxb label')].find((e) => e.textContent.includes({title!r}))"
LOADED = "!!(window.__viserMutable?.nodeRefFromName['/lap/lid/visual'] && document.querySelector('#dxb'))"


def written(folder: Path) -> Path:
    """The page of a twin with a hinge."""
    running, _ = server.start(port=18180)
    table, lens = factories.support(), factories.camera()
    assets = {"box": factories.box_asset(), "lap": factories.laptop_asset(factories.pose(0.2))}
    photo = factories.capture(lens, table).photograph.rgb
    try:
        scene.show_scene(running, assets, factories.background(), table, lens, photo=photo)
        return save.write(running, folder / "twin.html")
    finally:
        server.stop(running)


def test_a_page_has_the_controls_of_its_viewer_and_no_name_ends_the_script(tmp_path: Path) -> None:
    class Handle:
        name = "/</script>"

    class Viewer:
        """Has controls."""

    viewer = Viewer()
    panel.note_switch(viewer, "Labels", [Handle()], visible=True)
    made = panel.script(viewer)
    assert made.count("</script>") == 1
    assert panel.noted(Viewer()) == []
    assert "dxbControls=[]" in panel.script()
    assert panel.inserted("<head>a</head>b", "<i>") == "<head>a<i></head>b"


@pytest.mark.slow
def test_the_panel_of_a_saved_page_switches_wipes_and_moves_the_hinge(tmp_path: Path) -> None:
    page = written(tmp_path)

    async def use() -> dict[str, Any]:
        async with chromium(tmp_path, Screen(900, 600)) as browser:
            await browser.go(page.as_uri())
            await browser.until(LOADED, 120)
            titles = await browser.run("[...document.querySelectorAll('#dxb label')].map((e) => e.textContent.trim())")
            found: dict[str, Any] = {"titles": titles, "camera": await browser.run(_CAMERA)}
            await browser.run(_press("Background", "checked = false", "change"))
            found["background"] = await browser.until(_VISIBLE.format(name="/background") + " === false", 30)
            await browser.run(_press("hinge", "value = 0", "input"))
            await browser.until("!window.__viserMutable.messageQueue.length", 30)
            found["lid"] = await browser.run("[...window.__viserMutable.nodePoseData['/lap/lid'].wxyz]")
            await browser.run(_press("Photograph", "value = 25", "input"))
            await browser.until(_VISIBLE.format(name="/photograph"), 30)
            found["wiped"] = await browser.run(_WIPED)
            found["faults"] = browser.faults
            return found

    found = asyncio.run(use())
    assert found["faults"] == []
    assert {"Labels", "Background", "Grid and axes"} <= set(found["titles"])
    np.testing.assert_allclose(found["camera"], factories.support().camera_pose.matrix[:3, 3], atol=1e-3)
    body = factories.laptop_asset().body
    wanted = kinematics.link_poses(body, {"hinge": body.joints[0].lower})["lid"][:3, :3]
    np.testing.assert_allclose(quaternions.to_matrix(np.array(found["lid"])), wanted, atol=2e-3)
    assert found["wiped"] == pytest.approx([0.25, 0.25])


@pytest.mark.slow
def test_a_photograph_is_shown_in_its_own_colours(tmp_path: Path) -> None:
    """What holds its light already is neither lit nor toned: the middle of a textured face has the texture's colour."""
    running, url = server.start(port=18280)
    try:
        colour = np.array([158, 112, 70], np.uint8)
        mesh = factories.box_mesh((-1, -0.02, -1), (1, 0.02, 1))
        texture = Image(pixels=np.full((8, 8, 3), colour, np.uint8))
        uv = np.tile(np.array([[0.2, 0.2], [0.8, 0.2], [0.8, 0.8]], np.float32), (len(mesh.faces), 1, 1))
        show(mesh.model_copy(update={"uv": uv, "texture": texture}), running, "/wall")
        running.initial_camera.position, running.initial_camera.look_at = (0.0, -1.0, 0.0), (0.0, 0.0, 0.0)

        async def use() -> list[int]:
            async with chromium(tmp_path, Screen(700, 500)) as browser:
                await browser.go(url)
                await browser.until("!!window.__viserMutable?.nodeRefFromName['/wall']", 120)
                await browser.until(_PLAIN, 60)
                await asyncio.sleep(1.5)
                middle: list[int] = await browser.run(_MIDDLE)
                return middle

        seen = asyncio.run(use())
    finally:
        server.stop(running)
    np.testing.assert_allclose(seen[:3], colour, atol=2)


def test_the_served_page_has_the_script_and_other_files_stay() -> None:
    from websockets.datastructures import Headers
    from websockets.http11 import Response

    def answer(kind: str) -> Any:
        body = b"<html><head></head></html>"
        headers = Headers({"Content-Type": kind, "Content-Length": str(len(body)), "Content-Encoding": "identity"})
        return Response(http.HTTPStatus.OK, "OK", headers, body)

    request = SimpleNamespace(headers={"Host": "127.0.0.1:8080"})
    guard = Guard("127.0.0.1")
    page = guard.check(lambda *_: answer("text/html"), None, request)
    assert b"dxbControls" in page.body
    assert page.headers["Content-Length"] == str(len(page.body))
    other = guard.check(lambda *_: answer("image/png"), None, request)
    assert other.body == b"<html><head></head></html>"


def _press(title: str, change: str, event: str) -> str:
    field = f"{LABEL.format(title=title)}.querySelector('input')"
    return f"{{ const field = {field}; field.{change}; field.dispatchEvent(new Event({event!r})); }} 0"


_VISIBLE = "window.__viserSceneTree.getState()['{name}'].visibility"
_CAMERA = """(() => {
  const view = window.__viserMutable, p = view.camera.position;
  // The world is turned, so that its z is up: back into it.
  const q = view.nodeRefFromName[''] || view.scene.getObjectByName('') ;
  const turn = view.nodePoseData[''].wxyz, v = p.clone();
  const inverse = view.camera.quaternion.clone().set(-turn[1], -turn[2], -turn[3], turn[0]);
  v.applyQuaternion(inverse);
  return [v.x, v.y, v.z];
})()"""
_WIPED = """(() => {
  const found = [];
  window.__viserMutable.nodeRefFromName['/photograph'].traverse((part) => {
    if (!part.isMesh || !part.material.map) return;
    const { position, uv } = part.geometry.attributes, width = part.geometry.parameters.width;
    found.push(Math.max(...uv.array.filter((_, i) => i % 2 === 0)), (position.getX(1) - position.getX(0)) / width);
  });
  return found;
})()"""
_PLAIN = """(() => {
  let done = false;
  window.__viserMutable.scene.traverse((part) => {
    done ||= part.material && part.material.emissiveMap && !part.material.toneMapped;
  });
  return !!done;
})()"""
_MIDDLE = """(() => {
  const canvas = window.__viserMutable.canvas, copy = document.createElement('canvas');
  [copy.width, copy.height] = [canvas.width, canvas.height];
  const pen = copy.getContext('2d');
  pen.drawImage(canvas, 0, 0);
  return [...pen.getImageData(canvas.width >> 1, canvas.height >> 1, 1, 1).data];
})()"""
