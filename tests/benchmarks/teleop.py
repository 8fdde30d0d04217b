"""Delay of live sessions: `python -m tests.benchmarks.teleop TASK RECORDING` prints a row of a table.

A session of the built task is opened by `dxb teleop`; the hands of the recording (of `reference.hands`) are sent to it
in real time by a program over a web socket, or with `--browser` by the page in headless Chromium with an emulated
headset. The session itself measures its share, and the page the whole way.
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
from tests.teleop.browsing import NO_PICTURES, Headset
from tests.teleop.chromium import chromium

COLUMNS = (
    "task",
    "hands from",
    "own share p50, p99 [ms]",
    "processor time in it [ms]",
    "whole way p50, p99 [ms]",
    "round trip p50, p99 [ms]",
)
COLUMNS += ("messages", "dropped", "takes kept", "load")


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
        await page.run(NO_PICTURES)
        headset = Headset(page, stream, speed)
        await headset.wear()
        for number in range(takes):
            if not (await headset.take(number)).endswith(" s"):  # not kept
                await page.run("session.link.send({do: 'skip'})")
        await asyncio.sleep(1.0)
        number = await page.run("session.link.number")
        await page.run("session.link.send({do: 'end'})")
        await asyncio.sleep(1.0)
    return int(number)


async def row(args: argparse.Namespace) -> None:
    """Print a row."""
    stream = HandStream.load(args.recording)
    takes = min(args.takes, len(stream.takes))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        process, url = await opened(args.task, Path(args.recording), folder, args.speed)
        if args.browser:
            messages = await by_browser(url, stream, takes, args.speed, folder)
        else:
            messages = await by_socket(url, stream, takes, args.speed)
        load = f"{os.getloadavg()[0]:.1f} on {os.cpu_count()} cores"
        found = await ended(process)
    delays = [found[f"{name}_ms"] for name in ("own_share", "processor", "whole_way", "round_trip")]
    told = ["–" if each is None else f"{each[0]:.1f}, {each[1]:.1f}" for each in delays]
    kept = f"{found['takes']} of {takes}"
    cells = [args.task, "browser" if args.browser else "web socket", *told]
    cells += [f"{messages:,}", f"{found['messages_dropped']:,}", kept, load]
    print("| " + " | ".join(COLUMNS) + " |\n|" + "---|" * len(COLUMNS))
    print("| " + " | ".join(cells) + " |", flush=True)


def main() -> None:
    """Print the row."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("task", help="a task that was built, RECIPE[:NODE]")
    parser.add_argument("recording", help="hands in the robot's base, .mcap")
    parser.add_argument("--takes", type=int, default=2)
    parser.add_argument("--speed", type=float, default=1.0)
    parser.add_argument("--browser", action="store_true", help="by the page with an emulated headset")
    asyncio.run(row(parser.parse_args()))


if __name__ == "__main__":
    main()
