"""What is done with a data set of two cameras and joint states in a store."""

from __future__ import annotations

import json
import multiprocessing
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.cameras.video import Video
from dextera_build.artifacts.spatial.joints import Joints
from dextera_build.artifacts.tasks.pixels import Pixels
from dextera_build.formats import video as video_files
from dextera_build.learning.parts import Frames
from dextera_build.store.store import Store
from tests.benchmarks.data_set import lerobot_export
from tests.benchmarks.data_set.scene import Table

CAMERAS, JOINTS, RATE_HZ = ("front", "wrist"), 27, 30.0


def write(root: Path, episodes: int, frames: int, size: tuple[int, int], processes: int) -> int:
    """Store a collection of videos per camera and one of joint states; return the number of pictures."""
    labels = [f"{number:04d}" for number in range(episodes)]
    digests: dict[str, dict[str, str]] = {name: {} for name in (*CAMERAS, "joints")}
    with ProcessPoolExecutor(processes, multiprocessing.get_context("spawn")) as pool:
        work = pool.map(_episode, *zip(*[(root, number, frames, size) for number in range(episodes)], strict=True))
        for label, found in zip(labels, work, strict=True):
            for name, digest in found.items():
                digests[name][label] = digest
    store = Store(root / "store")
    whole = {name: _collected(store, found, Joints if name == "joints" else Video) for name, found in digests.items()}
    (root / "digests.json").write_text(json.dumps(whole))
    return episodes * frames * len(CAMERAS)


def _episode(root: Path, number: int, frames: int, size: tuple[int, int]) -> dict[str, str]:
    """Store one episode; return the digest of each of its artifacts."""
    store, table, coder = Store(root / "store"), Table(*size), video_files.encoder(*size, RATE_HZ)
    found = {}
    for camera, name in enumerate(CAMERAS):
        path = root / f"{number}-{name}.mp4"
        found[name] = video_files.write(path, table.pictures(2 * number + camera, frames), coder).encode(store.writer)
        path.unlink()
    stamps = np.arange(frames) / RATE_HZ
    phase = np.random.default_rng(number).uniform(0, 6, JOINTS)
    names = tuple(f"joint_{joint}" for joint in range(JOINTS))
    joints = Joints(names=names, stamps=stamps, positions=np.sin(stamps[:, None] + phase))
    return found | {"joints": joints.encode(store.writer)}


def _collected(store: Store, digests: dict[str, str], kind: type[Video] | type[Joints]) -> str:
    """A collection of stored artifacts, as a group of nodes returns it."""
    items = {label: kind.decode(key, store.reader) for label, key in digests.items()}
    return Collection[kind](items=items).encode(store.writer)  # type: ignore[valid-type]


def opened(root: Path) -> tuple[dict[str, Collection[Video]], Collection[Joints]]:
    """The videos of each camera, and the joint states."""
    store = Store(root / "store")
    digests = json.loads((root / "digests.json").read_text())
    videos = {camera: Collection[Video].decode(digests[camera], store.reader) for camera in CAMERAS}
    return videos, Collection[Joints].decode(digests["joints"], store.reader)


def read(root: Path, batches: int, batch: int) -> int:
    """Read random batches of frames of both cameras with their joint states; return the number of pictures."""
    videos, joints = opened(root)
    labels, random, count = list(joints.items), np.random.default_rng(1), 0
    for _ in range(batches):
        rows, pictures = [], []
        for label in random.choice(labels, batch):
            number = int(random.integers(len(joints.items[label].stamps)))
            rows.append(joints.items[label].positions[number])
            pictures.append(np.stack([videos[camera].items[label].frames([number])[0] for camera in CAMERAS]))
        assert np.stack(rows).shape == (batch, JOINTS)
        count += np.stack(pictures).shape[0] * len(CAMERAS)
    return count


def unpack(root: Path) -> int:
    """Decode all videos once into arrays of the store, as `demonstrate.unpack` does; return the number of pictures."""
    videos, joints = opened(root)
    store, digests = Store(root / "store"), {}
    for camera, found in videos.items():
        arrays = {}
        for label, video in found.items.items():
            pixels = video.frames(list(range(len(joints.items[label].stamps))))
            file = root / f"{camera}-{label}.pixels"
            file.write_bytes(pixels.tobytes())
            arrays[label] = np.asarray(np.memmap(file, np.uint8, "r", shape=pixels.shape))
        digests[camera] = Pixels(episodes=arrays).encode(store.writer)
        for label in arrays:
            (root / f"{camera}-{label}.pixels").unlink()
    (root / "pixels.json").write_text(json.dumps(digests))
    return sum(_lengths(joints)) * len(CAMERAS)


class Sampler:
    """Reads random batches of unpacked frames of both cameras with their joint states, as learners do."""

    def __init__(self, root: Path) -> None:
        store = Store(root / "store")
        digests = json.loads((root / "pixels.json").read_text())
        _, joints = opened(root)
        self._states = np.concatenate([found.positions for found in joints.items.values()])
        pixels = [Pixels.decode(digests[camera], store.reader) for camera in CAMERAS]
        self._frames = [Frames([found.episodes[label] for label in joints.items]) for found in pixels]

    def read(self, batches: int, batch: int) -> int:
        """Read batches; return the number of pictures."""
        random, count = np.random.default_rng(1), 0
        for _ in range(batches):
            rows = random.integers(len(self._states), size=batch)
            pictures = np.stack([found.at(rows) for found in self._frames])
            assert self._states[rows].shape == (batch, JOINTS)
            count += pictures.shape[0] * pictures.shape[1]
        return count


def export(root: Path) -> int:
    """Write everything as MP4 and NPZ files, as `dxb get` does; return the number of pictures."""
    videos, joints = opened(root)
    for camera, found in videos.items():
        found.export(root / "out", camera)
    joints.export(root / "out", "joints")
    return sum(_lengths(joints)) * len(CAMERAS)


def as_lerobot(root: Path) -> int:
    """Write everything as a LeRobotDataset; return the number of pictures."""
    return lerobot_export.write(*opened(root), RATE_HZ, root / "lerobot")


def _lengths(joints: Collection[Joints]) -> Iterator[int]:
    for item in joints.items.values():
        yield len(item.stamps)
