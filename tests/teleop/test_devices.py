"""Controllers and a gamepad in the page, in headless Chromium; both are emulated, no device was used."""

from __future__ import annotations

import asyncio
import shutil
from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.teleop.session import Session
from tests.teleop import headsets
from tests.teleop.browsing import NO_PICTURES, opened
from tests.teleop.chromium import Page

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which("chromium") is None, reason="`.ci/system browser` installs Chromium"),
]
STEP_M, STEPS, STEP_S = 0.01, 8, 0.3
"""A controller goes on by this way, this often, in this time."""
PAD = """(() => {
  const buttons = Array.from({ length: 17 }, () => ({ value: 0, pressed: false }));
  window.pad = { connected: true, axes: [0, 0, 0, 0], buttons };
  Object.defineProperty(navigator, "getGamepads", { value: () => [null, window.pad] });
})()"""
"""A gamepad as browsers describe one with the standard mapping."""


def test_a_controller_moves_the_robot_while_its_grip_is_pressed(lifting: TaskBundle, tmp_path: Path):
    script = headsets.script(tmp_path)
    if script is None:
        pytest.skip("npm cannot get the emulated headset")

    async def use(page: Page, session: Session) -> None:
        await page.run(NO_PICTURES)
        height = 1.1
        await place(page, height)
        await page.run("session.headset.enter()")
        await page.until("session.headset.placed === null ? 0 : 1")
        number = await page.run("session.link.number")
        while session._last is None or session._last.number < number:
            await asyncio.sleep(0.05)
        grip = headsets.turned(np.append(session._last.positions[1, 0], [1, 0, 0, 0])[None])[0, :3].tolist()
        assert np.linalg.norm(np.array(grip) - [0.2, height, -0.4]) < 0.1
        await page.until(f"{headsets.OFF}(1, {grip}) < 1e-3 ? 1 : 0", 20)
        await page.run("session.link.send({do: 'start'})")
        await page.until("session.facts.phase === 'waiting' ? 1 : 0")
        # The grip is open: the controller moves, and the take does not begin.
        height = await raised(page, height)
        assert await page.run("session.facts.phase") == "waiting"
        await page.run("device.controllers.right.updateButtonValue('squeeze', 1)")
        await page.until("session.facts.phase === 'taking' && session.facts.clutch[1] ? 1 : 0")
        before = palm(session)
        height = await raised(page, height)
        way = palm(session) - before
        assert 0.5 * STEP_M * STEPS < way[2] < 1.5 * STEP_M * STEPS
        assert np.abs(way[:2]).max() < 0.5 * way[2]
        fingers = hand(session)
        await page.run("device.controllers.right.updateButtonValue('trigger', 1)")
        await page.until(f"session.facts.seconds > {await page.run('session.facts.seconds') + 0.6} ? 1 : 0")
        assert np.abs(hand(session) - fingers).max() > 0.3
        # With an open grip the robot stays, wherever the controller goes.
        await page.run("device.controllers.right.updateButtonValue('squeeze', 0)")
        await page.until("session.facts.held.arm ? 1 : 0")
        still = palm(session)
        await raised(page, height)
        assert np.linalg.norm(palm(session) - still) < 0.01
        assert await page.run("session.facts.phase") == "taking", await page.run("session.facts.told")
        await page.run("session.link.send({do: 'discard'})")
        await page.until("session.facts.told === 'discarded' ? 1 : 0")
        assert session.takes.device.startswith("WebXR in ")

    opened(lifting, tmp_path, script.replace('"hand"', '"controller"'), (), use)


def test_a_gamepad_moves_turns_and_closes_the_hand(lifting: TaskBundle, tmp_path: Path):
    async def use(page: Page, session: Session) -> None:
        await page.run(PAD)
        await page.run(NO_PICTURES)
        await page.run("document.getElementById('view').focus()")
        await page.key("Enter")
        await page.until("session.facts.phase === 'taking' ? 1 : 0")
        before = palm(session)
        await held(page, "pad.buttons[7].value", 1, 0.5)
        raised = palm(session) - before
        assert raised[2] > 0.02
        assert np.abs(raised[:2]).max() < 0.5 * raised[2]
        before = palm(session)
        await held(page, "pad.axes[1]", -1, 0.4)
        ahead = palm(session) - before
        assert np.linalg.norm(ahead[:2]) > 0.02
        assert abs(ahead[2]) < 0.5 * np.linalg.norm(ahead[:2])
        before = palm(session)
        # What rests is not exactly in the middle.
        await held(page, "pad.axes[1]", 0.1, 0.3)
        assert np.linalg.norm(palm(session) - before) < 0.01
        yaw = session.environment.palm_poses()[0, 3:].copy()
        await held(page, "pad.axes[2]", 1, 0.4)
        assert 2 * np.arccos(min(1.0, abs(float(yaw @ session.environment.palm_poses()[0, 3:])))) > 0.1
        fingers = hand(session)
        await page.run("pad.buttons[0].value = 1")
        await page.until("session.keys.closed[1] > 0.9 ? 1 : 0")
        assert np.abs(hand(session) - fingers).max() > 0.3
        await page.run("(pad.buttons[0].value = 0, pad.buttons[1].value = 1)")
        await page.until("session.keys.closed[1] < 0.1 ? 1 : 0")
        assert await page.run("session.facts.phase") == "taking", await page.run("session.facts.told")

    opened(lifting, tmp_path, "", (), use)


async def place(page: Page, height: float) -> None:
    """Put the right controller at a height [m], ahead of the operator."""
    await page.run(f"device.controllers.right.position.set(0.2, {height}, -0.4)")


async def raised(page: Page, height: float) -> float:
    """Raise it slowly; where it is then [m]."""
    for _ in range(STEPS):
        height += STEP_M
        await place(page, height)
        await asyncio.sleep(STEP_S)
    return height


async def held(page: Page, what: str, value: float, seconds: float) -> None:
    """Hold a stick or a button for a simulated time [s], and then wait until the robot has come after."""
    now = await page.run("session.facts.seconds")
    await page.run(f"({what} = {value})")
    await page.until(f"session.facts.seconds > {now + seconds} ? 1 : 0")
    await page.run(f"({what} = 0)")
    await page.until(f"session.facts.seconds > {now + seconds + 0.3} ? 1 : 0")


def palm(session: Session) -> np.ndarray:
    """Place (3,) of the palm in the base [m]."""
    return session.environment.palm_poses()[0, :3].copy()


def hand(session: Session) -> np.ndarray:
    """Targets of the hand's joints [rad]."""
    joints = session.environment.bundle.robot.joints
    return session.environment.previous_action[[joint.group == "hand" for joint in joints]].copy()
