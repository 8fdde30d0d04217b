"""Standard output and standard error, and how a command ends that can no longer write to one of them."""

import errno
import os
import sys
from contextlib import suppress

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Callable

BROKEN_PIPE = 141
"""Exit code where the reader went away: what a shell says of a program that SIGPIPE ended."""
_CANNOT_WRITE = 1


_faults: dict[str, OSError] = {}
"""Stream -> what the system said against writing to it."""


class StreamError(Exception):
    """A stream cannot be written. Not an `OSError`: the engine would take that for one of a worker or of the store."""


def watch() -> None:
    """Notice what cannot be written, and fill the place of a closed stream: no file opened later gets its number."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is None:
            os.set_inheritable(os.open(os.devnull, os.O_RDONLY), True)  # which cannot be written
            if number:
                stream = open(number, "w", buffering=1, closefd=False, errors="backslashreplace")  # noqa: SIM115
                setattr(sys, name, stream)
        for method in ("write", "flush") if number else ():
            setattr(getattr(sys, name), method, _noting(name, getattr(getattr(sys, name), method)))


def give_up() -> "int | None":
    """The exit code of a command that can no longer write to a stream, said on the other one; None where it can."""
    for name in ("stdout", "stderr"):
        try:
            getattr(sys, name).flush()
        except OSError as error:
            _faults.setdefault(name, error)
    for name, other in (("stdout", "stderr"), ("stderr", "stdout")):
        fault = _faults.get(name)
        # That the reader of results has enough (`| head`) is no news.
        if fault is not None and (name, fault.errno) != ("stdout", errno.EPIPE):
            what = "output" if name == "stdout" else "error"
            with suppress(OSError):
                print(
                    f"error: standard {what} cannot be written: {fault.strerror}", file=getattr(sys, other), flush=True
                )
    for name in _faults:  # or Python complains of the same when it ends
        os.dup2(os.open(os.devnull, os.O_WRONLY), getattr(sys, name).fileno())
    broken = any(fault.errno == errno.EPIPE for fault in _faults.values())
    return None if not _faults else BROKEN_PIPE if broken else _CANNOT_WRITE


def is_lost() -> bool:
    """Whether something could not be written."""
    return bool(_faults)


def _noting(name: str, call: "Callable[..., int | None]") -> "Callable[..., int | None]":
    def noted(*arguments: str) -> "int | None":
        try:
            return call(*arguments)
        except OSError as error:
            _faults[name] = error
            raise

    return noted
