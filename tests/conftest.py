"""What every test needs before anything is imported."""

from __future__ import annotations

import gc
import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from dextera_build.code import modules
from dextera_build.store.store import Store
from tests.forks import forked_workers, workers_with

# MuJoCo reads it once, when it is imported; a test may do that before `dextera_build.sim` does.
os.environ.setdefault("MUJOCO_GL", "egl")
# One thread, as workers of builds have: processes that share the cores would spend up to half of their time on waiting.
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

# How fast the machine is, and what else it has to do, says nothing of the code.
settings.register_profile("search", deadline=None, suppress_health_check=[HealthCheck.too_slow])
# A quarter of the examples where a test states no number: those of `make test-all` differ from run to run.
settings.register_profile("same", settings.get_profile("search"), derandomize=True, max_examples=25)
WITHOUT_SEARCH = ("not slow and not medium", "medium and not slow", "not slow")
"""What `make test`, `make test-medium` and `.ci/run` select."""
FORKING = frozenset({"chaos", "hostile", "oracle", "outside", "workers"})
"""Folders of tests that fork this process hundreds of times, and a fork takes the longer, the more memory it has."""


HERE = str(Path(__file__).parents[1]) + os.sep


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the tests that fork, while little is loaded."""
    items.sort(key=lambda item: FORKING.isdisjoint(item.path.parts))


# What is imported and collected stays to the end: the collector of garbage would look through it again and again.
gc.disable()


@pytest.hookimpl(tryfirst=True)
def pytest_runtestloop() -> None:
    """Begin to collect garbage, of what tests leave, a third as often as Python does."""
    gc.freeze()
    gc.set_threshold(2000, 10, 10)
    gc.enable()


def pytest_configure(config: pytest.Config) -> None:
    """What CI runs says the same of the same code; every other run searches for cases that nobody tried."""
    settings.load_profile("same" if config.getoption("markexpr") in WITHOUT_SEARCH else "search")


@pytest.fixture
def store(tmp_path: Path) -> Store:
    """A store of a test's own."""
    return Store(tmp_path / "store")


@pytest.fixture(autouse=True, scope="session")
def workers() -> Iterator[None]:
    """Builds in the process of the tests have forks as workers."""
    with forked_workers():
        yield


@pytest.fixture(autouse=True, scope="module")
def sources_forgotten() -> Iterator[None]:
    """A module's tests leave no sources of their projects behind, which every later command would compare."""
    yield
    for known in (vars(modules)["_READ"], vars(modules)["_PROOFS"]):
        for name in [name for name in known if not name.startswith(HERE)]:
            del known[name]


@pytest.fixture(scope="module")
def array_workers() -> Iterator[None]:
    """Forked workers have loaded what rules need that make pictures."""
    with workers_with(
        "numpy", "PIL.Image", "dextera_build.artifacts.objects.view", "dextera_build.artifacts.tasks.task"
    ):
        yield


@pytest.fixture(scope="module")
def twin_workers() -> Iterator[None]:
    """Forked workers have loaded what the rules of twins need."""
    with workers_with(
        "numpy", "PIL.Image", "scipy.ndimage", "scipy.spatial", "trimesh", "dextera_build.artifacts.tasks.task"
    ):
        yield
