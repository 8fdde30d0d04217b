"""Limits of the use of a service, shared by all processes that use one store: rate, concurrent requests, rests.

The state of a service is one small file. The system releases its locks when a process dies, so a killed build blocks
nobody.
"""

from __future__ import annotations

import fcntl
import json
import os
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

from dextera_build import digest as digests
from dextera_build.store import files, permissions

_WINDOW_S = 60.0
_LONGEST_S = 3600.0
"""A rest that ends later comes from a clock that was set back [s]."""
_LOOK_S = 0.05
"""Interval at which a process looks for a free slot [s]."""
_TELL_S = 2.0
"""Waits from this length on are logged [s]."""


class Limits:
    """The limits of one service.

    Args:
        folder: Where the states of services are.
        service: Name of the service.
        per_minute: Most requests in any 60 s.
        concurrent: Most slots in use at a time.
        log: Takes a line about a long wait.
    """

    def __init__(
        self, folder: Path, service: str, per_minute: int | None, concurrent: int | None, log: Callable[[str], None]
    ) -> None:
        self._place = folder / digests.of_bytes(service.encode())[:16]
        self._told_until = 0.0
        """End of the pause that the caller was given and keeps by itself."""
        self._service, self._per_minute, self._concurrent, self._log = service, per_minute, concurrent, log

    @contextmanager
    def slot(self) -> Iterator[None]:
        """Use the service, with at most `concurrent` others; waits for a free slot.

        Raises:
            StoreError: The store cannot be written.
        """
        with ExitStack() as stack:
            if self._concurrent is not None:
                stack.callback(os.close, self._free_slot(self._concurrent))
            yield

    def wait_for_turn(self) -> None:
        """Wait until one more request is within the rate, and until the service's pause is over.

        Raises:
            StoreError: The store cannot be written.
        """
        if self._per_minute is None and not self._place.with_suffix(".json").exists():
            return
        told = False
        while (rest := self._take_turn(time.time())) > 0.0:
            if rest > _TELL_S and not told:
                told = True
                self._log(f"{self._service}: waits {rest:.0f} s for its turn")
            time.sleep(min(rest, _WINDOW_S))

    def rest(self, seconds: float) -> None:
        """Send nothing to the service for some time [s], from any process."""
        with self._state() as state:
            self._told_until = state["rest_until"] = max(_number(state.get("rest_until")), time.time() + seconds)

    def _take_turn(self, now: float) -> float:
        """Note a request at `now` and return 0, or return how long to wait before the next look [s]."""
        with self._state() as state:
            # Times in the future come from a clock that was set back.
            sent = [_number(at) for at in state.get("sent", ()) if now - _WINDOW_S < _number(at) <= now]
            until = _number(state.get("rest_until"))
            rest = until - now if until > self._told_until and until - now < _LONGEST_S else 0.0
            if self._per_minute is not None and len(sent) >= self._per_minute:
                rest = max(rest, sent[-self._per_minute] + _WINDOW_S - now)
            if rest <= 0.0:
                sent.append(now)
            state["sent"] = sent if self._per_minute is not None else []
            return max(rest, 0.0)

    def _free_slot(self, slots: int) -> int:
        """The descriptor that holds a slot."""
        began, told = time.monotonic(), False
        while True:
            for number in range(slots):
                descriptor = _opened(self._place.with_suffix(f".{number}"))
                with suppress(BlockingIOError):
                    fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    return descriptor
                os.close(descriptor)
            if time.monotonic() - began > _TELL_S and not told:
                told = True
                self._log(f"{self._service}: waits for one of {slots} slots")
            time.sleep(_LOOK_S)

    @contextmanager
    def _state(self) -> Iterator[dict[str, Any]]:
        with locked_json(self._place.with_suffix(".json")) as state:
            yield state


@contextmanager
def locked_json(path: Path) -> Iterator[dict[str, Any]]:
    """The object in a JSON file, held against other threads and processes, and written back after the block.

    Raises:
        StoreError: The file cannot be written.
    """
    descriptor = _opened(path)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        text = os.pread(descriptor, 1 << 20, 0)
        state: Any = {}
        with suppress(ValueError):  # damaged: an empty state costs little
            state, _ = json.JSONDecoder().raw_decode(text.decode() or "{}")
        state = state if isinstance(state, dict) else {}
        yield state
        data = json.dumps(state).encode()
        try:
            os.pwrite(descriptor, data, 0)
            os.ftruncate(descriptor, len(data))  # afterwards: a kill in between leaves a longer file, which is readable
        except OSError as error:
            raise files.store_error(error, str(path)) from None
    finally:
        os.close(descriptor)


def _opened(path: Path) -> int:
    try:
        if not path.parent.is_dir():
            permissions.make_folder(str(path.parent))
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
        permissions.share_file(descriptor, str(path.parent), 0o644)
    except OSError as error:
        raise files.store_error(error, str(path)) from None
    return descriptor


def _number(value: object) -> float:
    return float(value) if isinstance(value, int | float) else 0.0
