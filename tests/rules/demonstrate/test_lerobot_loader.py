"""A written data set opens in LeRobot's own loader, and its doctor finds no fault."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.tasks.episode import Episodes, Film
from dextera_build.testing import RuleRunner
from tests import episodes

pytestmark = pytest.mark.slow

READER = Path(__file__).with_name("lerobot_reader.py")
# The newest lerobot for Python 3.11 and the newest torchvision with a video reader. Installed without dependencies,
# because lerobot pins an older torch; these are the ones that its loader imports beyond what this project has.
PINS = (
    *("lerobot==0.4.4", "lerobot-doctor==0.2.0", "torchvision==0.25.0", "datasets==4.8.5", "pandas==2.3.3"),
    *("huggingface-hub==0.35.3", "accelerate==1.10.1", "safetensors", "psutil", "dill==0.4.1", "multiprocess==0.70.19"),
    *("xxhash", "requests", "httpx", "httpcore", "h11", "anyio", "sniffio", "idna", "certifi", "urllib3", "tqdm"),
    *("charset-normalizer", "filelock", "python-dateutil", "pytz", "tzdata", "six"),
)


@pytest.fixture(scope="module")
def lerobot(request: pytest.FixtureRequest) -> dict[str, str]:
    """Environment variables of a process that can import lerobot."""
    if importlib.util.find_spec("torch") is None:
        pytest.skip("torch is not installed")
    folder = Path(request.config.cache.mkdir("lerobot-0.4.4"))
    stamp = folder / "complete"
    if not stamp.exists() or stamp.read_text() != "\n".join(PINS):
        pip = [sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--upgrade", "--target", str(folder), *PINS]
        done = subprocess.run(pip, capture_output=True, text=True)
        if done.returncode:
            pytest.skip(f"lerobot 0.4.4 cannot be installed: {done.stderr.strip().splitlines()[-1]}")
        stamp.write_text("\n".join(PINS))
    return os.environ | {"PYTHONPATH": str(folder), "HF_HUB_OFFLINE": "1", "HF_HOME": str(folder / "home")}


@pytest.fixture(scope="module")
def made() -> Episodes:
    return episodes.small(4, 24, seed=1)


@pytest.fixture(scope="module")
def film(made: Episodes, tmp_path_factory: pytest.TempPathFactory) -> Film:
    runner = RuleRunner(tmp_path_factory.mktemp("film"))
    shot: Film = runner.run("demonstrate.film", bundle=episodes.bundle(), episodes=made, view=episodes.view(96, 64))
    return shot


@pytest.fixture(scope="module")
def folder(made: Episodes, film: Film, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data set cut into several files of both kinds."""
    written = RuleRunner(tmp_path_factory.mktemp("run")).run(
        "demonstrate.lerobot",
        options={"data_file_mb": 0.008, "video_file_mb": 0.01, "files_per_chunk": 2},
        bundle=episodes.bundle(),
        episodes=made,
        film=film,
    )
    assert sum(name.startswith("data/") for name in written.files) > 1
    assert sum(name.endswith(".mp4") for name in written.files) > 1
    root = tmp_path_factory.mktemp("set")
    written.export(root, "set")
    return root


@pytest.fixture(scope="module")
def found(lerobot: dict[str, str], folder: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, np.ndarray]:
    """What `lerobot_reader.py` saw of the data set."""
    out = tmp_path_factory.mktemp("items") / "items.npz"
    reader = [sys.executable, str(READER), str(folder), str(out)]
    done = subprocess.run(reader, env=lerobot, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    return dict(np.load(out))


def test_lerobot_reads_what_was_recorded(found: dict[str, np.ndarray], made: Episodes, film: Film) -> None:
    ordered = made.in_order()
    for key, field in (("observation.state", "joints"), ("action", "action")):
        np.testing.assert_array_equal(found[key], np.concatenate([getattr(e, field) for _, e in ordered]))
    boxes = np.concatenate([episode.objects[:, 0] for _, episode in ordered])
    np.testing.assert_array_equal(found["observation.environment_state"][:, :7], boxes)
    np.testing.assert_array_equal(found["index"], np.arange(96))
    np.testing.assert_array_equal(found["episode_index"], np.repeat(np.arange(4), 24))
    np.testing.assert_allclose(found["timestamp"], np.tile(np.arange(24) / 20, 4), atol=1e-6)
    assert set(found["task"]) == {"lift box"}
    actions = np.concatenate([episode.action for _, episode in ordered])
    np.testing.assert_allclose(found["mean"], actions.mean(axis=0), atol=1e-6)
    shown = np.concatenate([film.pixels(label) for label, _ in ordered])
    assert _psnr(found["pixels"], shown) > 28
    # Another frame of the same episode is farther away than the coding.
    assert _psnr(found["pixels"][10], shown[10]) > _psnr(found["pixels"][10], shown[14])


def test_lerobot_reads_windows_at_the_end_of_an_episode(
    found: dict[str, np.ndarray], made: Episodes, film: Film
) -> None:
    assert found["window_episode"] == 3
    last = made.items["3"].action[-1]
    np.testing.assert_array_equal(found["window"], [last, last, last])
    np.testing.assert_array_equal(found["padding"], [False, True, True])
    assert _psnr(found["window_pixels"], film.pixels("3")[-2:]) > 28


def test_the_doctor_finds_no_fault(lerobot: dict[str, str], folder: Path) -> None:
    doctor = [sys.executable, "-m", "lerobot_doctor.cli", "check", str(folder), "--json"]
    done = subprocess.run(doctor, env=lerobot, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-1000:]
    checks = {check["name"]: check["severity"] for check in json.loads(done.stdout)["checks"]}
    sound = ("Metadata & Format Compliance", "Temporal Consistency", "Video Integrity", "Feature Consistency")
    assert {checks[name] for name in (*sound, "Training Readiness", "Portability")} == {"PASS"}
    # What is made up here rests half the time and is short, of which it warns.
    assert set(checks.values()) <= {"PASS", "WARN"}


def _psnr(seen: np.ndarray, expected: np.ndarray) -> float:
    """Peak signal to noise [dB] of pictures (..., 3, H, W) in 0..1 against (..., H, W, 3) uint8."""
    error = np.moveaxis(seen, -3, -1) - expected / 255.0
    return float(-10 * np.log10(np.mean(error**2)))
