"""A session whose page is used in headless Chromium."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable
from pathlib import Path

import numpy as np

from dextera_build.artifacts.robots.hand_stream import LOST, HandStream
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.sim.retarget.options import Retargeting
from dextera_build.teleop.server import Server
from dextera_build.teleop.session import Plan, Session
from dextera_build.teleop.takes import Takes
from tests.teleop import headsets, operators
from tests.teleop.chromium import DESKTOP, Page, Screen, chromium

SPEED = 0.3
"""Slow motion, so that a machine that tests other things, too, keeps up."""
NO_PICTURES = "(session.headset.renderer.render = () => {}, session.headset.lastBoard = 1e12, 0)"
"""A software renderer would leave no time for anything else."""


def opened(
    bundle: TaskBundle,
    folder: Path,
    script: str,
    starts: tuple[int, ...],
    use: Callable[[Page, Session], Awaitable[None]],
    screen: Screen = DESKTOP,
    speed: float = SPEED,
) -> None:
    """Serve a session and use its page in a browser."""

    async def run() -> None:
        server, found = Server("127.0.0.1"), asyncio.Event()
        ports: list[int] = []
        takes = Takes(folder / "made.mcap", synthetic=True)
        plan = Plan(max(len(starts), 1), 0, starts, 30.0, speed, Retargeting(heading_rad=0.0))
        session = Session(bundle, plan, takes, server.publish)

        def ready(port: int) -> None:
            ports.append(port)
            found.set()

        serving = asyncio.create_task(server.serve(session, 0, ready))
        await found.wait()
        try:
            async with chromium(folder, screen, script) as page:
                await page.go(f"http://127.0.0.1:{ports[0]}{server.path()}")
                await page.until("window.session?.facts ? 1 : 0", 120)
                await use(page, session)
                assert page.faults == []
        finally:
            session.wish("end")
            await serving
        assert session.error is None

    asyncio.run(run())


class Headset:
    """Demonstrates takes of a recording in a page by an emulated headset, whose script runs in it.

    Args:
        page: The page of a session.
        hands: Hands in the robot's base.
        speed: That of the session.
    """

    def __init__(self, page: Page, hands: HandStream, speed: float = SPEED) -> None:
        self._page, self._hands, self._speed = page, hands, speed
        sides = np.flatnonzero((hands.tracking > LOST).any(axis=0)).tolist()
        known = [f"session.facts.tracked[{side}] && session.facts.measured[{side}] === 1" for side in sides]
        self._new = " && ".join(f"session.facts.measured[{side}] < 1" for side in sides)
        self._known = " && ".join(known)

    async def wear(self) -> None:
        """Enter the page's headset, and hold the hands open until they are measured."""
        await self._page.run("session.headset.enter()")
        # The emulator has hands of its own, of another size, before it plays these, and again after their end.
        await self._show(operators.opened(self._hands, 0)[0])
        await self._page.run("session.link.send({do: 'measure'})")
        await self._page.until(f"{self._new} ? 1 : 0")
        await self._page.until(f"{self._known} ? 1 : 0", 120)

    async def take(self, number: int) -> str:
        """Demonstrate a take; what the session told."""
        page, take = self._page, self._hands.takes[number]
        # Megabytes, which a page reads before the take: meanwhile it sends nothing.
        moving = json.dumps(headsets.capture(self._hands, take.first, take.last, self._speed))
        await page.run(f"(window.moving = {moving}, 0)")
        # The take begins from its first posture: on the way to it, a step that is no jump yet would move the palm, too.
        await self._show(take.first)
        await page.until(f"{self._known} ? 1 : 0")
        await page.run("session.link.send({do: 'start'})")
        await page.until("['waiting', 'taking'].includes(session.facts.phase) ? 1 : 0")
        await page.run(f"({headsets.PLAY_PACED})(window.moving, {self._speed})")
        await page.until("player.playing && session.facts.phase !== 'ready' ? 0 : 1", 240)
        await page.run("session.link.send({do: 'finish'})")
        await page.until("session.facts.phase === 'ready' ? 1 : 0")
        return str(await page.run("session.facts.told"))

    async def _show(self, row: int) -> None:
        """Hold the hands as in a message, until the session has got some; what is sent now comes after them."""
        still = json.dumps(headsets.still(self._hands, row))
        await self._page.run(f"({headsets.PLAY})({still})")
        number = await self._page.run("session.link.number")
        await self._page.until(f"session.link.number > {number + 2} ? 1 : 0")
