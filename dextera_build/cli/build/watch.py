"""`dxb watch`: build, wait until a file that the build read changes, build again."""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from dextera_build.calls.spending import LEDGER, open_ledger
from dextera_build.cli import options, streams
from dextera_build.cli.build.shown import shown, suggest, tell
from dextera_build.cli.consoles import console
from dextera_build.cli.errors import render, wants_colour
from dextera_build.errors import DxbError, MachineError, UsageError
from dextera_build.report.wording import duration, states
from dextera_build.store import signature
from dextera_build.store.signature import Watch

if TYPE_CHECKING:
    from dextera_build.project.project import Project

_STEP_MS = 80
"""Changes are batched until there is none for this long [ms]."""
_LOOK_MS = 300
"""Delay before the check for changes that preceded the wait [ms]."""
_RACY_S = 0.1
_FIRST = "first build"


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    parser.add_argument("targets", nargs="+", metavar="RECIPE[:TARGET]", help="targets to keep up to date")
    options.build_arguments(parser)
    parser.add_argument(
        "--console", metavar="KIND", default="none", help="live, plain or none (the default: a line a round)"
    )
    parser.add_argument("-v", "--verbose", action="store_true", help="with a console, also show the logs of nodes")
    parser.add_argument("--once", nargs=2, help=argparse.SUPPRESS)
    options.project_arguments(parser)
    options.request_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Print one line per round on stderr; return 0 if Ctrl-C interrupts the wait, 130 if a build."""
    if args.once:
        return _once(args, *args.once)
    because = _FIRST
    _, os.environ[LEDGER] = open_ledger()  # `--max-cost` limits all rounds together
    while True:
        code, watch = _round(args.words[1:], because)
        if code in (streams.INTERRUPTED, streams.TERMINATED) or (code == 2 and because == _FIRST):
            return code  # an edit cannot fix an unknown name
        try:
            because = _wait(watch)
        except KeyboardInterrupt:
            print("stopped watching; nothing changed since the last build", file=sys.stderr)
            return 0


def _round(words: Sequence[str], because: str) -> tuple[int, Watch]:
    """Build in a subprocess, which imports edited rules afresh; return its exit code, and the files it read."""
    watch = Watch()
    # An anonymous file: nothing is left behind if this process is killed.
    with os.fdopen(os.memfd_create("report")) as opened:
        report = f"/dev/fd/{opened.fileno()}"
        command = [sys.executable, "-P", "-m", "dextera_build", "watch", "--once", report, because, *words]
        # In a new session: Ctrl-C reaches it only once, through this process.
        child = subprocess.Popen(command, start_new_session=True, pass_fds=[opened.fileno()])
        try:
            code = child.wait()
        except KeyboardInterrupt as interrupt:
            with suppress(ProcessLookupError):
                child.send_signal(signal.SIGINT)
            child.wait()
            return streams.code_of(interrupt), watch
        text = opened.read()
    if not text:
        raise DxbError(
            f"a build of `dxb watch` ended unexpectedly, with exit code {code}",
            code="DXB-X002",
            facts={"arguments": " ".join(words)},
            hint="build the same targets with `dxb build` to see the error",
        )
    told = json.loads(text)
    watch.files = {path: tuple(sign) if sign else None for path, sign in told["files"].items()}
    watch.folders, watch.paths, watch.started_ns = told["folders"], told["paths"], told["started_ns"]
    return code, watch


def _wait(watch: Watch) -> str:
    """Wait until a file that was read changes, and return the reason to build again."""
    try:
        import watchfiles
    except ImportError:
        raise MachineError(
            "`dxb watch` needs the package `watchfiles`, which is not installed",
            code="DXB-E302",
            hint="`pip install watchfiles`",
        ) from None
    for path, sign in watch.files.items():
        if sign and signature.is_racy(sign, watch.started_ns):
            time.sleep(_RACY_S)
            return f"{shown(path)} was written while it was read"
    rounds = watchfiles.watch(
        *_places(watch),
        watch_filter=None,
        step=_STEP_MS,
        rust_timeout=_LOOK_MS,
        yield_on_timeout=True,
        recursive=False,
        ignore_permission_denied=True,
    )
    looked = False
    for events in rounds:
        # Always check once: changes between the build and the start of the watch gave no event.
        if (events or not looked) and (changed := _changed(watch)) is not None:
            return f"{shown(changed)} changed"
        looked = True
    raise KeyboardInterrupt


def _places(watch: Watch) -> set[Path]:
    """Folders to watch: every change that `_changed` can find causes an event in one of them."""
    return {_nearest(Path(name)) for name in {*map(os.path.dirname, watch.files), *watch.folders, *watch.paths}}


def _changed(watch: Watch) -> str | None:
    """A file or folder that has changed, or None."""
    files = (path for path, known in watch.files.items() if signature.look(path) != known)
    folders = (path for path, known in watch.folders.items() if signature.names(path) != known)
    paths = (path for path, known in watch.paths.items() if signature.modules(path) != known)
    return next(files, None) or next(folders, None) or next(paths, None)


def _once(args: argparse.Namespace, report: str, because: str) -> int:
    """Build, write the files read to `report` as JSON, and print the line of the round."""
    signal.signal(signal.SIGINT, signal.default_int_handler)  # even if the parent ignores it
    began, watch = time.strftime("%H:%M:%S"), Watch()
    lines, code = [], 0
    for recipe, targets in options.by_recipe(args.targets).items():
        start = time.perf_counter()
        error, line = _build(args, recipe, targets, watch)
        lines.append(f"{recipe}  {line}  {duration(time.perf_counter() - start)}")
        code = 2 if isinstance(error, UsageError) else code
    told = {name: getattr(watch, name) for name in ("files", "folders", "paths", "started_ns")}
    Path(report).write_text(json.dumps(told))
    print(f"{began}  {'; '.join(lines)}  ({because})", file=sys.stderr, flush=True)
    return code


def _build(args: argparse.Namespace, recipe: str, targets: Sequence[str], watch: Watch) -> tuple[DxbError | None, str]:
    from dextera_build.building.build import Order, build
    from dextera_build.building.lock import Locking
    from dextera_build.session import Session

    project = None
    try:
        # Opened again for each recipe, because an error leaves a project half loaded.
        project, added = options.project(args), options.added(args)
        session = Session(project, recipe, added, makes=True)
        locking = Locking(project, lock=False, locked=False, added=added)
        order = Order(targets, keep_going=args.keep_going, argv=("watch", *args.words[4:]))
        with console(project.console, sys.stderr, verbose=args.verbose) as listen:
            built = build(session, order, locking, listen, watch)
    except DxbError as error:
        print(render(error, colour=wants_colour(sys.stderr)), file=sys.stderr)
        _note_mends(project, error, watch)
        return error, f"error {error.code}"
    suggest(session, built)
    tell(built, quiet=True)
    return None, states(Counter(node.status for node in built.result.nodes.values()))


def _note_mends(project: Project | None, error: DxbError, watch: Watch) -> None:
    """Watch every file whose edit could fix an error."""
    from dextera_build.code.distributions import note_packages
    from dextera_build.project.project import deciding_files

    for path in deciding_files():
        watch.file(path)
    root = project.root if project else Path.cwd()
    for folder in (root / "recipes", root / "rules"):
        for inner, _, files in os.walk(folder):
            watch.folder(inner)
            for file in files:
                if file.endswith((".yaml", ".py")):
                    watch.file(os.path.join(inner, file))
    for text in (error.facts.get("looked for"), error.facts.get("nearest"), error.where and error.where.file):
        if text:
            watch.folder(_nearest(Path(text).absolute()))
    if isinstance(error, MachineError):
        note_packages(watch)


def _nearest(path: Path) -> Path:
    return next(folder for folder in (path, *path.parents) if folder.is_dir())
