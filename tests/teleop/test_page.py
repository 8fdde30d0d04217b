"""The page in headless Chromium: keys move the robot, an emulated headset demonstrates, a second page is told."""

from __future__ import annotations

import asyncio
import io
import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from websockets.asyncio.client import connect

from dextera_build.artifacts.robots.hand_stream import HandStream
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.teleop.session import Session
from dextera_build.testing import RuleRunner
from tests import hand_tasks
from tests.hand_streams import stream
from tests.teleop import headsets, replays
from tests.teleop.browsing import NO_PICTURES, Headset, opened
from tests.teleop.chromium import Page

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which("chromium") is None, reason="`.ci/system browser` installs Chromium"),
]
REFUSING = """
Object.defineProperty(navigator, "xr", { value: {
  isSessionSupported: async () => true,
  requestSession: async () => { throw new DOMException("another page has it", "InvalidStateError"); },
} });
"""
"""A headset that is in use."""
TAKES, ATTEMPTS = 10, 2
"""Starts that are demonstrated, and how often at most each; docs/benchmarks/teleoperation.md has those of more."""


def test_keys_move_the_robot_and_the_page_shows_it(lifting: TaskBundle, tmp_path: Path):
    async def use(page: Page, session: Session) -> None:
        await page.picture(tmp_path / "page.png")
        picture = np.asarray(Image.open(io.BytesIO((tmp_path / "page.png").read_bytes())).convert("RGB"))
        assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 500
        await page.run(NO_PICTURES)
        assert await page.run("document.getElementById('task').textContent") == "LiftCan"
        await page.run("document.getElementById('view').focus()")
        before = session.environment.palm_poses()[0, :3].copy()
        await page.key("Enter")
        await page.until("session.facts.phase === 'taking' ? 1 : 0")
        await page.key("KeyE", "keyDown")
        await page.until("session.facts.seconds > 0.6 ? 1 : 0")
        await page.key("KeyE", "keyUp")
        moved = session.environment.palm_poses()[0, :3] - before
        assert moved[2] > 0.02
        assert abs(moved[:2]).max() < 0.5 * moved[2]
        await page.key("Space")
        await page.until("session.keys.closed[1] > 0.9 ? 1 : 0")
        await page.key("Backspace")
        await page.until("session.facts.told === 'discarded' ? 1 : 0")
        assert await page.until("session.link.lastTrip") > 0

    opened(lifting, tmp_path, "", (), use)


def test_a_hand_that_keys_moved_before_the_take_does_not_pull_the_robot(lifting: TaskBundle, tmp_path: Path):
    async def use(page: Page, session: Session) -> None:
        await page.run(NO_PICTURES)
        await page.run("document.getElementById('view').focus()")
        home = await page.run("session.keys.pivot[1].z")
        # As far as keys move it in a third of a second, and not so far that the robot takes it for a jump.
        await page.run("(session.keys.pivot[1].z += 0.04, 0)")
        await asyncio.sleep(0.5)
        before = session.environment.palm_poses()[0, :3].copy()
        await page.key("Enter")
        await page.until("session.facts.seconds > 0.5 ? 1 : 0")
        assert session._live is not None
        assert np.linalg.norm(session._live.aims["arm"].palm[:3, 3] - before) < 1e-3
        assert np.linalg.norm(session.environment.palm_poses()[0, :3] - before) < 0.01
        await page.key("Backspace")
        await page.until("session.facts.told === 'discarded' ? 1 : 0")
        await page.until(f"Math.abs(session.keys.pivot[1].z - {home}) < 1e-6 ? 1 : 0")

    opened(lifting, tmp_path, "", (), use)


def test_a_headset_that_cannot_be_entered_is_told(lifting: TaskBundle, tmp_path: Path):
    async def use(page: Page, session: Session) -> None:
        await page.run(NO_PICTURES)
        await page.until("document.getElementById('headset').hidden ? 0 : 1")
        await page.run("document.getElementById('headset').click()")
        words = "the headset refused: another page has it"
        await page.until(f"document.getElementById('told').textContent === {json.dumps(words)} ? 1 : 0")
        assert await page.run("document.getElementById('told').className") == "bad"
        assert not await page.run("session.headset.active")

    opened(lifting, tmp_path, REFUSING, (), use)


