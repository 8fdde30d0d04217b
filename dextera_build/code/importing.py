"""What importing a rule may do to the process that imports it, and what to say of it."""

from __future__ import annotations

import importlib.util
import os
import re
import sys
import threading
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NoReturn

from dextera_build.code.modules import PACKAGE, is_first_party
from dextera_build.code.syntax import too_deep
from dextera_build.errors import DxbError, MachineError, Place, RecipeError

_PATIENCE_S = 5.0


@contextmanager
def watched(path: str, file: Path) -> Iterator[None]:
    """Import a module in the block: it cannot end the process, and one that takes long is named.

    Raises:
        RecipeError: It tried to end the process.
    """
    leave, here = os._exit, os.getpid()

    def ended(status: int) -> NoReturn:
        if os.getpid() != here:  # a fork that ends is its own affair
            leave(status)
        raise SystemExit(status)

    slow = threading.Timer(_PATIENCE_S, _say, (path, file))
    slow.daemon = True
    slow.start()
    os._exit = ended
    try:
        yield
    except SystemExit as error:
        raise RecipeError(
            f"{path} ends the process while it is imported",
            code="DXB-R211",
            where=Place(str(file)),
            facts={"exit code": str(error.code)},
            hint="raise an error in the rule's function instead",
        ) from None
    finally:
        os._exit = leave
        slow.cancel()


def refused(path: str, file: Path, error: Exception) -> DxbError:
    """What to say of an import that failed."""
    if isinstance(error, DxbError):
        return error
    if isinstance(error, SyntaxError):
        where = Place(error.filename or str(file), error.lineno or 0, error.offset or 0)
        return RecipeError(f"{path} is not valid Python: {error.msg}", code="DXB-R206", where=where)
    if isinstance(error, ModuleNotFoundError) and (missing := _missing(path, file, error)) is not None:
        return missing
    if isinstance(error, RecursionError) and "during" in str(error):
        return too_deep(str(file))
    said = str(error) if isinstance(error, ImportError) else f"{type(error).__name__}: {error}"
    said = re.sub(r"\bdxb_rules_[0-9a-f]{12}\b", "rules", said)
    return RecipeError(f"{path} cannot be imported: {said}", code="DXB-R205", where=_last(error, file))


def _missing(path: str, file: Path, error: ModuleNotFoundError) -> DxbError | None:
    package = (error.name or "").partition(".")[0]
    if not package or package.startswith("dxb_rules") or _is_there(package):
        return None
    own = [place for place in _above(file) if (place / package).is_dir() or (place / f"{package}.py").is_file()]
    if own:
        return MachineError(
            f"{path} needs the module `{package}`, which is not on Python's search path",
            code="DXB-E302",
            where=Place(str(file)),
            facts={"found in": str(own[0])},
            hint=f"`pip install -e .` in its project, or `PYTHONPATH={own[0]}`",
        )
    return MachineError(
        f"{path} needs the package `{package}`, which is not installed",
        code="DXB-E302",
        where=Place(str(file)),
        hint=f"install it for {sys.executable}",
    )


def _last(error: Exception, file: Path) -> Place:
    """The last line of first-party code that an exception came through."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if is_first_party(frame.filename) and not frame.filename.startswith(str(PACKAGE))]
    return Place(own[-1].filename, own[-1].lineno or 0) if own else Place(str(file))


def _above(file: Path) -> Iterator[Path]:
    """Where the packages of a project may lie."""
    for folder in file.parents:
        yield from (folder, folder / "src")
        if folder.name == "rules":
            yield from (folder.parent, folder.parent / "src")
            return


def _is_there(package: str) -> bool:
    try:
        return importlib.util.find_spec(package) is not None
    except (ImportError, ValueError):
        return False


def _say(path: str, file: Path) -> None:
    print(f"importing {path} takes long: {_PATIENCE_S:.0f} s so far ({file})", file=sys.stderr, flush=True)
