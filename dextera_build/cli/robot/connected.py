"""What the verbs of robots have in common: arguments, the task, the robot's names, and the transport."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dextera_build.cli import built, options, table

if TYPE_CHECKING:
    from dextera_build.artifacts.robots.cell import Limits
    from dextera_build.artifacts.tasks.task import TaskBundle, View
    from dextera_build.deploying.bag import Bag
    from dextera_build.deploying.cell import RosCell
    from dextera_build.deploying.checkup import Check
    from dextera_build.deploying.topics import Topics
    from dextera_build.deploying.transport import Transport
    from dextera_build.session import Session

CAMERA = "workspace"
TRANSPORTS = ("dds", "zenoh", "rosbridge", "rclpy")
ANYWHERE = "0.0.0.0"
"""Where a simulated robot that others read listens as a router."""

MOST_LIMIT_S = 86400.0
"""Longest run or recording, a day [s]."""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of all verbs of robots."""
    parser.add_argument("target", metavar="RECIPE[:NODE]", help="a task that was built")
    parser.add_argument("--names", metavar="RECIPE:NODE", help="names of the robot, of simulate.ros_names")
    parser.add_argument(
        "--view",
        metavar="RECIPE:NODE",
        action="append",
        default=[],
        help="camera of a policy that takes pictures; of several, each as NAME=RECIPE:NODE",
    )
    parser.add_argument("--camera", default=CAMERA, help=f"name of the only camera in topics ({CAMERA})")
    parser.add_argument("--domain", type=int, default=0, help="ROS_DOMAIN_ID of the robot (0)")
    parser.add_argument(
        "--transport",
        choices=TRANSPORTS,
        default="dds",
        help="zenoh: the robot uses rmw_zenoh_cpp; rosbridge: a server of rosbridge runs on it; rclpy: a node of the "
        "ROS 2 that is installed here (dds)",
    )
    options.project_arguments(parser)
    options.json_argument(parser)
    parser.set_defaults(input=[], settings=[], backends=[])


@dataclass(frozen=True)
class Connected:
    """A task with the topics of its robot."""

    session: Session
    """The recipe of the task."""
    bundle: TaskBundle
    """The task."""
    topics: Topics
    """Topics of the robot."""
    views: Mapping[str, View]
    """Camera in topics -> the view of policies on pictures."""
    seen: Mapping[str, View]
    """The same by the names of policies, whose only camera is called `PICTURE`."""


def opened(args: argparse.Namespace) -> Connected:
    """The task and the names that the arguments state.

    Raises:
        UsageError: A node is none of the needed type.
    """
    from dextera_build.artifacts.robots.ros_names import RosNames
    from dextera_build.artifacts.tasks.task import View
    from dextera_build.deploying import topics
    from dextera_build.policy.cameras import PICTURE

    session, node = options.session(args, args.target, last=True)
    verb = " ".join(filter(None, (args.verb, getattr(args, "what", ""))))
    _, bundle = built.task(args.target, session, node, verb)
    names = built.artifact(args, args.names, RosNames) if args.names else RosNames()
    given = _named(args.view)
    views = {name or args.camera: built.artifact(args, target, View) for name, target in given.items()}
    seen = {name or PICTURE: view for name, view in zip(given, views.values(), strict=True)}
    return Connected(session, bundle, topics.of_robot(bundle.robot, names, views), views, seen)


def _named(given: Sequence[str]) -> dict[str, str]:
    """Name of each camera -> its target; the only one may have none.

    Raises:
        UsageError: There are several, and not each has a name of its own.
    """
    from dextera_build.errors import UsageError
    from dextera_build.policy.cameras import NAME

    found = {name: target for name, _, target in (text.rpartition("=") for text in given)}
    if len(found) < len(given) or not all(map(NAME.fullmatch, found if len(given) > 1 else filter(None, found))):
        raise UsageError(
            "several cameras need a name each, of small letters, digits and underscores",
            code="DXB-U353",
            facts={"given": " ".join(given)},
            hint="`--view front=RECIPE:NODE --view side=RECIPE:NODE`",
        )
    return found


def kept(args: argparse.Namespace, limits: Limits) -> Limits:
    """Limits with those of the cell that the arguments state, whichever are stricter."""
    from dextera_build.artifacts.robots.cell import Cell

    return limits.stricter(built.artifact(args, args.cell, Cell).limits) if args.cell else limits


def watched(args: argparse.Namespace, here: Connected) -> Topics:
    """Topics of the robot with those of its only camera, whether or not a policy takes pictures."""
    from dextera_build.deploying import topics

    return topics.of_robot(here.bundle.robot, here.topics.names, (args.camera,))


