"""The projects that ever built with a store; what they built last stays when it is collected."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from dextera_build import digest as digests
from dextera_build.errors import StoreError
from dextera_build.store import failpoints, files


class Workspaces:
    """One small file per project folder, which holds its path.

    Args:
        folder: Where they lie.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def note(self, project: str) -> None:
        """Register a project folder, unless it is known."""
        path = self._folder / digests.of_bytes(project.encode())[:32]
        if not path.exists():
            failpoints.reach("workspace.note")
            with suppress(StoreError):
                files.write(str(path), project.encode(), 0o644)

    def all(self) -> dict[str, bool]:
        """Every registered project folder, and whether it is still there."""
        found = {}
        for path in sorted(self._folder.iterdir()) if self._folder.is_dir() else ():
            if not path.name.startswith(files.TEMPORARY):
                with suppress(OSError, UnicodeDecodeError):
                    project = path.read_text()
                    found[project] = Path(project).is_dir()
        return found
