"""The models that backends can use: their descriptions, installed and missing versions."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path

from dextera_build.errors import MachineError
from dextera_build.models.folders import ModelFolders, incomplete
from dextera_build.models.licences import Licences
from dextera_build.models.model import Installed, Model

_UNKNOWN = "not installed"
"""In place of a digest, in the key of a node that cannot run here."""


class Models:
    """Described and installed models of a project.

    Args:
        describe: Returns the description of a name, or raises a `RecipeError`.
        folders: Where they lie.
        licences: Accepted licences of the user.
    """

    def __init__(self, describe: Callable[[str], Model], folders: ModelFolders, licences: Licences) -> None:
        self.describe = describe
        self.folders = folders
        self.licences = licences
        self._asked: set[str] = set()

    def lacking(self, names: Iterable[str]) -> dict[str, str]:
        """Obstacles to the use of models on this machine -> the next step.

        Raises:
            RecipeError: A model is not described.
        """
        found: dict[str, str] = {}
        for name in names:
            model, installed = self.describe(name), self.installed(name)
            if not self.licences.is_open(model):
                found[f"the licence of `{name}`, which forbids {model.forbids}"] = f"`dxb models accept {name}`"
            if installed is None:
                found[f"the weights `{name}`"] = f"`dxb models get {name}`"
            elif gone := incomplete(installed):
                found[f"{gone[0]} of the weights `{name}`"] = f"`dxb models get {name}`"
        return found

    def installed(self, name: str) -> Installed | None:
        """The installed version that a description admits."""
        self._asked.add(name)
        return self.folders.find(name, self.describe(name).digest)

    def pinned(self, names: Iterable[str]) -> tuple[str, ...]:
        """`name@digest` of each model, for keys."""
        return tuple(f"{name}@{self._digest(name)}" for name in names)

    def looked_at(self) -> set[str]:
        """Files and folders that decided which weights are installed, and whether they may be used."""
        if not self._asked:
            return set()
        return {str(self.licences.path), *(path for name in self._asked for path in self.folders.looked_at(name))}

    def _digest(self, name: str) -> str:
        installed = self.installed(name)
        return installed.digest if installed is not None else self.describe(name).digest or _UNKNOWN


def folder_of(folders: Iterable[Path], pinned: str) -> Path:
    """The folder with the weights of `name@digest`.

    Raises:
        MachineError: This machine does not have them, though the one that planned the build does.
    """
    name, _, digest = pinned.partition("@")
    with suppress(OSError):
        installed = ModelFolders(tuple(folders)).find(name, digest)
        if installed is not None and not incomplete(installed):
            return installed.folder
    raise MachineError(
        f"the weights `{name}` are not on this machine",
        code="DXB-E387",
        facts={"digest": digest[:12], "folders": ", ".join(map(str, folders))},
        hint="a folder that all machines of a cluster share, in `models` of `dxb.toml`, spares copies",
    )
