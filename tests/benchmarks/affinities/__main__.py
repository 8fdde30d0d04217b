"""Draw rooms, train the network of `rules.factorize.regions.affinities`, and write its file and its digest.

    make meshes
    python -m tests.benchmarks.affinities --processes 2

Rooms and things are drawn by their index; no mesh that a table reports is among them.
"""

from __future__ import annotations

import argparse
import hashlib
import re
import tempfile
from pathlib import Path

import numpy as np
import torch
from torch import multiprocessing

from rules.factorize.regions import affinities
from tests.benchmarks.affinities import network, onnx_file, pictures, things

ROOMS = 70
CODE = Path(affinities.__file__)


def main() -> None:
    """Draw, train, write."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--rooms", type=int, default=ROOMS, help="number of rooms, with eight pictures each")
    options.add_argument("--processes", type=int, default=6, help="processes that train together")
    options.add_argument("--steps", type=int, default=network.STEPS, help="steps of all processes together")
    options.add_argument("--out", type=Path, default=affinities.FILE, help="the file to write")
    given = options.parse_args()
    with multiprocessing.Pool(given.processes) as pool:
        found = pool.map(_room, range(given.rooms), 1)
    seen, labels = (np.concatenate([getattr(one, name) for one in found]) for name in ("seen", "labels"))
    learned = network.Pictures(seen, labels)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "weights.pt"
        arguments = (given.processes, learned, file, given.steps)
        multiprocessing.spawn(network.train, arguments, given.processes)  # type: ignore[no-untyped-call]
        trained = network.Network()
        trained.load_state_dict(torch.load(file))
    write(trained.eval(), given.out)


def _room(seed: int) -> network.Pictures:
    torch.set_num_threads(1)
    return pictures.pictures(seed, things.learned)


def write(trained: network.Network, out: Path) -> None:
    """Write the file, and its digest if it is that of the rules."""
    data = onnx_file.exported(trained)
    out.write_bytes(data)
    digest = hashlib.sha256(data).hexdigest()
    print(f"{out}: {len(data):,} bytes, SHA-256 {digest}")
    if out == affinities.FILE:
        CODE.write_text(re.sub(r'(?m)^DIGEST = ".*"', f'DIGEST = "{digest}"', CODE.read_text()))


if __name__ == "__main__":
    main()
