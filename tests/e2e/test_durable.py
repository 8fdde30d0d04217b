"""A finished build is on the disk before anything says that it is finished."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.e2e.space import Space

PROBE = """
import sys
from pathlib import Path
from dextera_build.cli.main import main
from dextera_build.store import files

settle = files.settle


def probed(folder):
    patterns = ("out/**/*", "out/**/.placed")
    counts = [len([path for path in Path(folder).glob(pattern) if path.is_file()]) for pattern in patterns]
    print("settled: {} files, {} stamps".format(counts[0] - counts[1], counts[1]), file=sys.stderr)
    return settle(folder)


files.settle = probed
sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.medium
def test_a_stamp_is_written_when_its_files_are_on_the_disk(space: Space) -> None:
    """In one process, to see the moment."""
    space.write("probe.py", PROBE)
    probed = space.python("probe.py", "build", "say/words", "--console", "none", env={"DXB_DURABLE": "1"})
    assert probed.code == 0, probed.err
    assert "settled: 1 files, 0 stamps" in probed.err
    again = space.python("probe.py", "build", "say/words", "--console", "none", env={"DXB_DURABLE": "1"})
    assert "settled" not in again.err  # nothing was written


@pytest.mark.medium
def test_it_can_be_switched_off(space: Space) -> None:
    space.write("probe.py", PROBE)
    probed = space.python("probe.py", "build", "say/words", "--console", "none", env={"DXB_DURABLE": "0"})
    assert probed.code == 0
    assert "settled" not in probed.err


@pytest.mark.slow
def test_lost_stamps_and_local_state_cost_a_look(space: Space) -> None:
    first = space.dxb("build", "say/words")
    for how in (None, lambda data: data[: len(data) // 2], lambda data: bytes(len(data))):
        found = [path for pattern in ("out/**/.placed", "local/state.db") for path in cache(space).glob(pattern)]
        assert found
        for path in found:
            data = path.read_bytes()
            path.write_bytes(how(data)) if how else path.unlink()
        again = space.build("say/words")
        assert (again.code, again.out) == (0, first.out)
        assert again.nodes("ran") == set()


def cache(space: Space) -> Path:
    return space.root / "cache"
