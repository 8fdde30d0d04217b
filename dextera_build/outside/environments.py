"""Where a program runs: dxb's own interpreter, a virtual environment, a conda environment, or a container."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Protocol

PYTHON = "{python}"
"""Placeholder in a command: the path of the interpreter of its environment."""


@dataclass(frozen=True)
class Start:
    """Settings of a container in addition to the command; the other environments see all files and devices."""

    command: tuple[str, ...]
    here: Path
    """The folder it starts in."""
    root: Path
    """The folder of its exchanges, writable."""
    side: Path
    """The folder with the program's side of the protocol, for Python's search path."""
    folders: tuple[Path, ...] = ()
    """Further folders that it reads."""
    gpu: bool = False
    memory_gb: float = 0.0


class ProgramEnvironment(Protocol):
    """One place for programs."""

    locked: bool
    """Whether its content is stated by a lock file."""

    def lacking(self, lock: str) -> dict[str, str]:
        """Requirements that this machine lacks -> the next step; `lock` is the lock file, if there is one."""
        ...

    def freeze(self) -> str:
        """The command that prints its content."""
        ...

    def argv(self, start: Start) -> list[str]:
        """The command to execute."""
        ...

    def last(self, root: Path) -> list[str]:
        """A command that ends processes that are not children, or nothing."""
        ...


class Own:
    """The interpreter that runs dxb."""

    locked = False

    def lacking(self, lock: str) -> dict[str, str]:
        """Nothing."""
        return {}

    def freeze(self) -> str:
        """`pip freeze` of dxb's interpreter."""
        return f"{sys.executable} -m pip freeze"

    def argv(self, start: Start) -> list[str]:
        """The command with dxb's interpreter."""
        return _with(start.command, sys.executable)

    def last(self, root: Path) -> list[str]:
        """Nothing."""
        return []


@dataclass(frozen=True)
class Venv:
    """A virtual environment.

    Args:
        folder: Its folder, as the backend names it.
        base: The folder that relative names begin at.
    """

    folder: str
    base: Path
    locked = True

    @property
    def python(self) -> Path:
        """Its interpreter; a link on purpose, because Python finds the environment by its place."""
        return self.base / Path(self.folder).expanduser() / "bin" / "python"

    def lacking(self, lock: str) -> dict[str, str]:
        """Its interpreter."""
        if self.python.is_file():
            return {}
        step = f"`python -m venv {self.folder} && {self.folder}/bin/pip install -r {lock}`"
        if not lock:
            step = f"`python -m venv {self.folder}`, install the program's packages with `{self.folder}/bin/pip`"
        return {f"the virtual environment `{self.folder}`": step}

    def freeze(self) -> str:
        """`pip freeze` of its interpreter."""
        return f"{self.folder}/bin/pip freeze --all"

    def argv(self, start: Start) -> list[str]:
        """The command with the environment's interpreter."""
        return _with(start.command, str(self.python))

    def last(self, root: Path) -> list[str]:
        """Nothing."""
        return []


@dataclass(frozen=True)
class Conda:
    """A conda environment, by name or folder; entered by `micromamba run`, `mamba run` or `conda run`."""

    name: str
    locked = True

    def lacking(self, lock: str) -> dict[str, str]:
        """The program that enters it, and the environment."""
        tool = _conda()
        if tool is None:
            return {"conda or micromamba": "install micromamba, and put it on PATH"}
        if any(folder.is_dir() for folder in self._places()):
            return {}
        step = f"`{Path(tool).name} create {self._option} {self.name}{f' --file {lock}' if lock else ' python'}`"
        return {f"the conda environment `{self.name}`": step}

    @property
    def _option(self) -> str:
        return "-p" if "/" in self.name else "-n"

    def freeze(self) -> str:
        """`conda list` of it."""
        return f"{Path(_conda() or 'conda').name} list {self._option} {self.name} --explicit"

    def argv(self, start: Start) -> list[str]:
        """`conda run` of the command."""
        tool = _conda() or "conda"
        live = ["--no-capture-output"] if Path(tool).name != "micromamba" else []
        where = [self._option, os.path.expanduser(self.name)]
        return [tool, "run", *where, *live, *_with(start.command, "python")]

    def last(self, root: Path) -> list[str]:
        """Nothing."""
        return []

    def _places(self) -> Iterator[Path]:
        """Folders in which it may lie; asking conda itself takes a second."""
        if "/" in self.name:
            yield Path(self.name).expanduser()
            return
        roots = [Path(tool).resolve().parents[1] for tool in (os.environ.get("CONDA_EXE"), _conda()) if tool]
        roots += [Path(os.environ["MAMBA_ROOT_PREFIX"])] if os.environ.get("MAMBA_ROOT_PREFIX") else []
        roots += [Path.home() / name for name in (".conda", "micromamba", ".local/share/mamba", "miniconda3")]
        yield from (root / "envs" / self.name for root in roots)
        yield from (Path(folder) / self.name for folder in os.environ.get("CONDA_ENVS_PATH", "").split(":") if folder)


