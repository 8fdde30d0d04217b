"""Finds the files of a primitive by its name: `primitive.py` and `script.py` of `primitives/lift/`.

Imports by name are in no code digest. So while a build runs a call, only the files that its key holds are found; see
`@rule(runs={"bundle": "primitive"})`.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

from dextera_build.errors import RuleError, did_you_mean, listing

Find = Callable[[str, str], ModuleType]
"""Takes a primitive and the name of a file without suffix."""


def own(name: str, file: str) -> ModuleType:
    """A file of a primitive that comes with dxb.

    Raises:
        RuleError: There is none.
    """
    folder = Path(__file__).parent
    known = sorted(each.parent.name for each in folder.glob(f"*/{file}.py"))
    if name not in known:
        raise RuleError(
            f"no primitive of dxb is called `{name}`",
            code="DXB-B254",
            facts={"primitives": listing(known, most=40)},
            hint=did_you_mean(name, known) or "open the task in the project that has the primitive",
        )
    return importlib.import_module(f"{__package__}.{name}.{file}")


_find: Find = own


def module(name: str, file: str) -> ModuleType:
    """A file of a primitive.

    Raises:
        RuleError: There is none, or it is not in the key of the call that runs.
    """
    return _find(name, file)


@contextmanager
def only(find: Find) -> Iterator[None]:
    """In the block, find the files of primitives by another function, in all threads."""
    global _find
    before, _find = _find, find
    try:
        yield
    finally:
        _find = before
