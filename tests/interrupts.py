"""Children that hear Ctrl-C even where the tests themselves run in the background, whose children ignore it."""

from __future__ import annotations

import signal
from collections.abc import Callable


def hear_interrupts() -> Callable[[], None] | None:
    """For `preexec_fn`: the child starts with the default reaction to SIGINT.

    None where it does so anyway: a function there makes Python copy all of its memory for the child.
    """
    return _hear if signal.getsignal(signal.SIGINT) is signal.SIG_IGN else None


def _hear() -> None:
    signal.signal(signal.SIGINT, signal.SIG_DFL)
