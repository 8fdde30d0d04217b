"""Takes of live sessions that replay: `python -m tests.benchmarks.live_takes TASK RECORDING` prints a row of a table.

In the folder of a project where the task was built. An emulated headset demonstrates every take of the recording (of
`reference.hands`; no person made it) in the page of a session, in headless Chromium, until it is kept or the attempts
are used up. `dxb build task/from_hands` makes episodes of what was recorded; each is compared with the one that the
operator saw, bit for bit.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import pytest

from dextera_build import Project
from dextera_build.artifacts.robots.hand_stream import HandStream
from dextera_build.artifacts.tasks.episode import Episode
from dextera_build.teleop.session import Session
from tests.teleop import headsets, replays
from tests.teleop.browsing import NO_PICTURES, Headset, opened
from tests.teleop.chromium import Page

COLUMNS = ("task", "speed", "starts", "kept", "attempts", "replays equal bit for bit")


def demonstrated(args: argparse.Namespace, project: Project, stream: HandStream, folder: Path) -> list[list[str]]:
    """Demonstrate every take; per start what the session told after each attempt."""
    script = headsets.script(folder)
    assert script, "npm cannot get the emulated headset"
    told: list[list[str]] = []
    count = min(args.takes, len(stream.takes))

    async def use(page: Page, session: Session) -> None:
        await page.run(NO_PICTURES)
        headset = Headset(page, stream, args.speed)
        await headset.wear()
        kept = 0
        for number in range(count):
            told.append([])
            while len(told[-1]) < args.attempts and kept == await page.run("session.facts.kept"):
                told[-1].append(await headset.take(number))
            now = await page.run("session.facts.kept")
            if now == kept:
                await page.run("session.link.send({do: 'skip'})")
            kept = now
            print(number, told[-1], flush=True)

    seeds = tuple(take.seed or 0 for take in stream.takes[:count])
    opened(project.get(args.task), folder, script, seeds, use, speed=args.speed)
    return told


def main() -> None:
    """Print the row."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("task", help="a task that was built, RECIPE:NODE")
    parser.add_argument("recording", help="hands in the robot's base, .mcap")
    parser.add_argument("--out", default="made.mcap", help="the recording to write")
    parser.add_argument("--takes", type=int, default=10)
    parser.add_argument("--attempts", type=int, default=4, help="most attempts at one start")
    parser.add_argument("--speed", type=float, default=0.3)
    args = parser.parse_args()
    project, stream = Project.find(), HandStream.load(args.recording)
    with tempfile.TemporaryDirectory() as name, pytest.MonkeyPatch.context() as patch:
        with replays.watched(patch) as seen:
            told = demonstrated(args, project, stream, Path(name))
        Path(args.out).write_bytes((Path(name) / "made.mcap").read_bytes())
    same = replayed(args, project, seen)
    attempts = [len(each) for each in told]
    cells = [args.task, args.speed, len(told), len(seen), f"{sum(attempts)}, at most {max(attempts)}"]
    print("| " + " | ".join(COLUMNS) + " |\n|" + "---|" * len(COLUMNS))
    print("| " + " | ".join(map(str, [*cells, f"{same} of {len(seen)}"])) + " |")


def replayed(args: argparse.Namespace, project: Project, seen: list[Episode]) -> int:
    """How many episodes of the recording are those that were seen."""
    inputs = {"task": args.task, "operator": args.out}
    built = project.build("task/from_hands", "episodes", inputs=inputs)
    assert built.ok, built.errors
    made = list(built.artifact("episodes").items.values())
    assert len(made) == len(seen)
    different = [replays.differences(one, was) for one, was in zip(made, seen, strict=True)]
    print(different, flush=True)
    return sum(not each for each in different)


if __name__ == "__main__":
    main()
