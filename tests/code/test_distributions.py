"""Distributions: which one has a module, and its version."""

from __future__ import annotations

import importlib.metadata
import os
import sys
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path

import pytest

from dextera_build.code.distributions import normal, providers, version_of


def install(folder: Path, name: str, version: str, **files: str) -> None:
    """Write the metadata of a distribution."""
    place = folder / f"{name}-{version}.dist-info"
    place.mkdir(parents=True)
    (place / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
    for file, text in files.items():
        (place / file.replace("__", ".")).write_text(text)


def test_modules_are_found_as_the_standard_library_finds_them() -> None:
    known = {
        module: frozenset(map(normal, names))
        for module, names in importlib.metadata.packages_distributions().items()
        if module.isidentifier()
    }
    assert {"cv2", "PIL", "yaml", "numpy"} <= known.keys()
    # The standard library does not look into names such as `nvidia/cusparselt` of a wheel's top_level.txt.
    found = providers(known)
    assert {module: found[module] & names for module, names in known.items()} == known
    assert {module for module in known if found[module] != known[module]} <= {"nvidia"}


@pytest.mark.parametrize(
    ("files", "modules"),
    [
        ({"top_level__txt": "own_one\nown_two\n", "RECORD": "other/x.py,,\n"}, {"own_one", "own_two"}),
        ({"top_level__txt": "", "RECORD": "own_one/x.py,sha256=1,2\nown_two.py,,\n"}, {"own_one", "own_two"}),
        ({"RECORD": f"own_one{EXTENSION_SUFFIXES[0]},,\nREADME.md,,\n"}, {"own_one"}),
        ({}, set()),
    ],
)
def test_a_distribution_lists_its_modules(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, files: dict[str, str], modules: set[str]
) -> None:
    install(tmp_path, "Own_Lab", "1.0", **files)
    monkeypatch.syspath_prepend(str(tmp_path))
    found = providers(("own_one", "own_two"))
    assert {module for module, names in found.items() if names == {"own-lab"}} == modules
    assert version_of("own-lab") == "1.0"


def test_two_distributions_may_have_one_module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(tmp_path))
    for name in ("one", "two"):
        install(tmp_path, name, "1", top_level__txt="shared_module\n")
        assert name in providers(["shared_module"])["shared_module"]
    assert providers(["shared_module", "unknown_module"]) == {
        "shared_module": {"one", "two"},
        "unknown_module": frozenset(),
    }


def test_python_and_the_platform_have_versions() -> None:
    assert version_of("python") == ".".join(map(str, sys.version_info[:2]))
    assert version_of("platform") == f"linux-{os.uname().machine}"
    assert version_of("not-installed-at-all") is None
