"""A data set of episodes with video, through the store: written, read in random batches and exported in bounded memory.

`python -m tests.benchmarks.episodes --episodes 390 --frames 300` prints a row of the table in `docs/benchmarks.md`.
Pictures are drawn by NumPy: three shaded balls move over a textured table, with the noise of a sensor.
"""

from __future__ import annotations

import argparse
import json
import resource
import shutil
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.stream import Joints
from dextera_build.artifacts.video import Video, encoder
from dextera_build.store.store import Store

CAMERAS, JOINTS, RATE_HZ = ("front", "wrist"), 27, 30.0
BATCH, BATCHES = 32, 20
"""Frames per batch and camera, and number of batches that are read."""


class Table:
    """A textured plane with moving balls, seen from above.

    Args:
        width: Width of a picture [px].
        height: Height of a picture [px].
    """

    def __init__(self, width: int, height: int) -> None:
        self.width, self.height = width, height
        random = np.random.default_rng(0)
        coarse = random.uniform(0.5, 1.0, (height // 8 + 1, width // 8 + 1, 1))
        fine = np.kron(coarse, np.ones((8, 8, 1)))[:height, :width]
        self._ground = (fine * [150, 120, 90] + random.uniform(-12, 12, (height, width, 1))).astype(np.float32)
        self._noise = random.normal(0, 2.0, (8, height, width, 1)).astype(np.float32)

    def pictures(self, seed: int, count: int) -> Iterator[np.ndarray]:
        """Frames (H, W, 3) uint8 of one episode through one camera."""
        random = np.random.default_rng(seed)
        radius = self.height / random.uniform(5, 9, 3)
        place, speed = random.uniform(0.2, 0.8, (3, 2)), random.uniform(-0.004, 0.004, (3, 2))
        colours = random.uniform(60, 250, (3, 3)).astype(np.float32)
        for number in range(count):
            shown = self._ground + self._noise[number % 8]
            for ball in range(3):
                at = (place[ball] + number * speed[ball]) % 1 * [self.height, self.width]
                self._draw(shown, at, radius[ball], colours[ball])
            yield np.clip(shown, 0, 255).astype(np.uint8)

    def _draw(self, shown: np.ndarray, at: np.ndarray, radius: float, colour: np.ndarray) -> None:
        """Draw a ball in parallel projection, lit from the upper left."""
        top, left = np.maximum(at - radius, 0).astype(int)
        part = shown[top : int(at[0] + radius) + 1, left : int(at[1] + radius) + 1]
        y, x = np.mgrid[top : top + part.shape[0], left : left + part.shape[1]]
        y, x = (y - at[0]) / radius, (x - at[1]) / radius
        inside = x * x + y * y < 1
        z = np.sqrt(np.where(inside, 1 - x * x - y * y, 0))
        light = np.clip(0.25 + 0.75 * (z - 0.4 * x - 0.4 * y) / 1.15, 0, 1)
        part[inside] = light[inside][:, None] * colour


def write(store: Store, scratch: Path, episodes: int, frames: int, size: tuple[int, int]) -> dict[str, str]:
    """Store a collection of videos per camera and one of joint states; return the digest of each by name."""
    table, coder = Table(*size), encoder(*size, RATE_HZ)
    digests: dict[str, dict[str, str]] = {name: {} for name in (*CAMERAS, "joints")}
    stamps = np.arange(frames) / RATE_HZ
    names = tuple(f"joint_{number}" for number in range(JOINTS))
    for episode in range(episodes):
        label = f"{episode:04d}"
        for number, camera in enumerate(CAMERAS):
            path = scratch / f"{camera}.mp4"
            video = Video.write(path, table.pictures(2 * episode + number, frames), coder)
            digests[camera][label] = video.encode(store.writer)
        phase = np.random.default_rng(episode).uniform(0, 6, JOINTS)
        joints = Joints(names=names, stamps=stamps, positions=np.sin(stamps[:, None] + phase))
        digests["joints"][label] = joints.encode(store.writer)
    return {name: _collected(store, found, Joints if name == "joints" else Video) for name, found in digests.items()}


def _collected(store: Store, digests: dict[str, str], kind: type[Video] | type[Joints]) -> str:
    """A collection of stored artifacts, as a group of nodes returns it: none of them is loaded."""
    items = {label: kind.decode(key, store.reader) for label, key in digests.items()}
    return Collection[kind](items=items).encode(store.writer)  # type: ignore[valid-type]


def read(store: Store, digests: dict[str, str], batches: int) -> int:
    """Read random batches of frames of both cameras with their joint states; return the number of frames."""
    videos = {camera: Collection[Video].decode(digests[camera], store.reader) for camera in CAMERAS}
    joints = Collection[Joints].decode(digests["joints"], store.reader)
    labels, random, count = list(joints.items), np.random.default_rng(1), 0
    for _ in range(batches):
        rows = []
        for label in random.choice(labels, BATCH):
            number = int(random.integers(len(joints.items[label].stamps)))
            rows.append(joints.items[label].positions[number])
            pictures = [videos[camera].items[label].frames([number]) for camera in CAMERAS]
            count += len(pictures)
        assert np.stack(rows).shape == (BATCH, JOINTS)
    return count


def export(store: Store, digests: dict[str, str], out: Path) -> int:
    """Write everything as MP4 and NPZ files, as `dxb get` does; return the number of bytes."""
    for camera in CAMERAS:
        Collection[Video].decode(digests[camera], store.reader).export(out, camera)
    Collection[Joints].decode(digests["joints"], store.reader).export(out, "joints")
    return sum(path.stat().st_size for path in out.rglob("*") if path.is_file())


def measure(root: Path, episodes: int, frames: int, size: tuple[int, int], batches: int) -> dict[str, float]:
    """Times [s], sizes [MB] and the peak of this process, which starts no others [MiB]."""
    store, scratch = Store(root / "store"), root / "scratch"
    scratch.mkdir()
    begun = time.perf_counter()
    digests = write(store, scratch, episodes, frames, size)
    written = time.perf_counter()
    count = read(store, digests, batches)
    seen = time.perf_counter()
    total = export(store, digests, root / "out")
    done = time.perf_counter()
    return {
        "episodes": episodes,
        "frames": episodes * frames * len(CAMERAS),
        "write [frames/s]": episodes * frames * len(CAMERAS) / (written - begun),
        "random read [frames/s]": count / (seen - written),
        "export [s]": done - seen,
        "exported [MB]": total / 1e6,
        "peak [MiB]": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }


def main() -> None:
    """Measure in a temporary folder and print JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--episodes", type=int, default=390)
    parser.add_argument("--frames", type=int, default=300)
    parser.add_argument("--size", type=int, nargs=2, default=(640, 480))
    parser.add_argument("--batches", type=int, default=BATCHES)
    parser.add_argument("--root", type=Path, help="where to write; a temporary folder otherwise")
    args = parser.parse_args()
    root = args.root or Path(tempfile.mkdtemp(prefix="episodes-"))
    root.mkdir(parents=True, exist_ok=True)
    try:
        print(json.dumps(measure(root, args.episodes, args.frames, tuple(args.size), args.batches)))
    finally:
        shutil.rmtree(root)


if __name__ == "__main__":
    main()
