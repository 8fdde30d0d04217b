"""Has pydantic look for its plug-ins without the part of the standard library that reads what is installed.

That part takes a tenth of the time in which a worker comes to be, and where plug-ins are turned off nothing of it is
used: it is loaded with the first look.
"""

from __future__ import annotations

import importlib
import sys
import threading
from contextlib import suppress
from types import ModuleType
from typing import Any

_READS = "importlib.metadata"
_LOOKS = "pydantic.plugin._loader"


def spare() -> None:
    """Load what looks for plug-ins, and nothing that only a look needs; before the first class of pydantic's."""
    # Another thread could import it meanwhile, and must not find what stands in for it.
    if _READS in sys.modules or _LOOKS in sys.modules or threading.active_count() > 1:
        return
    stand_in = sys.modules[_READS] = _StandIn(_READS)
    try:
        with suppress(ImportError):  # of another version of pydantic, which loads what it needs
            importlib.import_module(_LOOKS)
    finally:
        stand_in.leave()


class _StandIn(ModuleType):
    """What is imported of it is loaded when it is called, all else at once."""

    def leave(self) -> None:
        """Let the next import find the true one."""
        if sys.modules.get(_READS) is self:
            del sys.modules[_READS]

    def entry_points(self, **wanted: Any) -> Any:
        """As that of the true one."""
        return self.__getattr__("entry_points")(**wanted)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        self.leave()
        return getattr(importlib.import_module(_READS), name)
