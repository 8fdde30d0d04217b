"""`dxb doctor`: checks of this machine for the needs of builds, with a fix for each problem."""

from __future__ import annotations

import argparse
import ctypes.util
import importlib.metadata
import importlib.util
import os
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from dextera_build.cli import options, table
from dextera_build.code.loader import BackendFile, RuleFile
from dextera_build.errors import Place, extras_of_dxb, install_extra, smallest_extra
from dextera_build.project.project import Project
from dextera_build.recipe.backends import backend_of, lacks_of
from dextera_build.report import wording

_LIBRARIES = {"libusb-1.0-0": "usb-1.0", "libgomp1": "gomp", "libegl1": "EGL", "libgl1": "GL"}
_RENDER = "import mujoco; mujoco.Renderer(mujoco.MjModel.from_xml_string('<mujoco/>'), 8, 8).close()"

_EXTRA, _ABSENT = "extra ", "absent"
"""Beginning of the name of an extra's row, and the state of one none of whose packages is installed."""
Finding = tuple[str, bool, str, str]
"""Name, whether it is fine, details, and how to fix it."""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    parser.add_argument(
        "--self-test",
        nargs="*",
        metavar="RULE",
        help="also run the self-tests of the profile's backends, of every rule (takes a minute) or of these; "
        "RULE=BACKEND tests another backend than the profile's",
    )
    options.project_arguments(parser)
    options.json_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Print one line per finding, then the number that each step mends; return 4 if something is missing."""
    project = options.project(args)
    findings = [*_python(), *_store(project), *_libraries(), *_backends(project, args.self_test), *_rendering()]
    findings[2:2] = _extras()
    rows = [
        {"what": what, "ok": fine, "found": found, "mend": None if fine else mend}
        for what, fine, found, mend in findings
    ]
    cells = [
        {"state": _state(what, fine, found), "what": what, "found": found, "mend": "" if fine else mend}
        for what, fine, found, mend in findings
    ]
    content = {"cores": _cores(), "free_bytes": shutil.disk_usage(_existing(project)).free, "rows": rows}
    table.give("doctor", content, as_json=args.json, cells=cells)
    lacking = [mend for _, fine, _, mend in findings if not fine]
    for mend, times in Counter(lacking).most_common() if len(lacking) > 1 else ():
        print(f"{times} of {len(lacking)} missing: {mend}", file=sys.stderr)
    return 0 if all(fine for _, fine, _, _ in findings) else 4


def _python() -> Iterator[Finding]:
    version = ".".join(str(part) for part in sys.version_info[:3])
    yield "python", sys.version_info >= (3, 11), version, "install Python 3.11"
    yield "cores", True, str(_cores()), ""


def _extras() -> Iterator[Finding]:
    """Whether each extra of dxb is installed; one that is absent is no fault: what needs it is told below."""
    for extra, wanted in sorted(extras_of_dxb().items()):
        missing = sorted(each for each in wanted if not _is_installed(each))
        lacks = f"lacks {', '.join(missing)}: {install_extra(extra)}"
        if extra != "all":
            found = _ABSENT if len(missing) == len(wanted) else lacks if missing else "installed"
            yield f"{_EXTRA}{extra}", True, found, ""


def _state(what: str, fine: bool, found: str) -> str:
    """The first column of a row."""
    if what.startswith(_EXTRA) and found != "installed":
        return found if found == _ABSENT else "in part"
    return "ok" if fine else "lacks"


def _is_installed(distribution: str) -> bool:
    try:
        importlib.metadata.version(distribution)
    except importlib.metadata.PackageNotFoundError:
        return False
    return True


def _cores() -> int:
    return len(os.sched_getaffinity(0))


def _existing(project: Project) -> Path:
    """The store's folder, or the nearest one above that exists."""
    return next(parent for parent in (project.cache, *project.cache.parents) if parent.exists())


def _store(project: Project) -> Iterator[Finding]:
    existing = _existing(project)
    free = shutil.disk_usage(existing).free / 2**30
    fine = os.access(existing, os.W_OK)
    yield "store", fine, f"{project.shown(project.cache)}, {free:.0f} GiB free", "choose another one: `--cache DIR`"


def _libraries() -> Iterator[Finding]:
    missing = [package for package, name in _LIBRARIES.items() if ctypes.util.find_library(name) is None]
    for package in _LIBRARIES:
        found = "missing" if package in missing else "found"
        yield package, package not in missing, found, f"`apt-get install {' '.join(missing)}`"


def _backends(project: Project, tested: list[str] | None) -> Iterator[Finding]:
    """The backend that the profile prefers for each rule: its weights, missing requirements, its self-test."""
    profile = project.preferences
    wanted = [_named(project, text) for text in tested or ()]
    for found in project.library.rules():
        names, _ = profile.preferred(found)
        own = [name for path, name in wanted if path == found.path]
        for name in dict.fromkeys([*names[:1], *filter(None, own)]):
            tests = tested is not None and (not tested or name in own or (name == names[0] and "" in own))
            yield _backend(project, found, found.backends[name], tests=tests)


def _named(project: Project, text: str) -> tuple[str, str]:
    """`RULE` or `RULE=BACKEND` of `--self-test`; refuses unknown names."""
    path, _, name = text.partition("=")
    found = project.library.find(path)
    if name:
        backend_of(found, name, "--self-test", Place("command line"))
    return path, name


def _backend(project: Project, found: RuleFile, backend: BackendFile, *, tests: bool) -> Finding:
    facts, lacks, models = backend.facts, lacks_of(found, backend, project.machine), project.machine.models
    told = [facts.licence]
    for name in facts.weights:
        model, installed = project.model(name), models.installed(name)
        size = wording.size(installed.size) if installed else "not installed"
        told.append(f"weights {name} ({size}; {model.licence})")
    memory_gb = sum(project.model(name).memory_gb for name in facts.weights)
    told += [f"{memory_gb:g} GiB for weights"] if memory_gb else []
    told += [f"{facts.gpu_gb:g} GiB of a GPU" + (" or the CPU" if facts.cpu else "")] if facts.gpu_gb else []
    told += [f"needs {', '.join(lacks)}"] if lacks else []
    fine = not lacks
    if fine and tests:
        from dextera_build.building.self_test import self_test

        folders = os.pathsep.join(map(str, project.model_folders))
        fine, line = self_test(project.root, backend.rule, backend.name, models.pinned(facts.weights), folders)
        told.append(line)
    mend = ", ".join(dict.fromkeys(lacks.values())) or f"reinstall {', '.join(facts.packages) or 'dxb'}"
    return f"{backend.rule}={backend.name}", fine, "; ".join(told), mend


def _rendering() -> Iterator[Finding]:
    """Render in a subprocess: a broken GL driver ends the process, and the driver is chosen at import."""
    if importlib.util.find_spec("mujoco") is None:
        yield "rendering", False, "mujoco is not installed", install_extra(smallest_extra(["mujoco"]))
        return
    environment = {"MUJOCO_GL": "egl", **os.environ}
    answer = subprocess.run([sys.executable, "-P", "-c", _RENDER], env=environment, capture_output=True, text=True)
    lines = answer.stderr.strip().splitlines()
    found = f"MUJOCO_GL={environment['MUJOCO_GL']}" if answer.returncode == 0 else (lines[-1] if lines else "crashed")
    yield "rendering", answer.returncode == 0, found, "`apt-get install libegl1 libgl1` and `export MUJOCO_GL=egl`"