@dataclass(frozen=True)
class Container:
    """An image of docker or podman, named with its digest; it has no network.

    Args:
        tool: `docker` or `podman`.
        image: `NAME@sha256:...`.
    """

    tool: str
    image: str
    locked = False  # the digest identifies it

    def lacking(self, lock: str) -> dict[str, str]:
        """The tool and the image."""
        if shutil.which(self.tool) is None:
            return {self.tool: f"install {self.tool}"}
        if not _has_image(self.tool, self.image):
            return {f"the image `{self.image}`": f"`{self.tool} pull {self.image}`"}
        return {}

    def freeze(self) -> str:
        """`pip freeze` inside."""
        return f"{self.tool} run --rm {self.image} pip freeze"

    def argv(self, start: Start) -> list[str]:
        """`docker run` of the command: the exchange writable, the rest read-only, nothing else of the machine."""
        words = [self.tool, "run", "--rm", "-i", "--init", "--network", "none", "--name", self._name(start.root)]
        words += ["--user", f"{os.getuid()}:{os.getgid()}", "--workdir", str(start.here)]
        for variable in (f"TMPDIR={start.root}/tmp", f"PYTHONPATH={start.side}", "PYTHONUNBUFFERED=1"):
            words += ["--env", variable]
        words += ["--memory", f"{start.memory_gb:g}g"] if start.memory_gb else []
        if start.gpu:
            names = os.environ.get("CUDA_VISIBLE_DEVICES") or "all"
            device = f"nvidia.com/gpu={names.partition(',')[0]}"
            words += ["--device", device] if self.tool == "podman" else ["--gpus", f"device={names}"]
        words += ["--volume", f"{start.root}:{start.root}"]
        for folder in dict.fromkeys((start.here, start.side, *start.folders)):
            words += ["--volume", f"{folder}:{folder}:ro"]
        return [*words, self.image, *_with(start.command, "python")]

    def last(self, root: Path) -> list[str]:
        """Removal of the container, whose processes belong to a service of the system."""
        return [self.tool, "rm", "--force", self._name(root)]

    def _name(self, root: Path) -> str:
        return root.name.replace("_", "-")


def named(text: str, base: Path) -> ProgramEnvironment:
    """The environment that a backend names: ``, `venv:FOLDER`, `conda:NAME`, `docker:IMAGE` or `podman:IMAGE`.

    Args:
        text: The name.
        base: The folder that relative folders begin at.

    Raises:
        ValueError: It names none; the message has the reason.
    """
    scheme, _, rest = text.partition(":")
    if not text:
        return Own()
    if scheme == "venv" and rest:
        return Venv(rest, base)
    if scheme == "conda" and rest:
        return Conda(rest)
    if scheme in ("docker", "podman") and rest:
        if "@sha256:" not in rest:
            raise ValueError("an image is named with its digest, `NAME@sha256:...`, because tags move")
        return Container(scheme, rest)
    raise ValueError(f"`{text}` is none of `venv:FOLDER`, `conda:NAME`, `docker:IMAGE`, `podman:IMAGE`")


def _with(command: Sequence[str], python: str) -> list[str]:
    return [word.replace(PYTHON, python) for word in command]


def _conda() -> str | None:
    """The program that enters conda environments."""
    found = [shutil.which(name) for name in ("micromamba", "mamba", "conda")]
    return next((path for path in (*found, os.environ.get("CONDA_EXE")) if path), None)


@cache
def _has_image(tool: str, image: str) -> bool:
    try:
        asked = subprocess.run([tool, "image", "inspect", image], capture_output=True, timeout=20, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return False
    return asked.returncode == 0
