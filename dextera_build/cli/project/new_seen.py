"""`dxb new scene` and `dxb new mask`: the objects found in a photograph, as files to edit."""

from __future__ import annotations

import argparse
import os
import shlex
import sys
from pathlib import Path

from dextera_build.cli import options
from dextera_build.cli.table import writing
from dextera_build.errors import UsageError, did_you_mean, listing

KINDS = ("scene", "mask")


def run(args: argparse.Namespace) -> int:
    """Build the stale nodes, write the file, and print its path."""
    if (args.kind == "mask") != bool(args.object):
        raise UsageError(
            "a mask is that of one object" if args.kind == "mask" else "a scene is that of a whole photograph",
            code="DXB-U215",
            hint="`dxb new mask RECIPE OBJECT`, or `dxb new scene RECIPE`",
        )
    out = Path(args.out or ("scene.yaml" if args.kind == "scene" else f"masks/{args.object}.png"))
    _refuse_existing(out)
    _refuse_unwritable(out)
    from dextera_build.building.photographed import Photographed
    from dextera_build.cli.consoles import console

    session, node = options.session(args, args.name, makes=True)
    if node:
        raise UsageError(f"`{args.name}` is a node", code="DXB-U215", hint=f"`dxb new {args.kind} {session.recipe}`")
    seen = Photographed(session)
    with console(session.project.console, sys.stderr, verbose=False) as shown:
        found = seen.find(shown)
    if found is None:
        return 1
    if args.kind == "scene":
        from dextera_build.building import scene_file
        from dextera_build.explain import library

        name = seen.input_of(seen.parse, "scene") or "NAME"
        again = _command(args, name, str(out))
        data = scene_file.text(found, session.recipe, again, library.notes(session)).encode()
    else:
        data = _mask(found.objects.names, found.objects.map.labels, args.object)
        again = _command(args, seen.input_of(seen.objects, "masks") or "NAME", str(out.parent))
    _refuse_existing(out)  # a build takes a while
    with writing(out):
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_bytes(data)
    print(session.project.shown(out.absolute()))
    print(f"  edit it, then: {again}", file=sys.stderr)
    return 0


def _refuse_existing(out: Path) -> None:
    if out.exists():
        raise UsageError(
            f"`{out}` exists already, and nothing of it was changed",
            code="DXB-U191",
            hint="`-o FILE` writes to another file; move or remove this one to have it written again",
        )


def _refuse_unwritable(out: Path) -> None:
    """Refuse a file that cannot be written before the build, which takes a while."""
    folder = next(each for each in out.absolute().parents if each.exists())
    if not (folder.is_dir() and os.access(folder, os.W_OK)):
        what = "may not be written to" if folder.is_dir() else "is no folder"
        raise UsageError(
            f"`{out}` cannot be written: `{folder}` {what}", code="DXB-U177", hint="`-o FILE` writes elsewhere"
        )


def _mask(names: tuple[str, ...], labels: object, wanted: str) -> bytes:
    """PNG of the photograph's size: white is the object."""
    import numpy as np

    from dextera_build.artifacts.cameras.image import png

    if wanted not in names:
        raise UsageError(
            f"no object is called `{wanted}`",
            code="DXB-U216",
            facts={"objects": listing(names, most=30)},
            hint=did_you_mean(wanted, names) or f"`dxb new mask RECIPE {names[0]}`",
        )
    return png(np.where(np.asarray(labels) == names.index(wanted) + 1, np.uint8(255), np.uint8(0)))


def _command(args: argparse.Namespace, name: str, path: str) -> str:
    """The build with the file as an input, as one can paste it."""
    given = any(text.startswith(f"{name}=") for text in args.input)
    added = [] if given else ["--input", f"{name}={path}"]
    return shlex.join(["dxb", "build", args.name, *options.again(args), *added])
