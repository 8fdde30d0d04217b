"""Rendered sequences of foreign meshes, tracked by `geometry.tracking` and by Open3D's ICP.

`python -m tests.benchmarks.tracking [NAME ...] [--keep FOLDER]` prints a row per sequence: frames of objects that are
visible (three quarters or more of them) and half hidden (from 30 %), the parts of them with ADD-S and ADD below 2 and
1 cm, with the 95 % interval of Wilson as if frames were independent, which they are not; how long an object was without
a pose after it was to be seen again; the largest ADD-S of a pose that was called `tracked`; processor time per frame,
and that of Open3D's ICP from the last pose in the same loop. Symmetric objects have no ADD. Frames are 640 x 480 at
30 Hz (`rest`: 5 Hz) with the noise of `capture.sensor`; poses start at the true ones. `--keep` stores rendered frames
for another run, `--masks` gives the tracker the masks of `align.follow`.
`--rate 15`, `--noise 2` and `--shift 2` make frames worse: fewer, noisier, with the depth 2 px beside the colours.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from dextera_build.artifacts.cameras.rgbd_video import RgbdFrame, RgbdVideo
from dextera_build.statistics import wilson
from tests.benchmarks.tracking import followed, hidden, judged, sequences, things
from tests.benchmarks.tracking.judged import HALF, VISIBLE, Row
from tests.benchmarks.tracking.scene import CAMERA, Sequence, Strain, frames

RESTING = "rest"
WRONG_M = 0.03
"""ADD-S from which a tracked pose is wrong [m]."""


def main(arguments: list[str]) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*")
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--no-icp", action="store_true")
    parser.add_argument("--masks", action="store_true")
    parser.add_argument("--rate", type=float)
    parser.add_argument("--noise", type=float, default=1.0)
    parser.add_argument("--shift", type=int, default=0)
    chosen = parser.parse_args(arguments)
    strain = Strain(chosen.rate, chosen.noise, chosen.shift)
    with tempfile.TemporaryDirectory() as scratch:
        meshes = things.foreign(Path(scratch), sequences.NAMES)
    known = [*sequences.every(meshes), *hidden.every(meshes, sequences.ROUND)]
    every = {each.name: each for each in known}
    rows: list[Row] = []
    for name in chosen.names or every:
        film: Iterable[tuple[RgbdFrame, np.ndarray]] = seen(every[name], chosen.keep, strain)
        masks = None
        if chosen.masks:
            with tempfile.TemporaryDirectory() as scratch:
                film = list(film)
                masks = followed.masks(Path(scratch), every[name], film)
        made, times = judged.judge(every[name], film, icp=not chosen.no_icp, masks=masks)
        rows += made
        line = f"{summary(made, every[name])}  {1e3 * times.tracker:4.0f} ms, ICP {1e3 * times.icp:4.0f} ms"
        print(f"{name:16s} {line}", flush=True)
    print(f"{'all':16s} {summary(rows, None)}")
    print(covered(rows))
    print(wrong(rows))


def seen(sequence: Sequence, keep: Path | None, strain: Strain) -> Iterator[tuple[RgbdFrame, np.ndarray]]:
    """Frames with their labels, rendered or as they were kept."""
    still = sequence.name == RESTING
    if keep is None:
        yield from frames(sequence, still=still, strain=strain)
        return
    keep.mkdir(parents=True, exist_ok=True)
    film, labels = keep / f"{sequence.name}.film.zip", keep / f"{sequence.name}.npz"
    if not labels.exists():
        shown: list[np.ndarray] = []

        def noted() -> Iterator[RgbdFrame]:
            for frame, label in frames(sequence, still=still, strain=strain):
                shown.append(label.astype(np.uint8))
                yield frame

        RgbdVideo.write(keep / "raw.zip", CAMERA, noted(), depth_scale_m=0.0001).save(film)
        (keep / "raw.zip").unlink()
        np.savez_compressed(labels, labels=np.stack(shown))
    video = RgbdVideo.load(film)
    yield from zip(video.frames(), np.load(labels)["labels"], strict=True)


def summary(rows: list[Row], sequence: Sequence | None) -> str:
    """Recalls, the worst tracked pose, the longest search, and the drift of what rests."""
    symmetric = sequences.ROUND
    whole = [row for row in rows if row.seen >= VISIBLE]
    half = [row for row in rows if HALF <= row.seen < VISIBLE]
    told = [
        f"visible {len(whole)}: ADD-S {_recall([r.adds for r in whole], 0.02)} {_recall([r.adds for r in whole], 0.01)}"
    ]
    sided = [row.add for row in whole if row.name not in symmetric]
    if sided:
        told.append(f"ADD {_recall(sided, 0.02)} {_recall(sided, 0.01)}")
    if half:
        told.append(f"half {len(half)}: {_recall([row.adds for row in half], 0.02)}")
    said = [row.adds for row in rows if row.status == "tracked"]
    told.append(f"tracked {len(said) / len(rows):.3f}, worst {1e3 * max(said, default=np.nan):.1f} mm")
    told.append(f"found in {_search(rows):.2f} s")
    if any(np.isfinite(row.joint) for row in rows):
        told.append(f"joint {np.degrees(np.nanmedian([row.joint for row in rows])):.2f} deg")
    if sequence is not None and sequence.name == RESTING:
        told.append(f"drift {1e3 * drift(rows):.2f} mm")
    if np.isfinite([row.icp_adds for row in rows]).any():
        told.append(f"Open3D {_recall([row.icp_adds for row in whole], 0.02)}")
    return ", ".join(told)


def _recall(errors: list[float], limit: float) -> str:
    hits = int((np.array(errors) < limit).sum())
    low, high = wilson(hits, len(errors))
    return f"{hits / max(len(errors), 1):.3f} [{low:.2f} {high:.2f}]"


def _search(rows: list[Row]) -> float:
    """Longest time that an object was to be seen and had no tracked pose [s]."""
    longest = 0.0
    for key in {(row.sequence, row.name) for row in rows}:
        since = None
        for row in (each for each in rows if (each.sequence, each.name) == key):
            if row.seen < VISIBLE or row.status == "tracked":
                if since is not None:
                    longest = max(longest, row.time - since)
                since = None
            elif since is None:
                since = row.time
        if since is not None:
            longest = max(longest, rows[-1].time - since)
    return longest


def drift(rows: list[Row]) -> float:
    """Largest way of a reported position from that of the first second [m]."""
    worst = 0.0
    for name in {row.name for row in rows}:
        places = np.array([row.deviation[:3] for row in rows if row.name == name])
        worst = max(worst, float(np.linalg.norm(places - places[:5].mean(axis=0), axis=1).max()))
    return worst


def wrong(rows: list[Row]) -> str:
    """Tracked poses that are more than `WRONG_M` off, the first ten by name and time."""
    off = [row for row in rows if row.status == "tracked" and row.adds > WRONG_M]
    told = "".join(f", {row.sequence} {row.name} {row.time:.2f} s" for row in off[:10])
    return f"tracked poses that are more than 3 cm off: {len(off)}{told}"


def covered(rows: list[Row]) -> str:
    """Part of the tracked poses whose true position is inside the stated 95 % region."""
    inside, count = 0, 0
    for row in rows:
        if row.status == "tracked":
            away = row.deviation[:3]
            inside += bool(away @ np.linalg.solve(row.sigma[:3, :3], away) < 7.815)
            count += 1
    return f"95 % region of the position holds {inside / max(count, 1):.3f} of {count} tracked poses"


if __name__ == "__main__":
    main(sys.argv[1:])
