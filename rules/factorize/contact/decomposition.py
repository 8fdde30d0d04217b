"""CoACD in a separate process with a limit of processor time, because CoACD has no option that bounds it."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import numpy as np

PROGRAM = """
import resource, sys
folder, threshold = sys.argv[1], float(sys.argv[2])
seconds, most, seed = (int(text) for text in sys.argv[3:])
resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1))
import numpy as np
import coacd
coacd.set_log_level("error")
given = np.load(folder + "/solid.npz")
parts = coacd.run_coacd(
    coacd.Mesh(given["vertices"], given["faces"]),
    threshold=threshold,
    max_convex_hull=most,
    preprocess_mode="off",  # the solid is already manifold, and voxels would round it
    # 10 nodes and 60 iterations find no fewer and no closer pieces, in twice the time.
    mcts_nodes=5,
    mcts_iterations=20,
    seed=seed,
)
np.savez(folder + "/parts.npz", *[np.asarray(vertices) for vertices, _ in parts])
"""


def parts(
    vertices: np.ndarray, faces: np.ndarray, folder: Path, *, threshold: float, most: int, seed: int, seconds: int
) -> list[np.ndarray] | None:
    """Corner points (N, 3) of the convex parts, or None if the time limit is exceeded.

    The number of faces bounds the work; the limit of processor time is far above it and stops what hangs.

    Args:
        vertices: (V, 3) of a closed manifold.
        faces: (F, 3).
        folder: Where the two processes exchange files.
        threshold: Concavity at which CoACD stops, as a fraction of the size.
        most: Maximum number of parts.
        seed: Seed of the random search.
        seconds: Limit of processor time [s].

    Raises:
        ChildProcessError: CoACD failed for another reason.
    """
    folder.mkdir(parents=True, exist_ok=True)
    np.savez(folder / "solid.npz", vertices=vertices.astype(np.float64), faces=faces.astype(np.int32))
    arguments = [str(folder), *(str(value) for value in (threshold, seconds, most, seed))]
    ended = subprocess.run(
        [sys.executable, "-P", "-c", PROGRAM, *arguments], capture_output=True, text=True, check=False
    )
    if ended.returncode in (-signal.SIGXCPU, -signal.SIGKILL):
        return None
    if ended.returncode:
        raise ChildProcessError(ended.stderr[-2000:] or f"exit code {ended.returncode}")
    with np.load(folder / "parts.npz", allow_pickle=False) as found:
        return [found[name] for name in found.files]
