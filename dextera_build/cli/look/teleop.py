"""`dxb teleop`: demonstrate a task by hand in real time, and record the hands."""

from __future__ import annotations

import argparse
import shlex
import sys
import webbrowser
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from dextera_build.cli import built, options, table

if TYPE_CHECKING:
    from dextera_build.teleop.live import Opened
    from dextera_build.teleop.webcam import Webcam

PORT = 8012
LOCAL = ("127.0.0.1", "localhost", "::1")
"""Addresses whose pages browsers trust without HTTPS."""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    parser.add_argument("target", metavar="RECIPE[:NODE]", help="a task that was built")
    parser.add_argument("--takes", type=int, default=10, metavar="N", help="number of takes to record (10)")
    parser.add_argument(
        "--out", metavar="FILE", help="the recording to write, .mcap (recordings/NAME.mcap, after the recipe)"
    )
    parser.add_argument("--seed", type=int, default=0, help="seed of the starts (0)")
    parser.add_argument("--starts", metavar="FILE", help="a recording whose takes' starts come first, .mcap")
    parser.add_argument("--limit", type=float, default=60.0, metavar="S", help="longest take in seconds (60)")
    parser.add_argument(
        "--speed", type=float, default=1.0, help="simulated time per real time (1; 0.5: slow motion at half speed)"
    )
    parser.add_argument(
        "--joint-speed", type=float, default=1.0, help="part of the joints' speed limits that the guard lets pass (1)"
    )
    parser.add_argument("--tip-force", type=float, help="force on a fingertip in newtons at which the guard stops it")
    parser.add_argument("--port", type=options.port, default=PORT, help=f"port to listen on ({PORT}; 0: any free one)")
    parser.add_argument(
        "--host", default=LOCAL[0], metavar="ADDRESS", help="address to listen on (127.0.0.1: this machine alone)"
    )
    parser.add_argument("--cert", metavar="FILE", help="certificate for HTTPS, PEM (default: one made here)")
    parser.add_argument("--key", metavar="FILE", help="its key, PEM")
    parser.add_argument("--allow-origin", action="append", default=[], metavar="ORIGIN", help="also admit this origin")
    parser.add_argument("--webcam", metavar="N|FILE", help="hands from a camera, by its number, or from a film")
    parser.add_argument("--webcam-view", type=float, default=60.0, metavar="DEG", help="its angle of view (60)")
    parser.add_argument(
        "--hand-length", type=float, default=0.19, metavar="M", help="your hand from wrist to middle fingertip (0.19 m)"
    )
    parser.add_argument("--synthetic", action="store_true", help="a program moves the hands; the recording says so")
    parser.add_argument("--no-open", action="store_true", help="do not open the browser")
    options.project_arguments(parser)
    options.json_argument(parser)
    parser.set_defaults(input=[], settings=[], backends=[])


def run(args: argparse.Namespace) -> int:
    """Serve until the session is ended; the address goes to stdout, and at the end the command that replays it."""
    from dextera_build.artifacts.robots.cell import Limits
    from dextera_build.running import called
    from dextera_build.teleop import live

    session, node = options.session(args, args.target, last=True)
    with called.shown(session.project.library):
        node, bundle = built.task(args.target, session, node, "teleop")
        name = session.recipe.rpartition("/")[2]
        out = Path(args.out or f"recordings/{name}.mcap")
        wanted = live.Wanted(
            bundle=bundle,
            out=out,
            takes=args.takes,
            seed=args.seed,
            starts=_starts(args.starts),
            limit_s=args.limit,
            speed=args.speed,
            host=args.host,
            port=args.port,
            certificate=_certificate(args),
            origins=tuple(args.allow_origin),
            synthetic=args.synthetic,
            limits=Limits(speed=args.joint_speed, force_n=args.tip_force),
            webcam=_webcam(args),
        )
        ended = live.run(wanted, lambda opened: _opened(args, opened))
    replay = f"dxb build task/from_hands --input {shlex.quote(f'task={session.recipe}:{node}')}"
    replay += f" --input {shlex.quote(f'operator={out}')}" + ("" if ended.head else " --set hands.head=''")
    if args.json:
        told = ended.facts() | {"replay": replay if ended.takes else None}
        table.say("teleop.ended", told, "", as_json=True)
        return 0
    for line in ended.lines():
        print(line, file=sys.stderr)
    if ended.takes:
        print(replay)
    return 0


def _starts(path: str | None) -> tuple[int, ...]:
    """Seeds of a recording's takes."""
    from dextera_build.artifacts.robots.hand_stream import HandStream

    takes = HandStream.load(path).takes if path else ()
    return tuple(take.seed for take in takes if take.seed is not None)


def _certificate(args: argparse.Namespace) -> tuple[Path, Path] | None:
    """Certificate and key; None: plain HTTP, which browsers trust on this machine alone."""
    from dextera_build.errors import UsageError
    from dextera_build.project import settings
    from dextera_build.teleop import certificate
    from dextera_build.view import server

    if bool(args.cert) != bool(args.key):
        raise UsageError("`--cert` and `--key` belong together", code="DXB-U334", hint="`--cert FILE --key FILE`")
    if args.cert:
        return Path(args.cert), Path(args.key)
    return None if args.host in LOCAL else certificate.own(settings.user_folder() / "teleop", server.shown(args.host))


def _webcam(args: argparse.Namespace) -> Callable[[], Webcam] | None:
    from dextera_build.project import settings
    from dextera_build.teleop.webcam import Webcam

    if args.webcam is None:
        return None
    folder = settings.user_folder() / "teleop" / "mediapipe"
    return partial(Webcam, args.webcam, folder, args.webcam_view, args.hand_length)


def _opened(args: argparse.Namespace, opened: Opened) -> None:
    table.say("teleop", {"url": opened.url}, opened.url, as_json=args.json)
    if not args.json:
        for line in opened.lines():
            print(line, file=sys.stderr)
    if not args.no_open and args.host in LOCAL:
        webbrowser.open(opened.url)
