"""What a build shows while it runs. Every console is a listener of the event stream and writes to one stream."""

from __future__ import annotations

import os
from types import TracebackType
from typing import Self, TextIO

from dextera_build.runs.events import Event

_NARROW = 40  # columns below which a foot that moves has no room for a name, a clock and a bar


class Console:
    """A listener that may hold the terminal until it is closed; used as a context manager, which closes it."""

    def __call__(self, event: Event) -> None:
        """Show one event."""
        raise NotImplementedError

    def close(self) -> None:
        """Write what is held back and leave the terminal as it was; may be called twice."""

    def __enter__(self) -> Self:
        """Itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close."""
        self.close()


def console(kind: str, stream: TextIO, *, verbose: bool = False) -> Console:
    """The console called `kind`; `live` becomes `plain` where `stream` cannot show a foot that moves.

    Args:
        kind: A value of the setting `console`.
        stream: Standard error, as a rule; standard output is for results.
        verbose: Show the lines that nodes log, too.
    """
    if kind == "live" and can_move(stream):
        from dextera_build.cli.consoles.live import LiveConsole

        return LiveConsole(stream, verbose=verbose)
    if kind in ("live", "plain"):
        from dextera_build.cli.consoles.plain import PlainConsole

        return PlainConsole(stream, verbose=verbose)
    from dextera_build.cli.consoles.quiet import JsonlConsole, QuietConsole

    return JsonlConsole(stream) if kind == "jsonl" else QuietConsole(stream)


def can_move(stream: TextIO) -> bool:
    """Whether lines at the foot of `stream` can be drawn again: a terminal with room, and nobody asked for none."""
    if not stream.isatty() or os.environ.get("DXB_NO_PROGRESS") or os.environ.get("TERM") == "dumb":
        return False
    try:
        return os.get_terminal_size(stream.fileno()).columns >= _NARROW
    except (OSError, ValueError):
        return False
