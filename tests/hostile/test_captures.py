"""Bad captures made from one good photograph of a mug: each answer names the cause, as an error or as a warning."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from dextera_build.artifacts.base import Folder
from dextera_build.errors import DxbError
from dextera_build.testing import RuleRunner
from tests import factories

CAPTURE = Path(__file__).parents[3] / "shared" / "captures" / "table_blue_mug"
pytestmark = pytest.mark.skipif(not CAPTURE.is_dir(), reason="needs shared/captures/table_blue_mug")

MUG = np.s_[62:165, 115:212]
"""Rows and columns around the mug and its shadow [px]."""
Files = dict[str, bytes]


def png(pixels: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, format="PNG")
    return buffer.getvalue()


def npy(values: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, values)
    return buffer.getvalue()


def good(step: int) -> tuple[np.ndarray, np.ndarray, dict]:
    """Colours (H, W, 3) uint8, counts (H, W) uint16 and `capture.json`, of every `step`-th row and column."""
    rgb = np.array(Image.open(CAPTURE / "rgb.png").convert("RGB"))[::step, ::step]
    counts = np.array(Image.open(CAPTURE / "depth.png")).astype(np.uint16)[::step, ::step]
    told = json.loads((CAPTURE / "capture.json").read_text())
    lens = {name: told[name] / step for name in ("fx", "fy", "cx", "cy")}
    return rgb, counts, {**told, **lens, "width": rgb.shape[1], "height": rgb.shape[0]}


def capture(
    *,
    rgb: Callable[[np.ndarray], np.ndarray] = lambda pixels: pixels,
    depth: Callable[[np.ndarray], np.ndarray] | None = lambda counts: counts,
    metres: Callable[[np.ndarray], np.ndarray] | None = None,
    drop: str = "",
    step: int = 2,
    **facts: object,
) -> Files:
    """The good capture with something changed."""
    pixels, counts, told = good(step)
    told = {key: value for key, value in {**told, **facts}.items() if key != drop}
    files = {"rgb.png": png(np.ascontiguousarray(rgb(pixels))), "capture.json": json.dumps(told).encode()}
    if metres is not None:
        files["depth.npy"] = npy(metres((counts * 1e-4).astype(np.float32)))
    elif depth is not None:
        files["depth.png"] = png(np.ascontiguousarray(depth(counts)))
    return files


def answer(tmp_path: Path, files: Files) -> str:
    """Everything that is said from the folder to the elements: warnings, and the error with facts and hint."""
    runner, said = RuleRunner(tmp_path), []

    def run(rule: str, **inputs: object) -> object:
        value = runner.run(rule, **inputs)
        said.extend(runner.outcome.warnings)
        return value

    try:
        shot = factories.shot(run("capture.folder", folder=Folder(files=files)))
        support = run("align.support", **shot)
        elements = run("factorize.parse", **shot, support=support)
        run("factorize.segment", **shot, support=support, elements=elements)
    except DxbError as error:
        said.extend(runner.outcome.warnings if runner.outcome else [])
        said.append(f"{error.message} {error.facts} {error.hint}")
    return "\n".join(said)


def without(name: str) -> Files:
    return {key: data for key, data in capture().items() if key != name}


def holes(counts: np.ndarray) -> np.ndarray:
    rng, left = np.random.default_rng(5), counts.copy()
    while (left == 0).mean() < (counts == 0).mean() + 0.3:
        side = int(rng.integers(6, 23))
        row, column = rng.integers(0, np.array(counts.shape) - side)
        left[row : row + side, column : column + side] = 0
    return left


def blind(counts: np.ndarray) -> np.ndarray:
    left = counts.copy()
    left[MUG] = 0
    return left


def noise(counts: np.ndarray) -> np.ndarray:
    return np.random.default_rng(2).integers(4000, 12000, counts.shape).astype(np.uint16)


def wall(counts: np.ndarray) -> np.ndarray:
    return (8000 + np.random.default_rng(4).normal(0, 10, counts.shape)).astype(np.uint16)


def eight_bit(counts: np.ndarray) -> np.ndarray:
    return (counts / counts.max() * 255).astype(np.uint8)


def dropout(counts: np.ndarray) -> np.ndarray:
    return np.where(np.random.default_rng(1).random(counts.shape) < 0.5, 0, counts).astype(np.uint16)


NAN = float("nan")
CASES: dict[str, tuple[Callable[[], Files], str]] = {
    "empty folder": (dict, "`rgb.png` is missing"),
    "no depth": (lambda: capture(depth=None), "`depth.png` is missing"),
    "no depth, no scale": (lambda: capture(depth=None, drop="depth_scale_m"), "the capture has no depth"),
    "no capture.json": (lambda: without("capture.json"), "`capture.json` is missing"),
    "broken capture.json": (lambda: {**capture(), "capture.json": b'{"width": 640,'}, "is not valid JSON"),
    "truncated photograph": (lambda: {**capture(), "rgb.png": capture()["rgb.png"][:30_000]}, "`rgb.png` is truncated"),
    "depth of zeros": (lambda: capture(depth=np.zeros_like), "holds no valid depth"),
    "sizes differ": (lambda: capture(depth=lambda counts: counts[::2, ::2]), "160 x 120 px"),
    "intrinsics of another size": (lambda: capture(width=1280, height=720), "1280 x 720 px"),
    "no scale": (lambda: capture(drop="depth_scale_m"), "the depth has no scale"),
    "scale is a word": (lambda: capture(depth_scale_m="mm"), "the depth has no scale"),
    "scale is NaN": (lambda: capture(depth_scale_m=NAN), "`depth_scale_m` is nan"),
    "scale 1": (lambda: capture(depth_scale_m=1.0), "the depth's unit is not plausible"),
    "scale 1e-5": (lambda: capture(depth_scale_m=1e-5), "the depth's unit is not plausible"),
    "npy in millimetres": (lambda: capture(metres=lambda m: m * 1000), "`depth.npy` holds metres"),
    "npy of integers": (
        lambda: capture(metres=lambda m: (m * 1000).astype(np.uint16)),
        "must hold one number of metres",
    ),
    "npy with NaN": (lambda: capture(metres=lambda m: np.where(m > 0, m, np.nan)), "holds NaN or infinite depth"),
    "8 bit": (lambda: capture(depth=eight_bit), "it was reduced to 8 bit"),
    "8 bit, scaled": (lambda: capture(depth=eight_bit, depth_scale_m=0.0035), "has 8 bit, so its depths are steps of"),
    "8 bit in 16 bit": (
        lambda: capture(depth=lambda counts: eight_bit(counts).astype(np.uint16) * 257, depth_scale_m=0.0035 / 257),
        "was it reduced to 8 bit?",
    ),
    "ten times too far": (lambda: capture(depth_scale_m=0.001), "may be too large, e.g. by a factor of 10"),
    "four times too near": (lambda: capture(depth_scale_m=0.000025), "may be too small, e.g. by a factor of 10"),
    "fx NaN": (lambda: capture(fx=NAN), "`fx` is nan"),
    "fx infinite": (lambda: capture(fx=float("inf")), "`fx` is inf"),
    "cx NaN": (lambda: capture(cx=NAN), "`cx` is nan"),
    "fx of 1.2 px": (lambda: capture(fx=1.2), "`fx` is not plausible"),
    "fx and fy doubled": (lambda: capture(fx=616.35, fy=616.2), "a field of view of 29 deg"),
    "upside down": (
        lambda: capture(rgb=lambda p: p[::-1, ::-1], depth=lambda c: c[::-1, ::-1], cx=163.9, cy=120.7),
        "up is taken to be the bottom of the picture",
    ),
    "portrait": (
        lambda: capture(rgb=np.rot90, depth=np.rot90, width=240, height=320, fx=308.1, fy=308.2, cx=118.3, cy=163.9),
        "up is taken to be the left of the picture",
    ),
    "half of the depth missing": (lambda: capture(depth=dropout), "of the depth is missing amid measured pixels"),
    "holes": (lambda: capture(depth=holes), "of the depth is missing amid measured pixels"),
    "noise": (lambda: capture(depth=noise), "the depth is noise: neighbouring pixels differ by"),
    "a wall seen frontally": (lambda: capture(depth=wall), "the support is seen frontally, as a wall is"),
    "object without depth": (lambda: capture(depth=blind), "a region of the support has no depth, box ["),
    "object cut by the right border": (
        lambda: capture(rgb=lambda p: p[:, :166], depth=lambda c: c[:, :166], width=166),
        "the border of the picture cuts the thing",
    ),
    "object cut by the lower border": (
        lambda: capture(rgb=lambda p: p[:119], depth=lambda c: c[:119], height=119),
        "the border of the picture cuts the thing found there",
    ),
    "not registered": (
        lambda: capture(depth=lambda c: np.roll(c, 30, 1), step=1),
        "register the depth to the colour camera",
    ),
}


@pytest.mark.medium
@pytest.mark.parametrize("case", CASES)
def test_the_answer_names_the_cause(case, tmp_path):
    files, words = CASES[case]
    assert words in answer(tmp_path, files())


@pytest.mark.medium
@pytest.mark.parametrize(
    "files",
    [
        capture,
        lambda: capture(rgb=lambda p: np.repeat(p.mean(-1, keepdims=True), 3, -1).astype(np.uint8)),
        lambda: capture(metres=lambda m: m.astype(np.float64)),
    ],
    ids=["as it is", "grey", "npy of doubles"],
)
def test_nothing_is_said_of_a_good_capture(files, tmp_path):
    assert answer(tmp_path, files()) == ""