def test_an_operator_sees_both_hands_where_they_are(
    runner: RuleRunner, lifting: TaskBundle, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    script = headsets.script(tmp_path)
    if script is None:
        pytest.skip("npm cannot get the emulated headset")
    hands = stream(40, frame="base", clutch=np.ones((40, 2), bool))

    async def use(page: Page, session: Session) -> None:
        await page.run(NO_PICTURES)
        await page.run("session.headset.enter()")
        for row, heading in ((33, 0.0), (38, 0.0), (38, 0.6)):
            session.heading_rad = heading
            still = json.dumps(headsets.still(hands, row))
            await page.run(f"({headsets.PLAY})({still})")
            await page.until(
                f"Math.abs(session.headset.placed - {heading}) < 1e-9 && session.headset.placed !== null ? 1 : 0"
            )
            for hand in (0, 1):
                place = headsets.turned(np.append(hands.positions[row, hand, 0], [1, 0, 0, 0])[None])[0, :3].tolist()
                await page.until(f"{headsets.OFF}({hand}, {place}) < 1e-3 ? 1 : 0", 20)
        # They were never open.
        words = "import('./panel.js').then((panel) => panel.words(session.facts, session.link, '').right[0])"
        assert await page.run(words) == "not measured, moves nothing"
        await page.run("session.headset.renderer.xr.getSession().end()")
        await page.until("session.headset.active ? 0 : 1")
        await page.until("session.twin.hands[1].group.position.length() === 0 ? 1 : 0")

    opened(lifting, tmp_path, script, (), use)


def test_a_page_beside_another_operator_says_so(lifting: TaskBundle, tmp_path: Path):
    async def use(page: Page, session: Session) -> None:
        await page.run(NO_PICTURES)
        address = (await page.run("location.href")).replace("http", "ws", 1) + "socket"
        await page.run("(session.link.connect = () => { window.left = true; }, session.link.socket.close())")
        await page.until("window.left ? 1 : 0")
        while session.connected:
            await asyncio.sleep(0.1)
        async with connect(address, compression=None) as other:
            # One that reads nothing has left.
            reading = asyncio.create_task(_read(other))
            await page.run("(delete session.link.connect, session.link.connect())")
            words = "another operator is connected"
            await page.until(f"document.getElementById('told').textContent === {json.dumps(words)} ? 1 : 0")
            reading.cancel()

    opened(lifting, tmp_path, "", (), use)


async def _read(connection: Any) -> None:
    """Read every message until the connection is closed."""
    async for _ in connection:
        pass


@pytest.mark.timeout(2400)  # takes in slow motion
def test_takes_of_an_emulated_headset_replay_bit_for_bit(
    runner: RuleRunner, lifting: TaskBundle, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    script = headsets.script(tmp_path)
    if script is None:
        pytest.skip("npm cannot get the emulated headset")
    _, hands = hand_tasks.shown(runner, lifting, monkeypatch, episodes=TAKES, takes=TAKES)

    async def use(page: Page, session: Session) -> None:
        await page.run(NO_PICTURES)
        headset = Headset(page, hands)
        await headset.wear()
        for number in range(TAKES):
            told: list[str] = []
            while len(told) < ATTEMPTS and await page.run("session.facts.kept") == number:
                told.append(await headset.take(number))
            assert await page.run("session.facts.kept") == number + 1, told
        assert await page.run("session.link.lastWay") > 0

    with replays.watched(monkeypatch) as seen:
        opened(lifting, tmp_path, script, tuple(take.seed or 0 for take in hands.takes), use)
    made = HandStream.load(tmp_path / "made.mcap")
    assert made.device.startswith("WebXR in ")
    assert made.head is not None
    assert [take.seed for take in made.takes] == [take.seed for take in hands.takes]
    for was, take in zip(hands.takes, made.takes, strict=True):
        # The wrist was where it had been shown, until the task was done.
        shown = hands.positions[was.first : was.first + (was.last - was.first) * 2 // 3, 1, 0][::20]
        heard = made.positions[take.first : take.last, 1, 0]
        assert np.linalg.norm(shown[:, None] - heard, axis=-1).min(axis=1).max() < 0.05
    replays.assert_same(runner, lifting, made, seen)
