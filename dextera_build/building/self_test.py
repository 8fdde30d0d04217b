"""Checks that a backend runs on this machine, in a process of its own: a broken library may end it."""

from __future__ import annotations

import importlib
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from dextera_build.code.distributions import modules_of
from dextera_build.code.loader import Library
from dextera_build.rule import Context
from dextera_build.running.runner import pretrained

TIMEOUT_S = 300.0
_ENDED_BY_SIGNAL = "the process ended with signal {}"


def self_test(project: Path, rule: str, backend: str, weights: tuple[str, ...], models: str) -> tuple[bool, str]:
    """Import a backend with its packages and, if it defines `self_test(ctx)`, call it.

    Args:
        project: The project's folder.
        rule: `factorize.mesh`.
        backend: `primitives`.
        weights: `name@digest` of the models that it declares.
        models: Folders of models, as in `DXB_MODELS`.

    Returns:
        Whether it succeeded, and a line about it.
    """
    code = f"from {__name__} import run; run(*{(str(project), rule, backend, weights)!r})"
    began = time.monotonic()
    environment = {"MUJOCO_GL": "egl", **os.environ, "DXB_MODELS": models, "HF_HUB_OFFLINE": "1"}
    try:
        done = subprocess.run(
            [sys.executable, "-P", "-c", code], env=environment, capture_output=True, text=True, timeout=TIMEOUT_S
        )
    except subprocess.TimeoutExpired:
        return False, f"self-test takes longer than {TIMEOUT_S:g} s"
    if done.returncode == 0:
        return True, f"self-test {time.monotonic() - began:.1f} s"
    lines = done.stderr.strip().splitlines()
    return False, f"self-test: {lines[-1] if lines else _ENDED_BY_SIGNAL.format(-done.returncode)}"


def run(project: str, rule: str, backend: str, weights: tuple[str, ...]) -> None:
    """Run in the process of `self_test`."""
    found = Library(Path(project)).find(rule).backends[backend]
    for package in found.facts.packages:
        for module in sorted(modules_of(package)):
            if not module.startswith("_"):
                importlib.import_module(module)
    test = getattr(found.module, "self_test", None)
    if test is not None:
        with tempfile.TemporaryDirectory() as scratch:
            test(Context(found.module, scratch=Path(scratch), pretrained=pretrained({"weights": weights})))
