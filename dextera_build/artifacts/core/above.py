"""Imports by name of the rooms above that the methods of values lead to: file formats and previews.

An import by name is in no code digest, so neither a reader nor a printer is in the keys of all rules that use a type.
Inside a rule's call, whose result may depend on them, they are therefore refused; a rule that reads or writes a format
imports its module. Facts are text for messages, so rules may ask for them.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from dextera_build.errors import RuleError

_in_call = False


def formats(asked: str) -> Any:
    """The registry of file formats.

    Args:
        asked: The method that needs it, for messages: `Mesh.save`.

    Raises:
        RuleError: A rule is being called.
    """
    _refuse_in_call(asked, "formats")
    return importlib.import_module("dextera_build.formats.registry")


def previews(asked: str) -> Any:
    """The registry of previews; arguments and errors as for `formats`."""
    _refuse_in_call(asked, "previews")
    return facts()


def facts() -> Any:
    """The registry of previews, for lines of text."""
    return importlib.import_module("dextera_build.previews.registry")


@contextmanager
def refused() -> Iterator[None]:
    """In the block, which is a rule's call, refuse formats and previews, in all threads."""
    global _in_call
    before, _in_call = _in_call, True
    try:
        yield
    finally:
        _in_call = before


def _refuse_in_call(asked: str, room: str) -> None:
    if _in_call:
        raise RuleError(
            f"a rule called `{asked}`, whose code is not in the rule's key",
            code="DXB-B387",
            hint=f"call the function of a module in `dextera_build.{room}` that the rule imports",
        )
