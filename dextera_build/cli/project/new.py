"""`dxb new`: a recipe, a rule or a backend to start from."""

from __future__ import annotations

import argparse
import re
from pathlib import Path

from dextera_build.cli import options
from dextera_build.errors import UsageError
from dextera_build.project.project import Project

_RECIPE = """summary: What this builds, in one line.
inputs:
  capture:
    help: A folder with rgb.png, depth.png and capture.json.
nodes:
  photo: {{rule: capture.folder, folder: $capture}}
targets:
  default: [photo]
"""
_RULE = '''"""{path}: what it does, in one line."""

from __future__ import annotations

from dextera_build.artifacts.image import Image
from dextera_build.rule import Context, Options, rule


class {kind}Options(Options):
    """Options of {path}. Every field enters the key."""

    gain: float = 1.0
    """Factor on the brightness."""


@rule(version=1, packages=("numpy",))
def {name}(ctx: Context, image: Image, *, options: {kind}Options) -> Image:
    """Return `image` with its brightness multiplied by `gain`."""
    bright = (image.pixels * options.gain).clip(0, 255).astype("uint8")
    ctx.preview(bright)
    ctx.say(f"gain {{options.gain:g}}")
    return Image(pixels=bright)
'''
_BACKEND = '''"""Backend `{backend}` of {path}."""

from __future__ import annotations

from dextera_build.rule import Backend

# Read without importing this file: literals only.
BACKEND = Backend(summary="What it does, in one line", profiles=(), packages=())
'''


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    parser.add_argument("kind", choices=("recipe", "rule", "backend"), help="kind of file")
    parser.add_argument("name", help="twin/my_scene, factorize.my_rule, or factorize.my_rule=my_backend")


def run(args: argparse.Namespace) -> int:
    """Write one file and print its path."""
    project = options.project(args)
    path, text = {"recipe": _recipe, "rule": _rule, "backend": _backend}[args.kind](project, args.name)
    if path.exists():
        raise UsageError(f"`{path}` exists already", code="DXB-U191")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    print(project.shown(path))
    return 0


def _recipe(project: Project, name: str) -> tuple[Path, str]:
    _match(name, r"[a-z0-9_]+(/[a-z0-9_]+)+", "twin/my_scene")
    return project.root / "recipes" / f"{name}.yaml", _RECIPE.format()


def _rule(project: Project, path: str) -> tuple[Path, str]:
    _match(path, r"[a-z0-9_]+\.[a-z0-9_]+", "factorize.my_rule")
    stage, _, name = path.partition(".")
    kind = "".join(part.capitalize() for part in name.split("_"))
    return project.root / "rules" / stage / f"{name}.py", _RULE.format(path=path, name=name, kind=kind)


def _backend(project: Project, text: str) -> tuple[Path, str]:
    _match(text, r"[a-z0-9_]+\.[a-z0-9_]+=[a-z0-9_]+", "factorize.my_rule=my_backend")
    path, _, backend = text.partition("=")
    found = project.library.find(path)
    if not found.file.is_relative_to((project.root / "rules").resolve()):
        raise UsageError(
            f"`{path}` is not a rule of this project; a backend is a file next to its rule",
            code="DXB-U193",
            facts={"rule": str(found.file), "rules of the project": str(project.root / "rules")},
            hint=f"`dxb new rule {path.partition('.')[0]}.my_rule` makes a rule of your own",
        )
    return found.file.with_name(f"{found.file.stem}_{backend}.py"), _BACKEND.format(path=path, backend=backend)


def _match(text: str, form: str, example: str) -> None:
    if not re.fullmatch(form, text):
        raise UsageError(f"`{text}` is not a name of this form: `{example}`", code="DXB-U192")
