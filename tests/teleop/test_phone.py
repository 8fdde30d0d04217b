"""The page on a phone's screen, in Chromium with emulated fingers; no phone was used."""

from __future__ import annotations

import asyncio
import shutil
from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.teleop.session import Session
from tests.teleop.browsing import NO_PICTURES, opened
from tests.teleop.chromium import Page, Screen

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which("chromium") is None, reason="`.ci/system browser` installs Chromium"),
]
PHONE = Screen(390, 844, touch=True)
BUTTONS = """[...document.querySelectorAll('button')].filter((each) => each.offsetParent).every((each) => {
  const { left, right, top, bottom } = each.getBoundingClientRect();
  return left >= 0 && right <= innerWidth && top >= 0 && bottom <= innerHeight && bottom - top >= 36;
})"""
"""Whether every button that is shown is on the screen, and large enough for a finger."""
SLID = """(() => {
  document.getElementById('closed').value = '1';
  document.getElementById('closed').dispatchEvent(new Event('input'));
})()"""


def test_a_phone_moves_the_robot_while_its_picture_is_pressed(lifting: TaskBundle, tmp_path: Path):
    async def use(page: Page, session: Session) -> None:
        assert await page.run("!document.getElementById('touch').hidden && document.getElementById('keys').hidden")
        assert await page.run(BUTTONS)
        await page.run(NO_PICTURES)
        await tapped(page, "[data-do=start]")
        await page.until("session.facts.phase === 'waiting' ? 1 : 0")
        # A tap is no hold: the take does not begin.
        await page.touch("touchStart", at())
        await page.touch("touchEnd")
        await asyncio.sleep(0.4)
        assert await page.run("session.facts.phase") == "waiting"
        before = session.environment.palm_poses()[0, :3].copy()
        await page.touch("touchStart", at())
        await page.until("session.facts.phase === 'taking' && session.facts.clutch[1] ? 1 : 0")
        start = await place(page)
        await dragged(page, at(), at(-40))
        moved = await place(page) - start
        assert 0.02 < np.linalg.norm(moved[:2]) < 0.3
        assert abs(moved[2]) < 1e-6
        await page.touch("touchEnd")
        await page.until("session.facts.clutch[1] ? 0 : 1")
        assert await page.run("session.facts.phase") == "taking", await page.run("session.facts.told")
        assert await page.run("session.facts.held.arm")
        assert np.abs(session.environment.palm_poses()[0, :3] - before)[:2].max() > 0.005
        await tapped(page, "[data-do=discard]")
        await page.until("session.facts.told === 'discarded' ? 1 : 0")
        assert session.takes.device.startswith("touch screen in ")

    opened(lifting, tmp_path, "", (), use, PHONE)


def test_two_fingers_raise_and_turn_the_hand_and_a_slider_closes_it(lifting: TaskBundle, tmp_path: Path):
    async def use(page: Page, session: Session) -> None:
        await page.run(NO_PICTURES)
        start, yaw = await place(page), await turned(page)
        await page.touch("touchStart", at(-60), at(60))
        await dragged(page, at(-60), at(-60, -50), at(60), at(60, -50))
        moved = await place(page) - start
        assert moved[2] > 0.02
        assert np.linalg.norm(moved[:2]) < 1e-6
        assert abs(await turned(page) - yaw) < 0.2
        # Clockwise on the screen is clockwise from above.
        await dragged(page, at(-60, -50), at(-60, -90), at(60, -50), at(60, -10))
        assert await turned(page) < yaw - 0.3
        await page.touch("touchEnd")
        start = await place(page)
        await page.run(SLID)
        await page.until("session.keys.closed[1] > 0.9 ? 1 : 0")
        np.testing.assert_array_equal(await place(page), start)
        # Without the clutch, fingers turn the view.
        await tapped(page, "[data-drag=view]")
        view = await page.run("session.keys.camera.position.toArray()")
        await page.touch("touchStart", at())
        await dragged(page, at(), at(40))
        assert not await page.run("session.touch.engaged")
        assert await page.run("session.keys.camera.position.toArray()") != view
        np.testing.assert_array_equal(await place(page), start)
        await page.touch("touchEnd")

    opened(lifting, tmp_path, "", (), use, PHONE)


def at(right: float = 0.0, down: float = 0.0) -> tuple[float, float]:
    """A place on the picture, from its middle [pixel]."""
    return 195.0 + right, 480.0 + down


async def dragged(page: Page, *ends: tuple[float, float], steps: int = 12) -> None:
    """Move fingers, each from one place to the next one in `ends`, and leave them there."""
    ways = [np.linspace(one, other, steps + 1) for one, other in zip(ends[::2], ends[1::2], strict=True)]
    for step in range(1, steps + 1):
        await page.touch("touchMove", *((float(way[step, 0]), float(way[step, 1])) for way in ways))
        await asyncio.sleep(0.03)


async def place(page: Page) -> np.ndarray:
    """Place of the hand that the page sends, in the base (3,) [m]."""
    return np.array(await page.run("session.keys.pivot[1].toArray()"))


async def tapped(page: Page, selector: str) -> None:
    """Tap in the middle of an element."""
    place = await page.run(
        f"(({{left, top, width, height}}) => [left + width / 2, top + height / 2])"
        f"(document.querySelector('{selector}').getBoundingClientRect())"
    )
    await page.touch("touchStart", tuple(place))
    await page.touch("touchEnd")


async def turned(page: Page) -> float:
    """Angle of the hand about the vertical [rad]."""
    x, y, z, w = await page.run("session.keys.turn[1].toArray()")
    return float(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))
