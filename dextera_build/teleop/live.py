"""A session from its beginning to its end: certificate, server, simulation, recording."""

from __future__ import annotations

import asyncio
import gc
import io
import signal
import sys
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from dextera_build.artifacts.robots.cell import Limits
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.errors import UsageError
from dextera_build.formats.ros.recording import check_new
from dextera_build.sim.experts import workplace
from dextera_build.sim.retarget.options import Retargeting
from dextera_build.teleop import certificate
from dextera_build.teleop.server import Server
from dextera_build.teleop.session import Plan, Session
from dextera_build.teleop.takes import Takes
from dextera_build.teleop.webcam import Webcam
from dextera_build.view.server import shown

SWITCH_S = 0.001
"""How long the simulation may keep the interpreter from the server [s]; 5 ms by default, a third of a message."""


@dataclass(frozen=True)
class Wanted:
    """What a session shall be."""

    bundle: TaskBundle
    out: Path
    """The recording."""
    takes: int
    seed: int
    starts: tuple[int, ...]
    """Seeds of the first starts."""
    limit_s: float
    """Longest take [s] of simulated time."""
    speed: float
    """Simulated time per real time."""
    host: str
    port: int
    certificate: tuple[Path, Path] | None
    """Certificate and key; None: plain HTTP."""
    origins: tuple[str, ...]
    """Further origins whose pages may connect."""
    synthetic: bool
    """Whether a program moves the hands."""
    limits: Limits = field(default_factory=Limits)
    """Limits that the guard enforces on the robot."""
    webcam: Callable[[], Webcam] | None = None
    """Opens what sees the hands; None: the operator's page."""


@dataclass(frozen=True)
class Opened:
    """A session that can be joined."""

    url: str
    fingerprint: str
    """SHA-256 of the certificate; empty without one."""
    port: int

    def lines(self) -> list[str]:
        """What to tell the user."""
        found = [self.code()]
        if self.fingerprint:
            found.append(f"certificate SHA-256 {self.fingerprint}: compare it when the headset warns")
        else:
            found.append(
                f"headset by cable: `adb reverse tcp:{self.port} tcp:{self.port}`, then open the same address in it"
            )
        return [
            *found,
            "Ctrl-C ends the session and discards a take that is running; takes are written as they are kept",
        ]

    def code(self) -> str:
        """The address as a QR code for terminals."""
        import segno

        out = io.StringIO()
        segno.make(self.url, error="m").terminal(out, compact=True)
        return out.getvalue().rstrip("\n")


@dataclass(frozen=True)
class Closed:
    """A session that has ended."""

    out: Path
    takes: int
    discarded: bool
    """Whether the end discarded a take that was running."""
    head: bool
    """Whether the recording has a head."""
    own_share: str
    """Delays as percentiles."""
    processor: str
    whole_way: str
    round_trip: str
    camera: str
    """From a picture to its hands; empty without a camera."""
    numbers: dict[str, Any]

    def lines(self) -> list[str]:
        """What to tell the user."""
        return [
            *(["the take that was running was discarded"] if self.discarded else []),
            f"{self.takes} takes in {self.out}" if self.takes else "no take was kept",
            f"own share of the delay: {self.own_share}; processor time in it: {self.processor}",
            f"from a picture to its hands: {self.camera}"
            if self.camera
            else f"from the page and back to it: {self.whole_way}; round trip of the network: {self.round_trip}",
        ]

    def facts(self) -> dict[str, Any]:
        """The same as data."""
        head = {"recording": str(self.out), "takes": self.takes, "discarded": self.discarded}
        return {**head, "camera_ms": None, **self.numbers}


def run(wanted: Wanted, opened: Callable[[Opened], None]) -> Closed:
    """Run a session until the operator or the user ends it.

    Raises:
        UsageError: The recording exists or cannot be written, or an option does not fit.
        MachineError: A camera cannot be read, or MediaPipe is not installed.
        RuleError: The robot has no hands that an operator's can move.
    """
    _check(wanted)
    if wanted.webcam is None:
        return _run(wanted, opened, None)
    with closing(wanted.webcam()) as webcam:
        return _run(wanted, opened, webcam)


