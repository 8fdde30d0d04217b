"""A session whose page is used in headless Chromium."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path

from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.sim.retarget.options import Retargeting
from dextera_build.teleop.server import Server
from dextera_build.teleop.session import Plan, Session
from dextera_build.teleop.takes import Takes
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
) -> None:
    """Serve a session and use its page in a browser."""

    async def run() -> None:
        server, found = Server("127.0.0.1"), asyncio.Event()
        ports: list[int] = []
        takes = Takes(folder / "made.mcap", synthetic=True)
        plan = Plan(max(len(starts), 1), 0, starts, 30.0, SPEED, Retargeting(heading_rad=0.0))
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
