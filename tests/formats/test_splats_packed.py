"""Gaussians in the formats of web viewers, read back by what their specifications say."""

from __future__ import annotations

import gzip
import struct
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.shapes.splats import Splats
from dextera_build.errors import ArtifactError

C0 = 0.28209479177387814


def gaussians(count: int, degree: int = 1) -> Splats:
    rng = np.random.default_rng(3)
    turns = rng.normal(size=(count, 4))
    return Splats(
        means=rng.uniform(-2, 2, (count, 3)).astype(np.float32),
        rotations=(turns / np.linalg.norm(turns, axis=1, keepdims=True)).astype(np.float32),
        scales=np.exp(rng.uniform(-6, -2, (count, 3))).astype(np.float32),
        opacities=rng.uniform(0.1, 1, count).astype(np.float32),
        harmonics=rng.uniform(-0.9, 0.9, (count, (degree + 1) ** 2, 3)).astype(np.float32),
    )


def test_splat_holds_32_bytes_each_and_the_largest_come_first(tmp_path: Path) -> None:
    made = gaussians(50)
    (path,) = made.save(tmp_path / "room.splat")
    data = path.read_bytes()
    assert len(data) == 50 * 32
    rows = [struct.unpack("<6f8B", data[start : start + 32]) for start in range(0, len(data), 32)]
    sizes = [row[3] * row[4] * row[5] * row[9] for row in rows]
    assert all(one >= other * 0.98 for one, other in pairwise(sizes))
    for row in rows:
        number = int(np.argmin(np.linalg.norm(made.means - np.array(row[:3]), axis=1)))
        assert np.allclose(row[3:6], made.scales[number])
        colour = np.clip(0.5 + C0 * made.harmonics[number, 0], 0, 1)
        assert np.abs(np.array(row[6:9]) / 255 - colour).max() <= 0.5 / 255 + 1e-6
        assert abs(row[9] / 255 - made.opacities[number]) <= 0.5 / 255 + 1e-6
        assert np.abs((np.array(row[10:14]) - 128) / 128 - made.rotations[number]).max() <= 1 / 128


@pytest.mark.parametrize("degree", [0, 1, 3])
def test_spz_holds_every_column_within_its_rounding(tmp_path: Path, degree: int) -> None:
    made, count = gaussians(40, degree), 40
    (path,) = made.save(tmp_path / "room.spz")
    data = gzip.decompress(path.read_bytes())
    magic, version, points, stored, bits, flags, _ = struct.unpack("<IIIBBBB", data[:16])
    assert (magic, version, points, stored, bits, flags) == (0x5053474E, 2, count, degree, 12, 0)
    body = np.frombuffer(data, np.uint8, offset=16).astype(np.int64)
    rest = (degree + 1) ** 2 - 1
    ends = np.cumsum([9 * count, count, 3 * count, 3 * count, 3 * count, 3 * rest * count])
    places, opacities, colours, scales, turns, harmonics = np.split(body, ends[:-1])
    assert len(body) == ends[-1]
    steps = places.reshape(-1, 3) @ np.array([1, 256, 65536])
    means = np.where(steps >= 2**23, steps - 2**24, steps).reshape(-1, 3) / 4096
    assert np.abs(means - made.means).max() <= 0.5 / 4096 + 1e-6
    assert np.abs(opacities / 255 - made.opacities).max() <= 0.5 / 255 + 1e-6
    first = (colours.reshape(-1, 3) / 255 - 0.5) / 0.15
    assert np.abs(first - made.harmonics[:, 0]).max() <= 0.5 / 255 / 0.15 + 1e-6
    assert np.abs(scales.reshape(-1, 3) / 16 - 10 - np.log(made.scales)).max() <= 0.5 / 16 + 1e-5
    axes = turns.reshape(-1, 3) / 127.5 - 1
    turned = np.c_[np.sqrt(np.maximum(0, 1 - (axes**2).sum(axis=1))), axes]
    # w is found from the others, so it is the less certain the smaller it is.
    assert (np.abs((turned * made.rotations).sum(axis=1)) > 0.99).all()
    higher = (harmonics.reshape(count, rest, 3) - 128) / 128
    assert rest == 0 or np.abs(higher - made.harmonics[:, 1:]).max() <= 8.5 / 128


def test_what_spz_cannot_place_is_refused(tmp_path: Path) -> None:
    made = gaussians(3)
    far = made.model_copy(update={"means": made.means + np.float32(3000)})
    with pytest.raises(ArtifactError, match="cannot be written as SPZ"):
        far.save(tmp_path / "far.spz")


def test_a_package_opens_as_a_stage_with_all_gaussians(tmp_path: Path) -> None:
    usd = pytest.importorskip("pxr.Usd")
    made = gaussians(20)
    (path,) = made.save(tmp_path / "room.usdz")
    stage = usd.Stage.Open(str(path))
    assert len(stage.GetDefaultPrim().GetAttribute("positions").Get()) == 20
    assert Splats.load(path).means.shape == (20, 3)
