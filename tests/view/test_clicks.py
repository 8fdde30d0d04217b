"""Clicks of a mouse in a browser: an object is chosen, and two pixels of the photograph split it."""

from __future__ import annotations

import asyncio
from pathlib import Path

import numpy as np
import pytest

from dextera_build.geometry import transforms
from dextera_build.view import panel, scene, server
from tests import factories
from tests.teleop.chromium import Page, Screen, chromium
from tests.view.test_chosen import Asked

SCREEN = Screen(1100, 700)
BUTTON = "[...document.querySelectorAll('button')].find((e) => e.textContent.trim() === {title!r})"


def place(column: float, row: float) -> tuple[float, float]:
    """Where a pixel of the photograph is in a window that looks from its camera [px]."""
    lens, aspect = factories.camera(), SCREEN.width / SCREEN.height
    upright, across = 2 * np.arctan2(lens.height / 2, lens.fy), 2 * np.arctan(lens.width / 2 / lens.fx / aspect)
    focal = SCREEN.height / 2 / np.tan(1.05 * max(upright, across) / 2)
    return (
        float(SCREEN.width / 2 + focal * (column - lens.cx) / lens.fx),
        float(SCREEN.height / 2 + focal * (row - lens.cy) / lens.fy),
    )


async def click(page: Page, x: float, y: float) -> None:
    for kind, pressed in (("mouseMoved", 0), ("mousePressed", 1), ("mouseReleased", 0)):
        await page.call(
            "Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left" if kind != "mouseMoved" else "none",
            buttons=pressed, clickCount=int(kind != "mouseMoved"),
        )  # fmt: skip
        await asyncio.sleep(0.1)


@pytest.mark.slow
def test_an_object_is_chosen_and_split_with_the_mouse(tmp_path: Path) -> None:
    running, url = server.start(port=18680)
    table, lens, asked = factories.support(), factories.camera(), Asked()
    asset = factories.box_asset()
    photo = factories.capture(lens, table).photograph.rgb
    middle = transforms.apply(transforms.invert(table.camera_pose.matrix), asset.pose.matrix[None, :3, 3])
    seen = lens.project(middle)[0]
    try:
        scene.show_scene(running, {"box": asset}, factories.background(), table, lens, photo=photo, mending=asked)
        noted = len(panel.noted(running))
        server.clear(running)  # what takes the place of another scene has the same panel
        scene.show_scene(running, {"box": asset}, factories.background(), table, lens, photo=photo, mending=asked)
        assert len(panel.noted(running)) == noted

        async def use() -> None:
            async with chromium(tmp_path, SCREEN) as page:
                await page.go(url)
                await page.until("!!window.__viserMutable?.nodeRefFromName['/box/base/visual']", 120)
                await asyncio.sleep(3.0)
                await click(page, *place(*seen))
                await page.until(f"!!{BUTTON.format(title='Split')}", 30)
                await page.run(f"{BUTTON.format(title='Split')}.click(); 0")
                await page.until("window.__viserSceneTree.getState()['/photograph'].visibility", 30)
                await asyncio.sleep(2.0)
                await click(page, *place(150, 120))
                await asyncio.sleep(1.0)
                await click(page, *place(180, 140))
                await page.until("!window.__viserSceneTree.getState()['/photograph'].visibility", 30)

        asyncio.run(use())
    finally:
        server.stop(running)
    ((kind, label, points),) = asked.calls
    assert (kind, label) == ("split", "box")
    np.testing.assert_allclose(points, [(150, 120), (180, 140)], atol=1)