def transport(args: argparse.Namespace, peers: tuple[str, ...], *, simulates: bool = False) -> Transport:
    """A program in the robot's domain.

    Args:
        args: The arguments.
        peers: Addresses of the robot, or of those who read the simulated one.
        simulates: Whether it takes the place of the robot, where the router of Zenoh is.

    Raises:
        UsageError: There is no such domain, or a simulated robot is no server of rosbridge.
        MachineError: The package of the transport is missing, or the network cannot be used.
    """
    from dextera_build.deploying import dds, rclpy_wire, rosbridge, zenoh_wire
    from dextera_build.errors import UsageError

    if not 0 <= args.domain <= dds.MOST_DOMAIN:
        raise UsageError(
            f"there is no domain {args.domain}", code="DXB-U345", hint=f"`--domain N`, 0 to {dds.MOST_DOMAIN}"
        )
    if args.transport == "zenoh":
        address = (ANYWHERE if peers else dds.LOCAL) if simulates else peers[0]
        return zenoh_wire.Zenoh(address, args.domain, routes=simulates)
    if args.transport == "rclpy":
        return rclpy_wire.Rclpy(peers, args.domain)
    if args.transport == "rosbridge" and simulates:
        raise UsageError(
            "a simulated robot is no server of rosbridge",
            code="DXB-U352",
            hint="`--transport dds` or `--transport zenoh`; a server of rosbridge in the same domain then finds it",
        )
    return rosbridge.Rosbridge(peers[0]) if args.transport == "rosbridge" else dds.Dds(peers, args.domain)


def shown(checks: tuple[Check, ...]) -> list[dict[str, Any]]:
    """Print checks on stderr, and return them as plain data."""
    for each in checks:
        print(f"{'ok  ' if each.ok else 'FAIL'} {each.what}: {each.found}", file=sys.stderr)
        if not each.ok and each.mend:
            print(f"     {each.mend}", file=sys.stderr)
    return [{"check": each.what, "ok": each.ok, "found": each.found, "mend": each.mend or None} for each in checks]


def refuse(
    args: argparse.Namespace, here: Connected, transport: Transport, cell: RosCell, *, commands: bool = True
) -> None:
    """Check a robot before its run; `commands`: whether it is dxb that commands it.

    Raises:
        MachineError: A check failed.
    """
    from dextera_build.deploying.checkup import checkup
    from dextera_build.errors import MachineError

    checks = checkup(transport, here.topics, cell, here.bundle.robot, time.sleep, commands=commands)
    failed = [each for each in checks if not each.ok]
    if failed:
        raise MachineError(
            f"the robot at `{args.robot}` is not ready: {failed[0].what}: {failed[0].found}",
            code="DXB-E442",
            facts={each.what: each.found for each in failed[1:]},
            hint=failed[0].mend or f"`dxb robot doctor {args.target} --robot {args.robot}` lists all checks",
        )


@contextmanager
def recorded(args: argparse.Namespace, out: Path) -> Iterator[tuple[Transport, Bag]]:
    """The robot's transport and a new recording, both closed at the end; a run that fails before it begins leaves none.

    Raises:
        UsageError: There is such a recording, or it cannot be written.
        MachineError: The network cannot be used.
    """
    from dextera_build.deploying.bag import Bag

    bag = Bag.create(out)
    try:
        with closing(bag), closing(transport(args, (args.robot,))) as robot:
            yield robot, bag
    except BaseException:
        if not bag.periods:
            out.unlink()
        raise


def judged(args: argparse.Namespace, bag: Bag, told: dict[str, Any], success: bool | None) -> None:
    """Record what happened, and the verdicts of the measurements and of the operator."""
    from dextera_build.deploying.bag import SUMMARY, VERDICT

    bag.state(SUMMARY, time.time_ns(), told)
    operator = None
    try:
        operator = _verdict(args)
    finally:  # also if the operator interrupts the question
        bag.state(VERDICT, time.time_ns(), {"measured": success, "operator": operator})


def tell(args: argparse.Namespace, told: dict[str, Any], out: Path) -> None:
    """Print what happened, and the recording."""
    told["recording"] = str(out)
    document = ".".join(filter(None, (args.verb, getattr(args, "what", ""))))
    table.say(document, told, "\n".join(f"{name}\t{value}" for name, value in told.items()), as_json=args.json)


def _verdict(args: argparse.Namespace) -> bool | None:
    """The operator's verdict, if one sits there."""
    if args.json or not sys.stdin.isatty():
        return None
    print("did it succeed? y, n, or Enter to keep what was measured: ", end="", file=sys.stderr, flush=True)
    return {"y": True, "n": False}.get(sys.stdin.readline().strip().lower())


def recording_arguments(parser: argparse.ArgumentParser, folder: str) -> None:
    """Add the arguments of verbs that record a robot."""
    parser.add_argument("--robot", metavar="HOST", default="127.0.0.1", help="address of the robot (127.0.0.1)")
    parser.add_argument("--out", metavar="FILE", help=f"the recording to write, .mcap ({folder}/TASK-TIME.mcap)")


def limit_argument(parser: argparse.ArgumentParser, what: str) -> None:
    """Add the time limit of what is recorded."""
    read = options.number("--limit", 0.0, MOST_LIMIT_S, above=True)
    parser.add_argument("--limit", type=read, metavar="S", help=f"longest {what} in seconds (of the task)")


def recording(args: argparse.Namespace, here: Connected, folder: str) -> Path:
    """The recording to write.

    Raises:
        UsageError: There is one, or it cannot be written.
    """
    from dextera_build.formats.ros.recording import check_new

    out = Path(args.out or time.strftime(f"{folder}/{here.bundle.task.name}-%Y%m%d-%H%M%S.mcap"))
    check_new(out)
    return out
