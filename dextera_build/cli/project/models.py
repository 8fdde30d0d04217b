"""`dxb models`: the weights of pretrained models on this machine."""

from __future__ import annotations

import argparse
import shutil
import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

from dextera_build.cli import options, table
from dextera_build.errors import MachineError, UsageError
from dextera_build.models import folders, sources
from dextera_build.models.model import Installed, Model
from dextera_build.project.project import Project
from dextera_build.report import wording

INSTALLED = "installed"
"""State of weights that can be used."""
_ACTIONS = {
    "ls": "list described models: installed versions, licences, and the backends that use them",
    "get": "fetch weights, or complete damaged ones",
    "add": "install weights from a file or folder",
    "verify": "read every file of installed weights and report damage",
    "accept": "accept a licence that forbids a use",
    "rm": "remove installed weights",
}


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    actions = parser.add_subparsers(dest="what", metavar="ACTION", required=True)
    subs = {}
    for name, text in _ACTIONS.items():
        subs[name] = actions.add_parser(name, help=text, description=f"{text[0].upper()}{text[1:]}.")
    subs["add"].add_argument("name", metavar="NAME", help="a model of `dxb models ls`")
    subs["add"].add_argument("path", metavar="FILE", help="the file or folder with its weights; it is copied")
    for name in ("get", "accept", "rm"):
        subs[name].add_argument("names", nargs="+", metavar="NAME", help="models of `dxb models ls`")
    subs["verify"].add_argument("names", nargs="*", metavar="NAME", help="models; default: every installed one")
    for sub in subs.values():
        options.project_arguments(sub)
        options.json_argument(sub)


def run(args: argparse.Namespace) -> int:
    """Run the action."""
    project = options.project(args)
    actions: dict[str, Callable[[Project, argparse.Namespace], int]] = {
        "ls": _list,
        "get": _get,
        "add": _add,
        "verify": _verify,
        "accept": _accept,
        "rm": _remove,
    }
    return actions[args.what](project, args)


def _list(project: Project, args: argparse.Namespace) -> int:
    """Print one line per described model."""
    rows = list(_rows(project))
    cells = [
        {
            "model": row["model"],
            "state": (row["digest"] or "")[:12] if row["state"] == INSTALLED else row["state"],
            "size": wording.size(row["bytes"]) if row["bytes"] else "-",
            "memory": f"{row['memory_gb']:g} GiB" if row["memory_gb"] else "-",
            "licence": row["licence"] + (f" (forbids {row['forbids']})" if row["forbids"] else ""),
            "taken by": ",".join(row["backends"]) or "-",
            "summary": row["summary"],
        }
        for row in rows
    ]
    return table.give("models.ls", rows, as_json=args.json, cells=cells)


def _rows(project: Project) -> Iterator[dict[str, Any]]:
    from dextera_build.recipe import models

    takers: dict[str, list[str]] = {}
    for found in project.library.rules():
        for backend in found.backends.values():
            for name in backend.facts.weights:
                takers.setdefault(name, []).append(f"{found.path}={backend.name}")
    known = project.machine.models
    for name in models.names(project.root):
        model, installed = project.model(name), known.installed(name)
        yield {
            "model": name,
            "state": _state(project, model, installed),
            "digest": installed.digest if installed else model.digest or None,
            "folder": str(installed.folder) if installed else None,
            "bytes": installed.size if installed else None,
            "memory_gb": model.memory_gb or None,
            "licence": model.licence,
            "forbids": model.forbids or None,
            "source": (installed.source if installed else model.source) or None,
            "rows": model.rows or None,
            "backends": takers.get(name, []),
            "summary": model.summary,
        }


def _state(project: Project, model: Model, installed: Installed | None) -> str:
    if installed is None:
        return "missing"
    if folders.incomplete(installed):
        return "incomplete"
    if not project.machine.models.licences.is_open(model):
        return "licence not accepted"
    return INSTALLED


def _get(project: Project, args: argparse.Namespace) -> int:
    """Fetch weights; print one line each: model, digest, folder."""
    return _install(project, args, dict.fromkeys(args.names))


