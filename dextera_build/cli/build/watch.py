"""`dxb watch`: build, wait until something that the build read changes, build again."""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dextera_build.cli import options
from dextera_build.errors import DxbError, MachineError
from dextera_build.store import signature

_STEP_MS = 80
"""Changes are taken together until so long nothing more changed."""
_LOOK_MS = 300
"""How soon after it began to wait it looks for what changed before that."""
_RACY_S = 0.1
_FIRST = "first build"


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    parser.add_argument("targets", nargs="+", metavar="RECIPE[:TARGET]", help="targets to keep up to date")
    parser.add_argument(
        "-k", "--keep-going", action="store_true", help="continue with nodes that do not depend on a failed one"
    )
    parser.add_argument("-j", "--jobs", metavar="N", help="number of cores to use; most nodes take one (DXB_JOBS)")
    parser.add_argument(
        "--console", metavar="KIND", default="none", help="live, plain or none (the default: a line a round)"
    )
    parser.add_argument("-v", "--verbose", action="store_true", help="with a console, also show the logs of nodes")
    parser.set_defaults(force=[], whole=False)
    options.project_arguments(parser)
    options.request_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Print one line a round on stderr; end with 0 when Ctrl-C comes while it waits, with 130 when it stops a build."""
    words, because = args.words[1:], _FIRST
    while True:
        told = _round(words, because)
        if told is None:
            return 130
        if told["usage"] and because == _FIRST:
            return 2  # An unknown name is not a recipe that an edit could repair.
        try:
            because = _wait(Seen.of(told))
        except KeyboardInterrupt:
            print("stopped watching; nothing changed since the last build", file=sys.stderr)
            return 0


@dataclass(frozen=True)
class Seen:
    """What a round read, with signatures from before it was read."""

    files: dict[str, signature.Signature | None]
    folders: dict[str, list[str] | None]
    paths: dict[str, list[str] | None]
    """Folders of the module search path, with what can be imported from them."""
    started_ns: int

    @classmethod
    def of(cls, told: Mapping[str, Any]) -> Seen:
        """What a report says."""
        files = {path: tuple(sign) if sign else None for path, sign in told["files"].items()}
        return cls(files, told["folders"], told["paths"], told["started_ns"])

    def changed(self) -> str | None:
        """A file or folder that is not what it was, or None."""
        for path, known in self.files.items():
            if signature.look(path) != known:
                return path
        folders = (path for path, known in self.folders.items() if signature.names(path) != known)
        paths = (path for path, known in self.paths.items() if signature.modules(path) != known)
        return next(folders, None) or next(paths, None)

    def racy(self) -> str | None:
        """A file that was written so shortly before it was read that its signature proves nothing, or None."""
        known = self.files.items()
        return next((path for path, sign in known if sign and signature.is_racy(sign, self.started_ns)), None)

    def places(self) -> list[str]:
        """Folders in which something must happen before `changed` can find anything."""
        wanted = {str(Path(file).parent) for file in self.files} | set(self.folders) | set(self.paths)
        found = set()
        for name in wanted:
            folder = Path(name)
            found.add(str(next(place for place in (folder, *folder.parents) if place.is_dir())))
        return sorted(found)


def _round(words: Sequence[str], because: str) -> dict[str, Any] | None:
    """The report of a build in a process of its own; None where Ctrl-C stopped it."""
    began = time.strftime("%H:%M:%S")
    # A file without a name, so that nothing is left where this process is killed.
    with os.fdopen(os.memfd_create("report"), "r+") as report:
        command = [sys.executable, "-m", "dextera_build.cli.build.watch_once", str(report.fileno()), *words]
        # In a session of its own, so that Ctrl-C reaches it once: from here.
        child = subprocess.Popen(command, start_new_session=True, pass_fds=[report.fileno()])
        try:
            code = child.wait()
        except KeyboardInterrupt:
            _interrupt(child)
            print("interrupted; finished results are kept", file=sys.stderr)
            return None
        report.seek(0)
        text = report.read()
    if not text:
        raise DxbError(
            f"a round ended without a report, with {code}",
            code="DXB-X002",
            facts={"arguments": " ".join(words)},
            hint="`dxb build` on the same targets says more",
        )
    told: dict[str, Any] = json.loads(text)
    print(f"{began}  {'; '.join(told['lines'])}  ({because})", file=sys.stderr, flush=True)
    return told


def _interrupt(child: subprocess.Popen[bytes]) -> None:
    with suppress(ProcessLookupError):
        child.send_signal(signal.SIGINT)
    child.wait()


def _wait(seen: Seen) -> str:
    """Return, once something that was read has changed, why to build again."""
    try:
        import watchfiles
    except ImportError:
        raise MachineError(
            "`dxb watch` needs the package `watchfiles`, which is not installed",
            code="DXB-E302",
            hint="`pip install watchfiles`",
        ) from None
    if (path := seen.racy()) is not None:
        time.sleep(_RACY_S)
        return f"{_shown(path)} was written while it was read"
    rounds = watchfiles.watch(
        *seen.places(),
        watch_filter=None,
        step=_STEP_MS,
        rust_timeout=_LOOK_MS,
        yield_on_timeout=True,
        recursive=False,
        ignore_permission_denied=True,
    )
    looked = False
    for events in rounds:
        # The first time in any case: what changed between the build and the start of the watch gave no event.
        if (events or not looked) and (path := seen.changed()) is not None:
            return f"{_shown(path)} changed"
        looked = True
    raise KeyboardInterrupt


def _shown(path: str) -> str:
    here = Path.cwd()
    return str(Path(path).relative_to(here)) if Path(path).is_relative_to(here) else path
