"""Wheel and sdist: what is in them, and that each works alone in an environment without the heavy packages."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import numpy as np
import pytest
import yaml
from PIL import Image

pytestmark = pytest.mark.slow  # `make package` runs it, and CI that

REPO = Path(__file__).parent.parent.parent
LOCK = REPO / ".ci" / "requirements.lock"
RECIPE = """summary: One light rule on a photograph.
inputs:
  capture: capture
nodes:
  photo: {rule: capture.folder, folder: $capture}
  bright: {rule: shade.brighten, image: $photo.photograph.rgb, gain: 1.5}
"""


@pytest.fixture(scope="session")
def built(tmp_path_factory):
    """Folder with the sdist, and the wheel that was made from it."""
    folder = tmp_path_factory.mktemp("dist")
    # As a release does it.
    release = yaml.safe_load((REPO / ".github/workflows/release.yml").read_text())["jobs"]["build"]["steps"]
    (line,) = (step["run"] for step in release if "-m build" in step.get("run", ""))
    assert line.startswith(".venv/bin/python ")
    command = [sys.executable, *line.split()[1:], "--outdir", str(folder), str(REPO)]
    subprocess.run(command, check=True, capture_output=True, text=True)
    return folder


@pytest.fixture(scope="session")
def wheel_names(built):
    (wheel,) = built.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        return set(archive.namelist())


@pytest.fixture(scope="session")
def sdist_names(built):
    (sdist,) = built.glob("*.tar.gz")
    with tarfile.open(sdist) as archive:
        return {name.partition("/")[2] for name in archive.getnames()}


def files(folder: str) -> set[str]:
    """Files below a folder of the checkout, caches left out."""
    found = {path.relative_to(REPO) for path in (REPO / folder).rglob("*") if path.is_file()}
    return {
        p.as_posix() for p in found if not any(part == "__pycache__" or part.endswith("_cache") for part in p.parts)
    }


def test_the_wheel_installs_one_package_and_nothing_beside_it(wheel_names):
    top = {name.split("/")[0] for name in wheel_names}
    assert {name for name in top if not name.endswith(".dist-info")} == {"dextera_build"}


@pytest.mark.parametrize("kind", ["rules", "recipes"])
def test_the_wheel_bundles_every_rule_and_recipe(wheel_names, kind):
    wanted = {f"dextera_build/_bundled/{name}" for name in files(kind)}
    assert wanted
    assert wanted - wheel_names == set()


def test_the_wheel_holds_all_data_of_the_package(wheel_names):
    assert "dextera_build/py.typed" in wheel_names
    assert files("dextera_build") - wheel_names == set()
    assert any(name.startswith("dextera_build/report/assets/") for name in wheel_names)
    assert "dextera_build/docs/index.md" in wheel_names


def test_the_wheel_carries_its_licence(wheel_names):
    assert any(name.endswith(".dist-info/licenses/LICENSE") for name in wheel_names)


def test_the_sdist_can_be_developed_in(sdist_names):
    wanted = files("dextera_build") | files("rules") | files("recipes") | files("tests") | files("examples")
    wanted |= {"Makefile", "README.md", "LICENSE", "CHANGELOG.md", "pyproject.toml", "cache/README.md"}
    wanted |= {".ci/run", ".ci/system", ".ci/lock.py", ".ci/requirements.lock", ".importlinter", ".gitignore"}
    assert wanted - sdist_names == set()


class Alone:
    """An environment that has one distribution and its light dependencies, and an empty folder to work in."""

    def __init__(self, folder: Path, distribution: Path) -> None:
        self.bin = folder / "venv" / "bin"
        self.work = folder / "work"
        self.work.mkdir(parents=True)
        subprocess.run([sys.executable, "-m", "venv", str(folder / "venv")], check=True)
        self.run("python", "-m", "pip", "install", "--quiet", "--constraint", str(LOCK), str(distribution))

    def run(self, program: str, *words: str) -> str:
        """Standard output of a program of this environment; its errors show in the assertion."""
        kept = {name: value for name, value in os.environ.items() if not name.startswith(("DXB_", "PYTHON", "VIRTUAL"))}
        done = subprocess.run([self.bin / program, *words], cwd=self.work, env=kept, capture_output=True, text=True)
        assert done.returncode == 0, f"{program} {' '.join(words)}\n{done.stdout}\n{done.stderr}"
        return done.stdout


@pytest.fixture(scope="module", params=["*.whl", "*.tar.gz"], ids=["wheel", "sdist"])
def alone(request, built, tmp_path_factory):
    (distribution,) = built.glob(request.param)
    return Alone(tmp_path_factory.mktemp("alone"), distribution)


def write_capture(folder: Path) -> None:
    """A capture of 8 x 6 px, all at one metre."""
    folder.mkdir()
    Image.fromarray(np.full((6, 8, 3), 100, np.uint8)).save(folder / "rgb.png")
    Image.fromarray(np.full((6, 8), 1000, np.uint16)).save(folder / "depth.png")
    facts = {"width": 8, "height": 6, "fx": 8.0, "fy": 8.0, "cx": 3.5, "cy": 2.5, "depth_scale_m": 0.001}
    (folder / "capture.json").write_text(json.dumps(facts))


@pytest.mark.slow
def test_it_works_alone(alone):
    assert alone.run("dxb", "--version").startswith("dxb ")
    rules = alone.run("dxb", "ls", "rules")
    assert "capture.folder" in rules
    assert "twin/laptop_scene" in alone.run("dxb", "ls")
    assert not (alone.bin.parent / "lib" / f"python3.{sys.version_info.minor}" / "site-packages" / "rules").exists()

    alone.run("dxb", "init", ".")
    alone.run("dxb", "new", "rule", "shade.brighten")
    write_capture(alone.work / "capture")
    (alone.work / "recipes" / "bright.yaml").write_text(RECIPE)
    alone.run("dxb", "build", "bright", "--profile", "stub")
    (picture,) = alone.run("dxb", "get", "bright:bright", "--out", "out").splitlines()
    pixels = np.asarray(Image.open(alone.work / picture))
    assert (pixels == 150).all()
