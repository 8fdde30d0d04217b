"""`dxb doctor`: checks of this machine for the needs of builds, with a fix for each problem."""

from __future__ import annotations

import argparse
import ctypes.util
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator

from dextera_build.cli import options, table
from dextera_build.errors import install_extra
from dextera_build.project.project import Project

_LIBRARIES = {"libusb-1.0-0": "usb-1.0", "libgomp1": "gomp", "libegl1": "EGL", "libgl1": "GL"}
_RENDER = "import mujoco; mujoco.Renderer(mujoco.MjModel.from_xml_string('<mujoco/>'), 8, 8).close()"

Finding = tuple[str, bool, str, str]
"""Name, whether it is fine, details, and how to fix it."""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    options.project_arguments(parser)
    options.json_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Print one line per finding; return 4 if something that the profile needs is missing."""
    project = options.project(args)
    findings = [*_python(), *_store(project), *_libraries(), *_backends(project), *_rendering()]
    rows = [dict(zip(("what", "ok", "found", "mend"), finding, strict=True)) for finding in findings]
    cells = [
        {"state": "ok" if fine else "lacks", "what": what, "found": found, "mend": "" if fine else mend}
        for what, fine, found, mend in findings
    ]
    table.give(rows, as_json=args.json, cells=cells)
    return 0 if all(fine for _, fine, _, _ in findings) else 4


def _python() -> Iterator[Finding]:
    version = ".".join(str(part) for part in sys.version_info[:3])
    yield "python", sys.version_info >= (3, 11), version, "install Python 3.11"
    yield "cores", True, str(len(os.sched_getaffinity(0))), ""


def _store(project: Project) -> Iterator[Finding]:
    folder = project.cache
    existing = next(parent for parent in (folder, *folder.parents) if parent.exists())
    free = shutil.disk_usage(existing).free / 2**30
    fine = os.access(existing, os.W_OK)
    yield "store", fine, f"{project.shown(folder)}, {free:.0f} GiB free", "choose another one: `--cache DIR`"


def _libraries() -> Iterator[Finding]:
    missing = [package for package, name in _LIBRARIES.items() if ctypes.util.find_library(name) is None]
    for package in _LIBRARIES:
        found = "missing" if package in missing else "found"
        yield package, package not in missing, found, f"`apt-get install {' '.join(missing)}`"


def _backends(project: Project) -> Iterator[Finding]:
    profile = project.profile
    for found in project.library.rules():
        for backend in found.backends.values():
            if profile in backend.facts.profiles and (missing := backend.missing()):
                name = f"{found.path}, backend {backend.name}"
                mend = install_extra(backend.facts.extra or "all")
                yield name, False, f"needs {', '.join(missing)}", mend


def _rendering() -> Iterator[Finding]:
    """Render in a subprocess: a broken GL driver ends the process, and the driver is chosen at import."""
    environment = {"MUJOCO_GL": "egl", **os.environ}
    answer = subprocess.run([sys.executable, "-c", _RENDER], env=environment, capture_output=True, text=True)
    lines = answer.stderr.strip().splitlines()
    found = f"MUJOCO_GL={environment['MUJOCO_GL']}" if answer.returncode == 0 else (lines[-1] if lines else "crashed")
    yield "rendering", answer.returncode == 0, found, "`apt-get install libegl1 libgl1` and `export MUJOCO_GL=egl`"
