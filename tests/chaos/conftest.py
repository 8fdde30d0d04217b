"""What disturbed builds are compared with."""

from __future__ import annotations

import pytest

from tests.chaos.children import dxb
from tests.chaos.scenarios import PLAIN, Clean, project
from tests.e2e.space import Space


@pytest.fixture(scope="module")
def clean(tmp_path_factory: pytest.TempPathFactory) -> Clean:
    """Clean builds, one for each state of the sources."""
    made: dict[tuple[str, ...], Space] = {}

    def build(space: Space) -> Space:
        sources = tuple((space.root / name).read_text() for name in ("note.txt", "other.txt"))
        if sources not in made:
            made[sources] = project(tmp_path_factory.mktemp("clean") / "project")
            made[sources].write("note.txt", sources[0])
            made[sources].write("other.txt", sources[1])
            assert dxb(made[sources].root, *PLAIN, "--lock").code == 0
        return made[sources]

    return build
