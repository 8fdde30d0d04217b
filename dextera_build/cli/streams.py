"""How a command ends before its time: failed writes to standard output and standard error, and interrupts."""

import errno
import os
import sys
from contextlib import suppress

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Callable

INTERRUPTED, TERMINATED = 130, 143
"""Exit codes after Ctrl-C and SIGTERM, as shells report them."""
BROKEN_PIPE = 141
"""Exit code after a broken pipe, as shells report for a program that SIGPIPE ended."""
_CANNOT_WRITE = 1


_faults: dict[str, OSError] = {}
"""Stream -> the error of a failed write."""
_OUTLIVE = ("build", "check")
"""Commands that continue when their output is no longer read."""
_outlives = False
"""Whether this command is one of them."""


class Terminated(KeyboardInterrupt):
    """SIGTERM; a command ends as after Ctrl-C."""


def code_of(interrupt: KeyboardInterrupt) -> int:
    """The exit code of a command that was interrupted."""
    return TERMINATED if isinstance(interrupt, Terminated) else INTERRUPTED


class StreamError(Exception):
    """A stream cannot be written. Not an `OSError`, which the engine would attribute to a worker or to the store."""


def watch() -> None:
    """Record failed writes, and replace closed streams: no file opened later gets their descriptors."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is None:
            os.set_inheritable(os.open(os.devnull, os.O_RDONLY), True)  # read-only, writes fail
            if number:
                stream = open(number, "w", buffering=1, closefd=False, errors="backslashreplace")  # noqa: SIM115
                setattr(sys, name, stream)
        for method in ("write", "flush") if number else ():
            setattr(getattr(sys, name), method, _noting(name, getattr(getattr(sys, name), method)))


def begin(verb: str) -> None:
    """Note the command: that the reader of a build goes away (`| head`) ends its output and not the build."""
    global _outlives
    _outlives = verb in _OUTLIVE


def give_up() -> "int | None":
    """Report a failed write on the other stream and return the exit code; None if no write failed."""
    for name in ("stdout", "stderr"):
        try:
            getattr(sys, name).flush()
        except OSError as error:
            _faults.setdefault(name, error)
    for name, other in (("stdout", "stderr"), ("stderr", "stdout")):
        fault = _faults.get(name)
        # A reader that stops early (`| head`) is not reported.
        if fault is not None and (name, fault.errno) != ("stdout", errno.EPIPE):
            what = "output" if name == "stdout" else "error"
            with suppress(OSError):
                print(
                    f"error: standard {what} cannot be written: {fault.strerror}", file=getattr(sys, other), flush=True
                )
    for name in _faults:  # otherwise Python reports the same error at exit
        _silence(name)
    broken = any(fault.errno == errno.EPIPE for fault in _faults.values())
    return None if not _faults else BROKEN_PIPE if broken else _CANNOT_WRITE


def is_lost() -> bool:
    """Whether a write failed."""
    return bool(_faults)


def _noting(name: str, call: "Callable[..., int | None]") -> "Callable[..., int | None]":
    def noted(*arguments: str) -> "int | None":
        try:
            return call(*arguments)
        except OSError as error:
            if _outlives and error.errno == errno.EPIPE:
                _silence(name)
                return None
            _faults[name] = error
            raise

    return noted


def _silence(name: str) -> None:
    """Discard the output of a stream, including its buffer."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), getattr(sys, name).fileno())
