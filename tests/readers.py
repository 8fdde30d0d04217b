"""Programs of other projects, each in the environment that `make readers` makes for it."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

OPERATORS = """import torch

LIBRARY = torch.library.Library("torchvision", "DEF")
for name in ("nms", "qnms"):
    LIBRARY.define(f"{name}(Tensor dets, Tensor scores, float iou_threshold) -> Tensor")
"""
ENVIRONMENTS = Path(__file__).parent.parent / ".venv" / "readers"


def run(name: str, *arguments: str | Path) -> str:
    """What the Python of environment `name` prints with these arguments; the test is skipped if there is none."""
    process = started(name, *arguments)
    out, err = process.communicate()
    assert process.returncode == 0, out[-3000:] + err[-3000:]
    return out


def started(name: str, *arguments: str | Path) -> subprocess.Popen[str]:
    """A process of the Python of environment `name`; the test is skipped if there is none."""
    home = ENVIRONMENTS / name
    if not (home / ".installed").exists():
        pytest.skip(f"needs .venv/readers/{name}; `make readers` makes it")
    kept = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
    quiet = {"HF_HUB_OFFLINE": "1", "HF_HOME": str(home / "home"), "TF_CPP_MIN_LOG_LEVEL": "2"}
    command = [str(home / "bin" / "python"), *map(str, arguments)]
    return subprocess.Popen(command, env=kept | quiet, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def beside(name: str, folder: Path, *packages: str) -> Path:
    """`folder` with links to packages of environment `name`, for this Python; the test is skipped if there is none."""
    home = ENVIRONMENTS / name
    if not (home / ".installed").exists():
        pytest.skip(f"needs .venv/readers/{name}; `make readers` makes it")
    (theirs,) = (home / "lib").glob("python*/site-packages")
    folder.mkdir()
    for package in packages:
        (folder / package).symlink_to(theirs / package)
    return folder


def installed(project: Path, name: str, environment: str) -> None:
    """Make `.envs/NAME` of a project out of environment `environment`; the test is skipped if there is none.

    torchvision of these environments needs another torch. It is imported all the same once the two operators are
    declared that its CUDA build would bring.
    """
    home = ENVIRONMENTS / environment
    if not (home / ".installed").exists():
        pytest.skip(f"needs .venv/readers/{environment}; `make readers` makes it")
    folder = project / ".envs" / name
    subprocess.run([home / "bin" / "python", "-m", "venv", "--without-pip", folder], check=True)
    (packages,) = (folder / "lib").glob("python*/site-packages")
    (theirs,) = (home / "lib").glob("python*/site-packages")
    (packages / "theirs.pth").write_text(f"{theirs}\nimport operators\n")
    (packages / "operators.py").write_text(OPERATORS)
    (project / "envs").mkdir(exist_ok=True)
    (project / "envs" / f"{name}.lock").write_text(f"as in .ci/readers/{environment}.txt\n")


def read(name: str, script: str, data: Path, out: Path) -> dict[str, np.ndarray]:
    """The arrays that `script`, beside the tests of the rules, finds in `data` in environment `name`."""
    run(name, Path(__file__).parent / "rules" / "demonstrate" / script, data, out)
    return dict(np.load(out))


def psnr(seen: np.ndarray, expected: np.ndarray) -> float:
    """Peak signal to noise [dB] of pictures (..., 3, H, W) in 0..1 against (..., H, W, 3) uint8."""
    error = np.moveaxis(seen, -3, -1) - expected / 255.0
    return float(-10 * np.log10(np.mean(error**2)))
