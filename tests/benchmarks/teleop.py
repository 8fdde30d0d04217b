"""Delay of live sessions: `python -m tests.benchmarks.teleop TASK RECORDING` prints rows of a table.

A session of the built task is opened by `dxb teleop`; the hands of the recording (of `reference.hands`) are sent to it
in real time, first by a program over a web socket, and with `--browser` also by the page in headless Chromium with an
emulated headset. The session itself measures its share, and the page the whole way.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import sys
import tempfile
from pathlib import Path
from typing import Any

from websockets.asyncio.client import connect

from dextera_build.artifacts.robots.hand_stream import HandStream
from tests.teleop import headsets, operators
from tests.teleop.chromium import chromium

COLUMNS = (
    "task",
    "hands from",
    "own share p50, p99 [ms]",
    "processor time in it [ms]",
    "whole way p50, p99 [ms]",
    "round trip p50, p99 [ms]",
)
COLUMNS += ("messages", "dropped", "load")


async def opened(task: str, stream: Path, folder: Path, speed: float) -> tuple[asyncio.subprocess.Process, str]:
    """A session as a process of its own, and its address."""
    words = ["-m", "dextera_build", "teleop", task, "--no-open", "--port", "0", "--synthetic", "--json"]
    words += ["--out", str(folder / "made.mcap"), "--starts", str(stream), "--takes", "1000", "--speed", str(speed)]
    process = await asyncio.create_subprocess_exec(sys.executable, *words, stdout=asyncio.subprocess.PIPE)
    assert process.stdout
    return process, json.loads(await process.stdout.readline())["url"]


async def ended(process: asyncio.subprocess.Process) -> dict[str, Any]:
    """What a session says at its end."""
    assert process.stdout
    return json.loads(await process.stdout.readline())


async def by_socket(url: str, stream: HandStream, takes: int, speed: float) -> int:
    """Demonstrate over a web socket; the number of messages."""
    async with connect(url.replace("http", "ws", 1) + "socket", compression=None) as socket:
        operator = operators.Operator(socket, stream, speed)
        watching = asyncio.create_task(operator.watch())
        while not operator.facts:
            await asyncio.sleep(0.1)
        for number in range(takes):
            kept = operator.facts["kept"]
            await operator.take(number)
            if operator.facts["kept"] == kept:
                await socket.send(json.dumps({"do": "skip"}))
        await socket.send(json.dumps({"do": "end"}))
        await asyncio.wait([watching], timeout=10)
    return sum(take.last - take.first for take in stream.takes[:takes])


async def by_browser(url: str, stream: HandStream, takes: int, speed: float, folder: Path) -> int:
    """Demonstrate in a page; the number of messages that it sent."""
    script = headsets.script(folder)
    assert script, "npm cannot get the emulated headset"
    async with chromium(folder, script=script) as page:
        await page.go(url)
        await page.until("window.session?.facts ? 1 : 0", 120)
        # A software renderer would leave no time for anything else.
        await page.run("(session.headset.renderer.render = () => {}, session.headset.lastBoard = 1e12, 0)")
        await page.run("session.headset.enter()")
        await asyncio.sleep(2.0)  # until hands by keys, which need no measurement, have gone
        for number, take in enumerate(stream.takes[:takes]):
            still = headsets.capture(stream, *operators.opened(stream, number), 0.5)
            await page.run(f"({headsets.PLAY})({json.dumps(still)})")
            await page.until("session.facts.measured[1] === 1 ? 1 : 0")
            await page.run("session.link.send({do: 'start'})")
            await page.until("session.facts.phase === 'taking' ? 1 : 0")
            moving = headsets.capture(stream, take.first, take.last, speed)
            await page.run(f"({headsets.PLAY})({json.dumps(moving)})")
            await page.until("player.playing && session.facts.phase !== 'ready' ? 0 : 1", 120)
            await page.run("session.link.send({do: 'discard'})")
            await page.until("session.facts.phase === 'ready' ? 1 : 0")
            await page.run("session.link.send({do: 'skip'})")
        await asyncio.sleep(1.0)
        number = await page.run("session.link.number")
        await page.run("session.link.send({do: 'end'})")
        await asyncio.sleep(1.0)
    return int(number)


async def rows(args: argparse.Namespace) -> None:
    """Print a row per source of hands."""
    stream = HandStream.load(args.recording)
    print("| " + " | ".join(COLUMNS) + " |\n|" + "---|" * len(COLUMNS))
    for source in ("socket", "browser")[: 1 + args.browser]:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            process, url = await opened(args.task, Path(args.recording), folder, args.speed)
            takes = min(args.takes, len(stream.takes))
            if source == "socket":
                messages = await by_socket(url, stream, takes, args.speed)
            else:
                messages = await by_browser(url, stream, takes, args.speed, folder)
            load = f"{os.getloadavg()[0]:.0f} on {os.cpu_count()} cores"
            found = await ended(process)
        delays = [found[f"{name}_ms"] for name in ("own_share", "processor", "whole_way", "round_trip")]
        told = ["–" if each is None else f"{each[0]:.1f}, {each[1]:.1f}" for each in delays]
        cells = [args.task, source, *told, f"{messages:,}", f"{found['messages_dropped']:,}", load]
        print("| " + " | ".join(cells) + " |", flush=True)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("task", help="a task that was built, RECIPE[:NODE]")
    parser.add_argument("recording", help="hands in the robot's base, .mcap")
    parser.add_argument("--takes", type=int, default=2)
    parser.add_argument("--speed", type=float, default=1.0)
    parser.add_argument("--browser", action="store_true", help="also the page with an emulated headset")
    asyncio.run(rows(parser.parse_args()))


if __name__ == "__main__":
    main()
