"""A store of a test's own."""

from __future__ import annotations

from pathlib import Path

import pytest

from dextera_build.store.store import Store


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return Store(tmp_path / "store")
