"""What stops a run at once: any key in its terminal, any key of an input device, as a pedal is one, and signals."""

from __future__ import annotations

import os
import select
import signal
import stat
import struct
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager

EVENT = struct.Struct("llHHi")
"""`struct input_event` of linux/input.h: two numbers of the time, type, code, value."""
EV_KEY, PRESSED = 1, 1
EVIOCGVERSION = 0x80044501
"""Request of linux/input.h that only input devices of events answer."""
LOOK_S = 0.05
"""Time between two looks whether the run has ended [s]."""


@contextmanager
def stops(device: str | None) -> Iterator[threading.Event]:
    """Yield what is set once the operator presses a key: of the terminal, if there is one, or of an input device.

    Signals set it, too, see `signals`.

    Args:
        device: Path of the device, `/dev/input/by-id/...-event-kbd`; None: the terminal alone. If it goes away, that
            is a stop, too.

    Raises:
        MachineError: The device cannot be read, or gives no events of keys.
    """
    pressed, ended = threading.Event(), threading.Event()
    with ExitStack() as held:
        held.enter_context(signals(pressed))
        watched: list[tuple[int, Callable[[bytes], bool]]] = []
        if device is not None:
            watched.append((held.enter_context(_opened(device)), key_pressed))
        if sys.stdin is not None and sys.stdin.isatty():
            watched.append((held.enter_context(_unbuffered()), bool))
        threads = [
            threading.Thread(target=_watch, args=(*each, pressed, ended), name="stop", daemon=True) for each in watched
        ]
        for thread in threads:
            thread.start()
        try:
            yield pressed
        finally:
            ended.set()
            for thread in threads:
                thread.join()


@contextmanager
def signals(ended: threading.Event) -> Iterator[None]:
    """Let Ctrl-C, SIGTERM and the end of the terminal set an event; a second Ctrl-C or SIGTERM interrupts.

    A message that is being written to the recording is written to its end, or else the file could not be read.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    kinds = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = {kind: signal.getsignal(kind) for kind in kinds}

    def heard(number: int, frame: object) -> None:
        ended.set()
        # A terminal that ends says so several times, and the recording is still to be closed.
        signal.signal(number, signal.SIG_IGN if number == signal.SIGHUP else before[signal.Signals(number)])

    for kind, handler in before.items():
        if handler is not signal.SIG_IGN:
            signal.signal(kind, heard)
    try:
        yield
    finally:
        for kind, handler in before.items():
            if signal.getsignal(kind) is heard:
                signal.signal(kind, handler)


def key_pressed(data: bytes) -> bool:
    """Whether a key was pressed in what was read from an input device; whatever is no event counts as a key."""
    if len(data) % EVENT.size:
        return True
    return any(kind == EV_KEY and value == PRESSED for _, _, kind, _, value in EVENT.iter_unpack(data))


def _watch(number: int, tells: Callable[[bytes], bool], pressed: threading.Event, ended: threading.Event) -> None:
    """Read a file until what was read tells of a key, or the file ends."""
    try:
        while not ended.is_set():
            ready, _, _ = select.select([number], [], [], LOOK_S)
            if ready and (not (data := os.read(number, 64 * EVENT.size)) or tells(data)):
                break
    except OSError:  # it was unplugged
        pass
    finally:
        # Whatever ends this thread, nobody would heed the keys any more.
        if not ended.is_set():
            pressed.set()


@contextmanager
def _opened(device: str) -> Iterator[int]:
    from dextera_build.errors import MachineError

    try:
        number = os.open(device, os.O_RDONLY)
    except OSError as error:
        raise MachineError(
            f"the input device `{device}` cannot be read: {error.strerror}",
            code="DXB-E448",
            hint="`ls /dev/input/by-id/*-event-kbd` lists keyboards and pedals; members of group `input` may read them",
        ) from None
    try:
        if not gives_events(number):
            raise MachineError(
                f"`{device}` is no input device whose keys can be read",
                code="DXB-E452",
                hint="`ls /dev/input/by-id/*-event-kbd` lists keyboards and pedals; others are not understood",
            )
        yield number
    finally:
        os.close(number)


def gives_events(number: int) -> bool:
    """Whether an open file is an input device of events, as `/dev/input/event*` are, or a pipe from a program.

    Joysticks, mice and raw devices have reports of another form.
    """
    import fcntl

    if stat.S_ISFIFO(os.fstat(number).st_mode):
        return True
    try:
        fcntl.ioctl(number, EVIOCGVERSION, bytes(4))
    except OSError:
        return False
    return True


@contextmanager
def _unbuffered() -> Iterator[int]:
    """The terminal, which passes on each key at once and does not show it; Ctrl-C stays an interrupt."""
    import termios
    import tty

    number = sys.stdin.fileno()
    before = termios.tcgetattr(number)
    tty.setcbreak(number)
    try:
        yield number
    finally:
        # Further keys that were pressed in haste are no answer to the question of the verdict.
        termios.tcsetattr(number, termios.TCSAFLUSH, before)
