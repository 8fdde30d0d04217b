"""The tracker beside a run: `dxb robot track` in a process of its own, so that frames delay no control period."""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager

from dextera_build.cli.robot.track import READY

SAME = ("cell", "photograph", "names", "camera", "domain", "transport", "robot", "cache", "profile")
"""Options that the tracker gets as the run has them."""
START_S = 120.0
"""Longest time until the tracker is ready [s]: it draws the twin, and waits for the camera."""
END_S = 20.0
"""Longest time until it has ended [s]."""


@contextmanager
def tracker(args: argparse.Namespace) -> Iterator[None]:
    """Track the objects of a task while something runs, if a cell is stated; what the tracker says goes to stderr.

    Raises:
        MachineError: It ends before it is ready.
    """
    if not args.cell:
        yield
        return
    from dextera_build.errors import MachineError

    command = [sys.executable, "-P", "-m", "dextera_build", "robot", "track", args.target, "--parent", str(os.getpid())]
    for name in SAME:
        if (value := getattr(args, name, None)) not in (None, ""):
            command += [f"--{name}", str(value)]
    # A session of its own, so that Ctrl-C ends the run first, and the tracker after it.
    process = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    said, ready = deque[str](maxlen=20), threading.Event()
    reader = threading.Thread(target=_relay, args=(process, said, ready), name="tracker", daemon=True)
    reader.start()
    try:
        if not ready.wait(START_S) or process.poll() is not None:
            raise MachineError(
                "the tracker of the objects is not ready",
                code="DXB-E445",
                facts={"it said": "\n".join(said)},
                hint=f"`dxb robot track {args.target} --cell {args.cell}` in a terminal of its own",
            )
        yield
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(END_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        reader.join(END_S)


def _relay(process: subprocess.Popen[str], said: deque[str], ready: threading.Event) -> None:
    """Pass on what the tracker says; it is ready once it tracks, and waited for no more once it ends."""
    assert process.stderr is not None
    for line in process.stderr:
        said.append(line.rstrip())
        print(f"tracker: {line.rstrip()}", file=sys.stderr, flush=True)
        if line.startswith(READY):
            ready.set()
    process.wait()
    ready.set()