def _run(wanted: Wanted, opened: Callable[[Opened], None], webcam: Webcam | None) -> Closed:
    encryption = certificate.context(*wanted.certificate) if wanted.certificate else None
    server = Server(wanted.host, wanted.origins, encryption)
    takes = Takes(wanted.out, synthetic=wanted.synthetic, workplace=workplace.of(wanted.bundle, wanted.limits))
    # Messages are turned into the base frame as they arrive, and recorded there.
    still = Retargeting(heading_rad=0.0)
    plan = Plan(wanted.takes, wanted.seed, wanted.starts, wanted.limit_s, wanted.speed, still, wanted.limits)
    session = Session(wanted.bundle, plan, takes, server.publish)

    def ready(port: int) -> None:
        scheme, host = "https" if encryption else "http", shown(wanted.host)
        known = certificate.fingerprint(wanted.certificate[0]) if wanted.certificate else ""
        opened(Opened(f"{scheme}://{host}:{port}{server.path()}", known, port))

    sys.setswitchinterval(SWITCH_S)
    # A collection of everything that is loaded would hold the hands back by 40 ms.
    gc.collect()
    gc.freeze()
    if webcam is not None:
        webcam.feed(session)
    asyncio.run(_serve(server, session, wanted.port, ready))
    if session.error is not None:
        raise session.error
    delays = {
        "own_share": session.own_share,
        "processor": session.processor,
        "whole_way": server.whole_way,
        "round_trip": server.round_trip,
    }
    if webcam is not None:
        delays["camera"] = webcam.delay
    numbers: dict[str, Any] = {f"{name}_ms": _rounded(each.percentiles()) for name, each in delays.items()}
    numbers |= {"messages_dropped": session.inbox.dropped, "frames_refused": server.refused}
    heads = [message.head for kept in takes.kept for _, message in kept.rows]
    return Closed(
        wanted.out,
        len(takes.kept),
        session.discarded,
        bool(heads) and bool(np.isfinite(np.array(heads)).all(axis=1).any()),
        session.own_share.told(),
        session.processor.told(),
        server.whole_way.told(),
        server.round_trip.told(),
        webcam.delay.told() if webcam else "",
        numbers,
    )


def _check(wanted: Wanted) -> None:
    check_new(wanted.out)
    if wanted.takes < 1 or not 0 < wanted.limit_s < np.inf or not 0.05 <= wanted.speed <= 1:
        raise UsageError(
            "a session needs a take, time for it, and a speed from 0.05 to 1",
            code="DXB-U336",
            facts={"takes": wanted.takes, "limit": f"{wanted.limit_s:g} s", "speed": f"{wanted.speed:g}"},
        )
    _check_limits(wanted.limits)


def _check_limits(limits: Limits) -> None:
    force = np.inf if limits.force_n is None else limits.force_n
    if not (0 < limits.speed <= 1 and force > 0):
        raise UsageError(
            "the guard needs a part of the joints' speed limits from 0 to 1, and a force above 0",
            code="DXB-U350",
            facts={"speed": f"{limits.speed:g}", "force": f"{force:g} N"},
            hint="`--joint-speed 0.5 --tip-force 20`",
        )


def _rounded(values: tuple[float, float]) -> list[float] | None:
    return [round(value, 2) for value in values] if np.isfinite(values).all() else None


async def _serve(server: Server, session: Session, port: int, ready: Callable[[int], None]) -> None:
    loop = asyncio.get_running_loop()

    def end() -> None:
        session.wish("end")
        loop.remove_signal_handler(signal.SIGINT)  # a second Ctrl-C does not wait

    loop.add_signal_handler(signal.SIGINT, end)
    await server.serve(session, port, ready)
