"""What a run says of its remotes: who was given up, and what was uploaded."""

from __future__ import annotations

import time
from collections.abc import Callable

from dextera_build.engine.remote_results import Remotes
from dextera_build.runs import events
from dextera_build.runs.events import Listener

_TICK_S = 0.5


class Uplink:
    """The remotes of a run, and who listens.

    Args:
        exchange: None where there are no remotes.
        listen: Takes every event.
        pause: Called before time passes.
    """

    def __init__(self, exchange: Remotes, listen: Listener, pause: Callable[[], None]) -> None:
        self.exchange, self.listen, self.pause = exchange, listen, pause

    def tell(self) -> None:
        """Say which remotes were given up since the last call."""
        for notice in self.exchange.notices() if self.exchange else ():
            self.listen(events.RemoteGivenUp(time.time(), notice.remote, notice.address, notice.doing, notice.reason))

    def finish(self) -> None:
        """Wait for uploads, and say how far they are."""
        if self.exchange is None:
            return
        self.pause()
        while left := self.exchange.wait(_TICK_S):
            total = self.exchange.offered
            self.tell()
            self.listen(events.Uploading(time.time(), total - left, total))
            self.pause()

    def close(self) -> None:
        """Let connections go, and say what was uploaded and what was not."""
        if self.exchange is None:
            return
        uploads = self.exchange.close()
        self.tell()
        for upload in uploads:
            left = len(upload.left)
            self.listen(events.Uploaded(time.time(), upload.remote, upload.results, upload.octets, left, upload.reason))
