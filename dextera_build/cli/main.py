"""`dxb`: reads the command line, runs one verb, prints errors, and returns the exit code.

Exit codes: 0 done, 1 a node failed, 2 command line or recipe wrong, 3 stale under `--check` or
not as locked under `--locked`, 4 the machine lacks something, 70 an internal error, 130 interrupted,
141 broken pipe, 143 terminated.
"""

import gc
import os
import sys

from dextera_build.cli import streams
from dextera_build.runs import snapshot

# A no-op build ends before the rest of dxb is needed, so all other imports are local.
TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import NoReturn

    from dextera_build.errors import DxbError

_YOUNG = 200_000
"""Number of new objects that triggers Python's garbage collector."""
_owns_process = False
"""Whether this process is a command, rather than a program that runs one."""


def main(argv: "Sequence[str] | None" = None) -> int:
    """Run one command and return its exit code.

    Args:
        argv: The command line; None: that of this process.
    """
    words = list(sys.argv[1:] if argv is None else argv)
    streams.begin(words[0] if words else "")
    if "_ARGCOMPLETE" in os.environ:
        from dextera_build.cli.project import complete

        return complete.answer()
    try:
        code = _guarded(words)
        sys.stdout.flush()
        sys.stderr.flush()
        return code
    except Exception:
        code_of_stream = streams.give_up()
        if code_of_stream is None:
            raise
        return code_of_stream


def entry() -> "NoReturn":
    """The console script."""
    global _owns_process
    _owns_process = True
    streams.watch()
    code = main()
    # Python searches all objects for cycles as it exits; after a build of 1,000 nodes that would take 70 ms.
    gc.freeze()
    sys.exit(code)


def _guarded(words: "list[str]") -> int:
    """Run one command and print its error, if any; only failed writes to a stream are left to the caller."""
    try:
        return 0 if snapshot.answer(words) else _run(words)
    except KeyboardInterrupt as interrupt:
        return _interrupted(interrupt)
    except Exception as error:  # the last resort: a traceback is never shown unexplained
        from dextera_build.errors import DxbError, interrupt_of

        if (wrapped := interrupt_of(error)) is not None:
            return _interrupted(wrapped)
        if streams.is_lost():
            raise
        return _refuse(error) if isinstance(error, DxbError) else _fault(error, words)


def _interrupted(interrupt: KeyboardInterrupt) -> int:
    print("interrupted; finished results are kept, and the next build continues from there", file=sys.stderr)
    return streams.code_of(interrupt)


def _terminate(number: int, frame: object) -> "NoReturn":
    raise streams.Terminated


def _run(words: list[str]) -> int:
    import importlib
    import signal

    if _owns_process:
        signal.signal(signal.SIGTERM, _terminate)

    # A command keeps most of its objects; a search for cycles every 700 objects takes a tenth of a small build.
    gc.set_threshold(_YOUNG)
    from dextera_build.cli.grammar import parse
    from dextera_build.cli.verbs import MODULES

    for word in words:
        if "@" in word or "?" in word:
            from dextera_build.redact import hide_address

            hide_address(word)  # an address that is parsed as a path is spelled in other ways later
    args = parse(words or ["--help"])
    args.words = words
    # The search for pydantic plug-ins reads the metadata of every installed package, and nothing here uses one.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    try:
        code: int = importlib.import_module(MODULES[args.verb]).run(args)
    finally:
        if "dextera_build.session" in sys.modules:
            from dextera_build.cli.build.shown import warn

            warn()
    return code


def _refuse(error: "DxbError") -> int:
    from dextera_build.cli.errors import render, wants_colour

    print(render(error, colour=wants_colour(sys.stderr)), file=sys.stderr)
    return error.exit_code


def _fault(error: Exception, words: list[str]) -> int:
    import traceback

    from dextera_build import __version__
    from dextera_build.errors import DxbError
    from dextera_build.redact import redact

    text = redact(f"dxb {__version__} {' '.join(words)}\n\n{traceback.format_exc()}")
    folder = os.path.expanduser(os.environ.get("XDG_CACHE_HOME", "~/.cache")) + "/dxb"
    file = f"{folder}/fault.txt"
    try:
        os.makedirs(folder, exist_ok=True)
        with open(file, "w") as opened:  # only the last fault is kept
            opened.write(text)
    except OSError:
        file = "below"
        sys.stderr.write(text)
    fault = DxbError(
        f"internal error: {type(error).__name__}: {error}",
        code="DXB-X001",
        facts={"traceback": file},
        hint="please report it, with the file of the traceback",
    )
    return _refuse(fault)
