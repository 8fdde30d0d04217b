"""A program as a backend declares it: its command, its files, its environment, its limits."""

from __future__ import annotations

import os
import posixpath
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path, PurePosixPath

from dextera_build import digest
from dextera_build.errors import MachineError, Place, RecipeError, RuleError, listing
from dextera_build.outside.environments import ProgramEnvironment, Start, named
from dextera_build.outside.imports import imported
from dextera_build.outside.program_side import dxb_backend
from dextera_build.outside.running import Limits, Running

SIDE = Path(dxb_backend.__file__)
"""The program's side of the protocol; its folder is on the search path of every program."""


@dataclass(frozen=True)
class Program:
    """The program of a backend.

    Args:
        backend: `trellis of factorize.mesh`, for messages.
        file: The backend's file; the program starts in its folder.
        base: The project, or the folder that holds `rules/`; environments and the lock file are named from here.
        command: Words of the command; `{python}` is the interpreter of the environment.
        files: Patterns of further files of the program, from the folder of the backend's file.
        environment: See `environments.named`.
        lock: File that lists the content of the environment, from `base`.
        server: Whether it stays for further calls.
        limits: Its limits.
    """

    backend: str
    file: Path
    base: Path
    command: tuple[str, ...]
    files: tuple[str, ...]
    environment: str
    lock: str
    server: bool
    limits: Limits

    @property
    def here(self) -> Path:
        """The folder it starts in."""
        return self.file.parent

    @cached_property
    def place(self) -> ProgramEnvironment:
        """Where it runs.

        Raises:
            RecipeError: The backend names no environment.
        """
        try:
            return named(self.environment, self.base)
        except ValueError as error:
            raise self._wrong(str(error), "`environment`") from None

    def lacking(self) -> dict[str, str]:
        """Requirements that this machine lacks -> the next step.

        Raises:
            RecipeError: The declaration is wrong.
        """
        has_lock = bool(self.lock) and (self.base / self.lock).is_file()
        found = dict(self.place.lacking(self.lock if has_lock else ""))
        if self.place.locked and not self.lock:
            raise self._wrong("an environment is named without its lock file", "`lock`")
        if self.lock and not has_lock:
            found[f"the lock file `{self.lock}`"] = f"list the content of the environment: `{self._freeze()}`"
        for pattern in self._patterns:
            if not self._matches(pattern):
                found[f"the file `{pattern}` of the program"] = f"put it into `{self.here}`"
        return found

    def _freeze(self) -> str:
        """The command that writes the lock file, from the project's folder."""
        folder = posixpath.dirname(self.lock)
        return (f"mkdir -p {folder} && " if folder else "") + f"{self.place.freeze()} > {self.lock}"

    def parts(self) -> dict[str, Path]:
        """Name -> each file that makes up the program, and the lock file; their contents enter the key.

        Modules in the program's folder that it imports are among them, whether declared or not.
        """
        found = {SIDE} | self._imported()[0] | {path for pattern in self._patterns for path in self._matches(pattern)}
        if self.lock and (self.base / self.lock).is_file():
            found.add(self.base / self.lock)
        return {_name(path, self.base, self.here): path for path in sorted(found)}

    def digests(self) -> dict[str, str]:
        """Name -> SHA-256 of each of `parts`."""
        return {name: digest.of_bytes(path.read_bytes()) for name, path in self.parts().items()}

    def looked_at(self) -> set[str]:
        """Files and folders, including missing ones, on which the key and missing requirements depend."""
        found = {str(path) for path in self.parts().values()}
        found |= set(map(str, self._imported()[1]))
        found |= {str(self.here / pattern) for pattern in self._patterns if not set(pattern) & set("*?[")}
        found |= {str(folder) for pattern in self._patterns for folder in self._folders(pattern)}
        found |= {str(self.base / self.lock)} if self.lock else set()
        python = getattr(self.place, "python", None)
        return found | ({str(python)} if python else set())

    def check(self, key: Mapping[str, str]) -> None:
        """Refuse files that are not those of the key.

        Raises:
            MachineError: Something is missing here; on a cluster, another machine may have it.
            RuleError: A file has other content than in the key.
        """
        if lacks := self.lacking():
            raise MachineError(
                f"backend `{self.backend}` needs {listing(lacks)}, which is missing on this machine",
                code="DXB-E392",
                hint=", ".join(dict.fromkeys(lacks.values())),
            )
        now = self.digests()
        other = [name for name in {**key, **now} if key.get(name) != now.get(name)]
        if other:
            raise RuleError(
                "a program differs from that in this node's key: it was edited while the build ran",
                code="DXB-B379",
                facts={"files": listing(other)},
                hint="build again; on a cluster, install the same version on every machine",
            )

    def run(self, environment: Mapping[str, str], folders: tuple[Path, ...], *, gpu: bool) -> Running:
        """Start its guard; the program starts with the first request.

        Args:
            environment: Variables in addition to those of this process.
            folders: Folders that it reads, for a container.
            gpu: Whether it may use the GPU of the call.
        """

        def argv(root: Path) -> list[str]:
            start = Start(self.command, self.here, root, SIDE.parent, folders, gpu, self.limits.memory_gb)
            return self.place.argv(start)

        variables = {"PYTHONPATH": str(SIDE.parent), **environment}
        return Running(argv, self.here, self.limits, variables, last=self.place.last, server=self.server)

    @cached_property
    def _patterns(self) -> tuple[str, ...]:
        """Patterns of its files: those it declares, and words of its command that name one."""
        for pattern in self.files:
            if PurePosixPath(pattern).is_absolute() or ".." in PurePosixPath(pattern).parts:
                raise self._wrong(f"`{pattern}` leads out of the folder of the backend", "`files`")
        words = (word for word in self.command[1:] if word.endswith(".py") or (self.here / word).is_file())
        return tuple(dict.fromkeys((*(word for word in words if not Path(word).is_absolute()), *self.files)))

    def _imported(self) -> tuple[set[Path], set[Path]]:
        """See `imports.imported`: Python searches the folder of the script, or the one it starts in with `-m`."""
        scripts = [path for word in self.command[1:] if (path := self.here / word).suffix == ".py" and path.is_file()]
        folders = [script.parent for script in scripts] or [self.here]
        files = [path for pattern in self._patterns for path in self._matches(pattern)]
        names = [name for before, name in pairwise(self.command) if before == "-m"]
        return imported([*scripts, *files], list(dict.fromkeys(folders)), names)

    def _matches(self, pattern: str) -> list[Path]:
        found = [path for path in self.here.glob(pattern) if path.is_file()]
        return [path for path in found if "__pycache__" not in path.parts]

    def _folders(self, pattern: str) -> list[Path]:
        """Folders in which a new file may match."""
        if not set(pattern) & set("*?["):
            return []
        fixed = self.here
        for part in PurePosixPath(pattern).parts[:-1]:
            if set(part) & set("*?["):
                break
            fixed /= part
        inner = [path for path in fixed.rglob("*") if path.is_dir() and path.name != "__pycache__"]
        return [fixed, *(inner if "**" in pattern or "/" in pattern else [])]

    def _wrong(self, why: str, what: str) -> RecipeError:
        return RecipeError(
            f"backend `{self.backend}`: {why}",
            code="DXB-R260",
            where=Place(str(self.file)),
            hint=f"correct {what} in `BACKEND`; docs/outside.md describes it",
        )


def _name(path: Path, base: Path, here: Path) -> str:
    """A file's name in keys, equal on every machine: below the project, or from an installed program's folder."""
    if path == SIDE:
        return path.name
    try:
        return path.relative_to(base).as_posix()
    except ValueError:
        return Path(os.path.relpath(path, here)).as_posix()
