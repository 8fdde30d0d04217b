"""A project whose backend asks a program, and a look at what the program leaves behind."""

from __future__ import annotations

import os
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dextera_build.artifacts.cameras.image import Image
from dextera_build.outside import guard, servers
from dextera_build.testing import RuleRunner

RULE = '''
"""toy.tint: colour and shape, by a program."""

from __future__ import annotations

from typing import Any, Protocol

from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.artifacts.cameras.image import Image
from dextera_build.rule import Context, rule


class TintBackend(Protocol):
    """What a backend of toy.tint defines."""

    def tint(self, ctx: Context, image: Image, options: Any) -> Image | Mesh:
        """The picture in another colour."""
        ...


@rule(version=1)
def tint(ctx: Context[TintBackend], image: Image) -> Image | Mesh:
    """Return the picture in another colour."""
    return ctx.backend.tint(ctx, image, ctx.backend_options)
'''
BACKEND = '''
"""Backend `program` of toy.tint."""

from __future__ import annotations

from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.artifacts.cameras.image import Image
from dextera_build.rule import Backend, Context, Options

BACKEND = Backend({words})


class ProgramOptions(Options):
    """Options."""

    gain: float = 2.0
    """Factor on the brightness."""
    seed: int = 7
    """Seed."""


def tint(ctx: Context, image: Image, options: ProgramOptions) -> Image | Mesh:
    """The picture in another colour."""
    return ctx.outside("tint", Image | Mesh, image=image, words=["a", {{"b": 1.5}}], none=None)
'''
ECHO = """
import dxb_backend

def tint(request):
    print("looking at", request.inputs["image"].path.name)
    request.say("tinted")
    request.metric("gain", request.options["gain"])
    return request.inputs["image"]

dxb_backend.serve(tint=tint)
"""
"""A program that answers with the picture that it was given."""


class Toy:
    """The project.

    Args:
        root: Its folder.
    """

    def __init__(self, root: Path) -> None:
        self.root = root
        self.folder = root / "rules" / "toy"
        self.folder.mkdir(parents=True)
        (self.folder / "tint.py").write_text(RULE.lstrip())
        self.image = Image(pixels=np.arange(36, dtype=np.uint8).reshape(3, 4, 3))

    def program(self, text: str, **words: Any) -> None:
        """Write the program; `words` are literals of its `BACKEND`."""
        said: dict[str, Any] = {
            "summary": "by a program",
            "profiles": ("cpu", "stub"),
            "command": ("{python}", "tint.program.py"),
            **words,
        }
        listed = ", ".join(f"{name}={value!r}" for name, value in said.items())
        (self.folder / "tint_program.py").write_text(BACKEND.format(words=listed).lstrip())
        (self.folder / "tint.program.py").write_text(text)

    def runner(self) -> RuleRunner:
        """A runner that loads the project anew."""
        scratch = self.root / "scratch"
        scratch.mkdir(exist_ok=True)
        return RuleRunner(scratch, self.root)

    def run(self, text: str = ECHO, **words: Any) -> Any:
        """The answer of the rule with this program."""
        self.program(text, **words)
        return self.runner().run("toy.tint", image=self.image)


@pytest.fixture
def toy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Toy:
    temporary = tmp_path / "tmp"
    temporary.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(temporary))
    monkeypatch.setenv("TOY_MARK", str(tmp_path))
    yield Toy(tmp_path / "project")
    servers.end()
    assert alive(tmp_path) == []
    assert [path.name for path in temporary.iterdir()] == []


def alive(mark: object, wait_s: float = 2.0) -> list[str]:
    """Commands of the processes that programs and guards of a test left behind, after a moment to end."""
    deadline = time.monotonic() + wait_s
    while (found := _marked(mark)) and time.monotonic() < deadline:
        time.sleep(0.02)
    return found


def _marked(mark: object) -> list[str]:
    found = []
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit() and int(folder.name) != os.getpid():
            try:
                words = (folder / "environ").read_bytes().split(b"\0")
                if f"TOY_MARK={mark}".encode() in words:
                    found.append((folder / "cmdline").read_bytes().replace(b"\0", b" ").decode())
            except OSError:
                continue
    return found


__all__ = ["ECHO", "Toy", "alive", "guard"]
