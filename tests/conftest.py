"""What every test needs before anything is imported."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from dextera_build.store.store import Store

# MuJoCo reads it once, when it is imported; a test may do that before `dextera_build.sim` does.
os.environ.setdefault("MUJOCO_GL", "egl")

# How fast the machine is, and what else it has to do, says nothing of the code.
settings.register_profile("search", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("same", settings.get_profile("search"), derandomize=True)


def pytest_configure(config: pytest.Config) -> None:
    """What CI runs says the same of the same code; every other run searches for cases that nobody tried."""
    settings.load_profile("same" if config.getoption("markexpr") == "not slow" else "search")


@pytest.fixture
def store(tmp_path: Path) -> Store:
    """A store of a test's own."""
    return Store(tmp_path / "store")