def _add(project: Project, args: argparse.Namespace) -> int:
    """Copy weights from a file or folder."""
    path = Path(args.path)
    if not path.exists():
        raise UsageError(f"`{path}` is not there", code="DXB-U205", hint="give the file or folder with the weights")
    return _install(project, args, {args.name: path})


def _install(project: Project, args: argparse.Namespace, wanted: dict[str, Path | None]) -> int:
    rows = []
    for name, path in wanted.items():
        model, progress = project.model(name), _Progress()
        fill = partial(sources.fetch, model, progress=progress) if path is None else partial(_copied, path)
        installed = project.machine.models.folders.install(name, fill, progress)
        progress.end()
        if model.digest not in ("", installed.digest):
            project.machine.models.folders.remove(installed)
            raise MachineError(
                f"these are not the weights of `{name}`",
                code="DXB-E388",
                where=model.place,
                facts={"digest": installed.digest, "described": model.digest, "source": installed.source},
                hint="another version needs a description of its own: another name, or another `digest`",
            )
        if not project.machine.models.licences.is_open(model):
            print(f"{name}: its licence ({model.licence}) forbids {model.forbids}; ", end="", file=sys.stderr)
            print(f"`dxb models accept {name}` before the first build", file=sys.stderr)
        rows.append({"model": name, "digest": installed.digest, "folder": str(installed.folder)})
    return table.give(f"models.{args.what}", rows, as_json=args.json, cells=list(map(_short, rows)))


def _short(row: dict[str, Any]) -> dict[str, Any]:
    """A row whose digest has twelve digits."""
    return row | {"digest": row["digest"][:12]}


def _copied(path: Path, folder: Path) -> str:
    if path.is_dir():
        shutil.copytree(path, folder, dirs_exist_ok=True)
    else:
        shutil.copy2(path, folder / path.name)
    return f"file:{path.name}"


def _verify(project: Project, args: argparse.Namespace) -> int:
    """Print one line per model: model, digest, `whole` or its damaged files; return 4 if any is damaged."""
    rows = []
    for installed in project.machine.models.folders.all():
        if args.names and installed.name not in args.names:
            continue
        progress = _Progress()
        found = folders.damaged(installed, progress)
        progress.end()
        rows.append({"model": installed.name, "digest": installed.digest, "damaged": list(found)})
    cells = [_short(row) | {"damaged": ", ".join(row["damaged"]) or "-"} for row in rows]
    table.give("models.verify", rows, as_json=args.json, cells=cells)
    return 4 if any(row["damaged"] for row in rows) else 0


def _accept(project: Project, args: argparse.Namespace) -> int:
    """Record that the user accepts licences."""
    rows = []
    for name in args.names:
        model = project.model(name)
        project.machine.models.licences.accept(model)
        rows.append({"model": name, "licence": model.licence, "forbids": model.forbids or None})
    return table.give("models.accept", rows, as_json=args.json)


def _remove(project: Project, args: argparse.Namespace) -> int:
    """Remove every version of models from the first folder."""
    known = project.machine.models.folders
    rows = []
    for name in args.names:
        project.model(name)
        for _, installed in list(known.versions(known.folders[0], name)):
            known.remove(installed)
            rows.append({"model": name, "digest": installed.digest, "bytes": installed.size})
    return table.give("models.rm", rows, as_json=args.json, cells=list(map(_short, rows)))


class _Progress:
    """A line on the terminal that counts bytes; nothing where standard error is a file."""

    def __init__(self) -> None:
        self._live = sys.stderr.isatty()

    def __call__(self, path: str, done: int, total: int) -> None:
        """Show how far a file has come."""
        if self._live:
            of = f" of {wording.size(total)}" if total else ""
            print(f"\r\x1b[K{path}  {wording.size(done)}{of}", end="", file=sys.stderr, flush=True)

    def end(self) -> None:
        """Clear the line."""
        if self._live:
            print("\r\x1b[K", end="", file=sys.stderr, flush=True)
