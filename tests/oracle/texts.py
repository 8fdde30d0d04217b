"""Texts of the sources of random projects."""

from __future__ import annotations

RULE = '''"""toy.{name}: random."""
from __future__ import annotations
import hashlib
import time
from typing import TYPE_CHECKING
from dextera_build.artifacts.base import File, Folder
from dextera_build.rule import Context, Options, rule
{imports}
NUMBER = {number}
{child}
class {Name}Options(Options):
    """Options."""
    add: int = 0
    """A number."""
    nap_s: float = 0.0
    """How long to sleep [s]."""

@rule(version=1, packages=("plug",))
def {name}(
    ctx: Context, a: File | None = None, b: File | None = None, tree: Folder | None = None, *, options: {Name}Options
) -> File:
    """Say which code ran on what."""
    time.sleep(options.nap_s)
{inner}    read = [hashlib.sha256(file.data).hexdigest()[:8] for file in (a, b) if file is not None]
    read += sorted(tree.files.items()) if tree is not None else []
    backend = "" if ctx.backend is None else ctx.backend.NUMBER
    return File(data=f"{name}:{{NUMBER}} {{backend}} {{options.add}} {{read}} {{[{values}]}}".encode())
'''
CHILD = '''
def child(function):
    """The answer of a process that a worker starts; the reference calls the function."""
    import multiprocessing, os
    if "DEXTERA_WORKER" not in os.environ:
        return function()
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(function)
'''
MODULE = '''"""A module."""
from __future__ import annotations
from typing import TYPE_CHECKING
{imports}
NUMBER = {number}
SEEN = ""
STEPS = []
STEPS.append(NUMBER)
STEPS.append(10)
STEPS.reverse()

def one(): ...
def two(): ...

def value():
    """Say which code ran."""
{inner}    return f"{name}:{{NUMBER}}{{SEEN}}{{STEPS}}{{[{values}]}}"
{tail}'''
BACKEND = '''"""A backend."""
from dextera_build.rule import Backend
BACKEND = Backend(summary="it", profiles=("cpu",))
NUMBER = {}
'''
IMPORTS = ("{}\n", "try:\n    {}\nexcept ImportError:\n    {} = None\n", "if not TYPE_CHECKING:\n    {}\n")
