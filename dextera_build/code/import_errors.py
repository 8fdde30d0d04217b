"""What importing a rule may do to the process that imports it, and what to say of it."""

from __future__ import annotations

import os
import re
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NoReturn

from dextera_build.code.modules import PACKAGE, find_top, is_first_party
from dextera_build.code.syntax import too_deep
from dextera_build.errors import DxbError, MachineError, Place, RecipeError


@contextmanager
def watched(path: str, file: Path) -> Iterator[None]:
    """Import a module in the block: it cannot end the process.

    Raises:
        RecipeError: It tried to end the process.
    """
    leave, here = os._exit, os.getpid()

    def ended(status: int) -> NoReturn:
        if os.getpid() != here:  # a fork that ends is its own affair
            leave(status)
        raise SystemExit(status)

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


def refused(path: str, file: Path, error: Exception) -> DxbError:
    """What to say of an import that failed."""
    if isinstance(error, DxbError):
        return error
    if isinstance(error, SyntaxError):
        where = Place(error.filename or str(file), error.lineno or 0, error.offset or 0)
        return RecipeError(f"{path} is not valid Python: {error.msg}", code="DXB-R206", where=where)
    package = (error.name or "").partition(".")[0] if isinstance(error, ModuleNotFoundError) else ""
    if package and not package.startswith("dxb_rules") and find_top(package) is None:
        return MachineError(
            f"{path} needs the package `{package}`, which is not installed",
            code="DXB-E302",
            where=Place(str(file)),
            facts={"Python": sys.executable},
            hint="install it; code of the project itself needs `pip install -e .`, or its folder on PYTHONPATH",
        )
    if isinstance(error, RecursionError) and "during" in str(error):
        return too_deep(str(file))
    said = str(error) if isinstance(error, ImportError) else f"{type(error).__name__}: {error}"
    said = re.sub(r"\bdxb_rules_[0-9a-f]{12}\b", "rules", said)
    return RecipeError(f"{path} cannot be imported: {said}", code="DXB-R205", where=_last(error, file))


def _last(error: Exception, file: Path) -> Place:
    """The last line of first-party code that an exception came through."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if is_first_party(frame.filename) and not frame.filename.startswith(str(PACKAGE))]
    return Place(own[-1].filename, own[-1].lineno or 0) if own else Place(str(file))
