"""The page in headless Chromium: keys move the robot, an emulated headset demonstrates, a second page is told."""

from __future__ import annotations

import asyncio
import io
import json
import shutil
from collections.abc import Awaitable, Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from dextera_build.artifacts.robots.hand_stream import HandStream
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.sim.retarget.options import Retargeting
from dextera_build.teleop.server import Server
from dextera_build.teleop.session import Plan, Session
from dextera_build.teleop.takes import Takes
from dextera_build.testing import RuleRunner
from tests import hand_tasks
from tests.robots.robot_recipes import built
from tests.teleop import headsets, operators
from tests.teleop.chromium import Page, chromium

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which("chromium") is None, reason="`.ci/system browser` installs Chromium"),
]
SPEED = 0.3
NO_PICTURES = "(session.headset.renderer.render = () => {}, session.headset.lastBoard = 1e12, 0)"
"""A software renderer would leave no time for anything else."""


@pytest.fixture(scope="module")
def runner(tmp_path_factory: pytest.TempPathFactory) -> RuleRunner:
    return RuleRunner(tmp_path_factory.mktemp("rules"))


@pytest.fixture(scope="module")
def lifting(runner: RuleRunner, tmp_path_factory: pytest.TempPathFactory) -> TaskBundle:
    return hand_tasks.lift_can(runner, built("kuka_leap", tmp_path_factory.mktemp("robot")), [])


def opened(
    bundle: TaskBundle,
    folder: Path,
    script: str,
    starts: tuple[int, ...],
    use: Callable[[Page, Session], Awaitable[None]],
) -> None:
    """Serve a session and use its page in a browser."""

    async def run() -> None:
        server, found = Server("127.0.0.1"), asyncio.Event()
        ports: list[int] = []
        takes = Takes(folder / "made.mcap", synthetic=True)
        plan = Plan(1, 0, starts, 30.0, SPEED, Retargeting(heading_rad=0.0))
        session = Session(bundle, plan, takes, server.publish)

        def ready(port: int) -> None:
            ports.append(port)
            found.set()

        serving = asyncio.create_task(server.serve(session, 0, ready))
        await found.wait()
        try:
            async with chromium(folder, script=script) as page:
                await page.go(f"http://127.0.0.1:{ports[0]}{server.path()}")
                await page.until("window.session?.facts ? 1 : 0", 120)
                await use(page, session)
                assert page.faults == []
        finally:
            session.wish("end")
            await serving
        assert session.error is None

    asyncio.run(run())


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


def test_an_emulated_headset_demonstrates_the_task(
    runner: RuleRunner, lifting: TaskBundle, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    script = headsets.script(tmp_path)
    if script is None:
        pytest.skip("npm cannot get the emulated headset")
    _, hands = hand_tasks.shown(runner, lifting, monkeypatch)
    take = hands.takes[0]

    async def use(page: Page, session: Session) -> None:
        await page.run(NO_PICTURES)
        await page.run("session.headset.enter()")
        still = headsets.capture(hands, *operators.opened(hands, 0), 0.2)
        await page.run(f"({headsets.PLAY})({json.dumps(still)})")
        # Hands by keys need no measurement; those of the headset do.
        await page.until("session.facts.measured[1] < 1 ? 1 : 0")
        await page.until("session.facts.measured[1] === 1 ? 1 : 0")
        moving = headsets.capture(hands, take.first, take.last, SPEED)
        await page.run("session.link.send({do: 'start'})")
        await page.until("['waiting', 'taking'].includes(session.facts.phase) ? 1 : 0")
        await page.run(f"({headsets.PLAY})({json.dumps(moving)})")
        await page.until("player.playing ? 0 : 1", 120)
        await page.run("session.link.send({do: 'finish'})")
        await page.until("session.facts.phase === 'ready' ? 1 : 0")
        assert await page.run("session.facts.kept") == 1, await page.run("session.facts.told")
        assert await page.run("session.link.lastWay") > 0

    opened(lifting, tmp_path, script, (take.seed or 0,), use)
    made = HandStream.load(tmp_path / "made.mcap")
    assert made.device.startswith("WebXR in ")
    assert made.head is not None
    (kept,) = made.takes
    assert kept.seed == take.seed
    way = np.ptp(made.positions[:, 1, 0], axis=0)
    np.testing.assert_allclose(way, np.ptp(hands.positions[take.first : take.last, 1, 0], axis=0), atol=0.05)
    replayed = runner.run("demonstrate.operate", backend="hands", bundle=lifting, recording=made)
    assert len(replayed.items) == 1
