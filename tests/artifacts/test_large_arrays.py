"""Large arrays: stored without a second copy, and read from the store without being held in memory."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.spatial.joints import Joints
from dextera_build.errors import ArtifactError
from dextera_build.store.store import Store

SIZE_MIB, MOST_MIB = 256, 96
PROGRAM = """
import resource, sys
import numpy as np
from pathlib import Path
from dextera_build.artifacts.spatial.joints import Joints
from dextera_build.store.store import Store

def peak():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024

store, rows = Store(Path(sys.argv[1])), int(sys.argv[3])
if sys.argv[2] == "write":
    names, stamps = tuple(f"joint_{n}" for n in range(512)), np.arange(rows, dtype=float)
    made = Joints(names=names, stamps=stamps, positions=np.full((rows, 512), 0.5))
    before = peak()
    print(made.encode(store.writer))
else:
    before = peak()
    found = Joints.decode(sys.argv[2], store.reader)
    assert (found.positions[rows // 2] == 0.5).all()
    print("read")
print(peak() - before)
"""


@pytest.mark.slow
def test_an_array_larger_than_the_bound_is_stored_and_read_within_it(tmp_path: Path) -> None:
    def run(what: str) -> tuple[str, float]:
        command = [sys.executable, "-c", PROGRAM, str(tmp_path / "store"), what, str(SIZE_MIB * 256)]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        said, growth = done.stdout.split()
        return said, float(growth)

    key, written = run("write")
    _, read = run(key)
    assert (written < MOST_MIB, read < MOST_MIB) == (True, True), (written, read)


def test_a_large_stored_array_with_one_number_that_is_not_finite_is_refused(tmp_path: Path) -> None:
    store, rows = Store(tmp_path / "store"), 1 << 20
    states = np.zeros((rows, 3))
    made = Joints(names=("a", "b", "c"), stamps=np.arange(rows, dtype=float), positions=states)
    states.flags.writeable = True
    states[-1, -1] = np.nan
    with pytest.raises(ArtifactError, match="1 of 3,145,728 numbers are not finite"):
        Joints.decode(made.encode(store.writer), store.reader)
