"""Packages of extras that a file of tests needs, looked for without being imported while tests are collected."""

from __future__ import annotations

from importlib.util import find_spec

import pytest


def needs(*packages: str) -> None:
    """Skip the file that calls this if a package is not installed."""
    for package in packages:
        try:
            found = find_spec(package)
        except ModuleNotFoundError:  # the package above it
            found = None
        if found is None:
            pytest.skip(f"{package} is not installed", allow_module_level=True)
