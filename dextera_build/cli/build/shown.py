"""What a verb that builds shows: events on the console while it runs, then what it placed."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from types import TracebackType
from typing import TYPE_CHECKING, Self

from dextera_build.cli.streams import StreamError

if TYPE_CHECKING:
    from dextera_build.build.build import Built
    from dextera_build.cli.consoles import Console
    from dextera_build.runs.events import Event


class Shown:
    """A console that is opened with the first event: most builds have none.

    Args:
        kind: A value of the setting `console`, or `auto`.
        verbose: Show the lines that nodes log, too.
    """

    def __init__(self, kind: str, *, verbose: bool) -> None:
        self._kind, self._verbose = "live" if kind == "auto" else kind, verbose
        self._console: Console | None = None

    def __call__(self, event: Event) -> None:
        """Show one event."""
        if self._console is None:
            from dextera_build.cli.consoles import console

            self._console = console(self._kind, sys.stderr, verbose=self._verbose)
        try:
            self._console(event)
        except OSError as error:
            raise StreamError(str(error)) from error

    def __enter__(self) -> Self:
        """Itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Leave the terminal as it was."""
        if self._console is not None:
            try:
                self._console.close()
            except OSError:
                if error is None:
                    raise


def tell(built: Built, *, quiet: bool = False) -> None:
    """Say what a person has to know of a build beside what its console showed.

    Args:
        built: The build.
        quiet: The console is `none` or `jsonl`, so that what changed in `dxb.lock` is not said.
    """
    if built.lost:
        print(f"the disk is full: {built.lost} events of run {built.run} are not in its log", file=sys.stderr)
    for node, folder in built.placed.kept.items():
        kept = f"the changed ones are in {shown(folder)}"
        print(f"files of `{node}` in out/ were changed: they are written again, and {kept}", file=sys.stderr)
    if built.placed.removed:
        from dextera_build.report.wording import some

        print(f"out of date and removed from out/: {some(built.placed.removed)}", file=sys.stderr)
    if built.notice and not quiet:
        print(built.notice, file=sys.stderr)


def warn() -> None:
    """Print what sessions found that a person has to know, once."""
    from dextera_build.session import warnings

    for text in warnings:
        print(f"warning: {text}", file=sys.stderr)
    warnings.clear()


def lines(paths: Mapping[str, str]) -> str:
    """A line for each target: its address, a tab, the path of its main file."""
    return "".join([f"{node}\t{shown(path)}\n" for node, path in paths.items()])


def shown(path: str) -> str:
    """A path as messages show it: relative where it lies below the current folder."""
    return path.removeprefix(f"{os.getcwd()}/")
