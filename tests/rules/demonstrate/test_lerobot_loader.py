"""A written data set opens in LeRobot's own loader, and its doctor finds no fault."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.tasks.episode import Episodes, Film
from dextera_build.testing import RuleRunner
from tests import episodes, readers

pytestmark = pytest.mark.slow


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


@pytest.fixture(scope="module", params=["lerobot-0.4", "lerobot-0.6"])
def found(
    folder: Path, tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest
) -> dict[str, np.ndarray]:
    """What `lerobot_reader.py` saw of the data set."""
    return readers.read(request.param, "lerobot_reader.py", folder, tmp_path_factory.mktemp("items") / "items.npz")


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
    assert readers.psnr(found["pixels"], shown) > 28
    # Another frame of the same episode is farther away than the coding.
    assert readers.psnr(found["pixels"][10], shown[10]) > readers.psnr(found["pixels"][10], shown[14])


def test_lerobot_reads_windows_at_the_end_of_an_episode(
    found: dict[str, np.ndarray], made: Episodes, film: Film
) -> None:
    assert found["window_episode"] == 3
    last = made.items["3"].action[-1]
    np.testing.assert_array_equal(found["window"], [last, last, last])
    np.testing.assert_array_equal(found["padding"], [False, True, True])
    assert readers.psnr(found["window_pixels"], film.pixels("3")[-2:]) > 28


def test_the_doctor_finds_no_fault(folder: Path) -> None:
    said = readers.run("lerobot-0.4", "-m", "lerobot_doctor.cli", "check", folder, "--json")
    checks = {check["name"]: check["severity"] for check in json.loads(said)["checks"]}
    sound = ("Metadata & Format Compliance", "Temporal Consistency", "Video Integrity", "Feature Consistency")
    assert {checks[name] for name in (*sound, "Training Readiness", "Portability")} == {"PASS"}
    # What is made up here rests half the time and is short, of which it warns.
    assert set(checks.values()) <= {"PASS", "WARN"}
