"""Children that hear Ctrl-C even where the tests themselves run in the background, whose children ignore it."""

from __future__ import annotations

import signal


def hear_interrupts() -> None:
    """For `preexec_fn`: the child starts with the default reaction to SIGINT."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
