"""What tests of calls share."""

from __future__ import annotations

import pytest

from dextera_build.store.store import Store
from tests.calls.jobs_service import serving_jobs


@pytest.fixture
def store(tmp_path):
    return Store(tmp_path / "store")


@pytest.fixture
def service():
    with serving_jobs() as made:
        yield made


@pytest.fixture
def told():
    return []
