"""One round of `dxb watch`, in a process of its own, so that an edited rule is imported anew.

`python -m dextera_build.cli.build.watch_once REPORT TARGET...` builds like `dxb build` and writes what was read
and how it ended to the file descriptor REPORT, as JSON.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from dextera_build.build import snapshots
from dextera_build.build.build import Order, build
from dextera_build.build.lock import Locking
from dextera_build.cli import options
from dextera_build.cli.build.shown import tell, warn
from dextera_build.cli.consoles import console
from dextera_build.cli.errors import render, wants_colour
from dextera_build.errors import DxbError, MachineError, UsageError
from dextera_build.project.project import LOCK
from dextera_build.report.wording import duration, states
from dextera_build.session import Session
from dextera_build.store.signature import Watch

if TYPE_CHECKING:
    from dextera_build.project.project import Project


def main(words: Sequence[str]) -> int:
    """Build what the words after the report's descriptor say, and return 0, or 130 where Ctrl-C came."""
    from dextera_build.cli.build.watch import arguments

    signal.signal(signal.SIGINT, signal.default_int_handler)  # also where the parent ignores it
    parser = argparse.ArgumentParser()
    arguments(parser)
    args = parser.parse_args(words[1:])
    watch, lines = Watch(), []
    usage = False
    try:
        for recipe, targets in options.by_recipe(args.targets).items():
            began = time.perf_counter()
            error, line = _one(args, recipe, targets, watch)
            lines.append(f"{recipe}  {line}  {duration(time.perf_counter() - began)}")
            usage = usage or isinstance(error, UsageError)
    except KeyboardInterrupt:
        return 130
    report = {
        "lines": lines,
        "usage": usage,
        "files": watch.files,
        "folders": watch.folders,
        "paths": watch.paths,
        "started_ns": watch.started_ns,
    }
    with open(int(words[0]), "w") as opened:
        json.dump(report, opened)
    return 0


def _one(args: argparse.Namespace, recipe: str, targets: Sequence[str], watch: Watch) -> tuple[DxbError | None, str]:
    project = None
    try:
        # Anew for each recipe, because an error leaves things half read.
        project, added = options.project(args), options.added(args)
        session = Session(project, recipe, added, makes=True)
        locking = Locking(project, lock=False, locked=False, added=added)
        order = Order(targets, keep_going=args.keep_going, argv=tuple(sys.argv[1:]))
        with console(project.console, sys.stderr, verbose=args.verbose) as shown:
            built = build(session, order, locking, shown, watch)
    except DxbError as error:
        return _refused(project, error, watch)
    finally:
        warn()
    tell(built, quiet=True)
    return None, states(Counter(node.status for node in built.run_result.nodes.values()))


def _refused(project: Project | None, error: DxbError, watch: Watch) -> tuple[DxbError, str]:
    """Show the error, and watch all that its mend could lie in."""
    print(render(error, colour=wants_colour(sys.stderr)), file=sys.stderr)
    root = project.root if project else Path.cwd()
    for name in ("dxb.toml", "dxb.local.toml", "pyproject.toml", LOCK):
        watch.file(root / name)
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
        snapshots.note_packages(watch)
    return error, f"error {error.code}"


def _nearest(path: Path) -> Path:
    return next(folder for folder in (path, *path.parents) if folder.is_dir())


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
