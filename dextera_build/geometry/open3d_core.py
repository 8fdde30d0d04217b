"""Open3D without its viewers, which load dash, plotly and IPython in half of the time of its import.

`open3d.visualization` is loaded when somebody asks for it.
"""

from __future__ import annotations

import importlib
import sys
from types import ModuleType
from typing import Any

_VIEWERS = "open3d.visualization"


def loaded() -> Any:
    """The module `open3d`.

    Raises:
        ImportError: It is not installed.
    """
    if "open3d" in sys.modules:
        return importlib.import_module("open3d")
    sys.modules[_VIEWERS] = ModuleType(_VIEWERS)
    try:
        library = importlib.import_module("open3d")
    finally:
        del sys.modules[_VIEWERS]
    library.__getattr__ = _asked  # type: ignore[method-assign]
    return library


def _asked(name: str) -> ModuleType:
    if name != _VIEWERS.rpartition(".")[2]:
        raise AttributeError(f"module 'open3d' has no attribute {name!r}")
    return importlib.import_module(_VIEWERS)
