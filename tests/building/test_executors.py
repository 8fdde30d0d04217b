"""Workers do not take over what the environment of a build says about hashes, asserts, text, time and threads."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.e2e.space import Space

RULE = '''
"""toy.told: tells of its process."""
import locale
import os
import time

from dextera_build.artifacts.base import File
from dextera_build.rule import Context, rule


@rule(version=1)
def told(ctx: Context) -> File:
    """Return what results may depend on."""
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    found = ["".join({"a", "bb", "ccc", "dddd", "eeeee"}), __debug__, time.strftime("%H", time.localtime(0))]
    found += [locale.getpreferredencoding(), locale.setlocale(locale.LC_ALL, ""), os.getcwd()]
    return File(data=repr([*found, *map(os.environ.get, names)]).encode())
'''
HOSTILE = {
    "PYTHONHASHSEED": "5",
    "PYTHONOPTIMIZE": "1",
    "PYTHONUTF8": "0",
    "LC_ALL": "POSIX",
    "TZ": "Asia/Tokyo",
    "OMP_NUM_THREADS": "7",
    "MKL_NUM_THREADS": "7",
}


@pytest.mark.medium
def test_results_do_not_depend_on_the_environment_of_a_build(tmp_path: Path) -> None:
    space = Space(tmp_path)
    space.write("dxb.toml", 'cache = "cache"\n')
    space.write("rules/toy/told.py", RULE.lstrip())
    space.write("recipes/g.yaml", "nodes: {a: {rule: toy.told}}\ntargets: {default: [a]}\n")
    below = Space(tmp_path / "recipes")
    found = []
    for store, where, environment in (("one", space, {}), ("two", below, HOSTILE)):
        built = where.dxb("build", "g", "--console", "none", env={**environment, "DXB_CACHE": str(tmp_path / store)})
        assert built.code == 0, built.err
        found.append((tmp_path / store / "out/g/a/a").read_text())
    assert found[0] == found[1]
