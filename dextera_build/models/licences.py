"""Licences that forbid a use, and which of them the user has accepted."""

from __future__ import annotations

import json
import os
import time
from contextlib import suppress
from pathlib import Path

from dextera_build.models.model import Model
from dextera_build.store import files

VARIABLE = "DXB_ACCEPT_LICENCES"


class Licences:
    """The accepted licences of one user.

    Args:
        path: The file that records them, existing or not.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def is_open(self, model: Model) -> bool:
        """Whether a model may be used: it forbids nothing, or its current restrictions were accepted."""
        if not model.forbids or model.name in os.environ.get(VARIABLE, "").split(","):
            return True
        return self._accepted().get(model.name, {}).get("terms") == _terms(model)

    def accept(self, model: Model) -> None:
        """Record that the user accepts a model's licence.

        Raises:
            StoreError: The file cannot be written.
        """
        row = {"terms": _terms(model), "accepted": time.strftime("%Y-%m-%d")}
        self.path.parent.mkdir(parents=True, exist_ok=True)
        files.write(str(self.path), json.dumps(self._accepted() | {model.name: row}, indent=1).encode(), 0o600)

    def _accepted(self) -> dict[str, dict[str, str]]:
        with suppress(OSError, ValueError):
            found = json.loads(self.path.read_bytes())
            return found if isinstance(found, dict) else {}
        return {}


def _terms(model: Model) -> str:
    return f"{model.licence}; forbids {model.forbids}"
