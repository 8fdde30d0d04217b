"""The workflows of the repository: what they type exists, and the steps of a release do what they say."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path
from typing import Any

import pytest
import yaml

from dextera_build.version import __version__

REPO = Path(__file__).parent.parent
WORKFLOWS = sorted((REPO / ".github/workflows").glob("*.yml"))
TAG = "The tag is the version"


def steps(workflow: Path) -> list[dict[str, Any]]:
    """The steps of every job of a workflow."""
    return [step for job in yaml.safe_load(workflow.read_text())["jobs"].values() for step in job["steps"]]


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """The files that the step about the tag reads, with this version in the changelog."""
    (tmp_path / "dextera_build").mkdir()
    version = REPO / "dextera_build/version.py"
    (tmp_path / "dextera_build/version.py").write_text(version.read_text())
    (tmp_path / "CHANGELOG.md").write_text(f"## [Unreleased]\n\n## [{__version__}] - 2026-01-31\n")
    return tmp_path


def code_of_tag_step(checkout: Path, tag: str) -> int:
    """Exit status of the release's step about the tag."""
    (step,) = (step for step in steps(REPO / ".github/workflows/release.yml") if step.get("name") == TAG)
    command = ["bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", step["run"]]
    return subprocess.run(command, cwd=checkout, env={"PATH": "/usr/bin:/bin", "GITHUB_REF_NAME": tag}).returncode


def test_a_tag_that_is_the_version_is_released(checkout):
    assert code_of_tag_step(checkout, f"v{__version__}") == 0


def test_another_tag_is_not_released(checkout):
    assert code_of_tag_step(checkout, f"v{__version__}.1") == 1


def test_a_version_without_its_section_in_the_changelog_is_not_released(checkout):
    (checkout / "CHANGELOG.md").write_text("## [Unreleased]\n")
    assert code_of_tag_step(checkout, f"v{__version__}") == 1


@pytest.mark.parametrize("workflow", WORKFLOWS, ids=lambda path: path.stem)
def test_targets_and_files_of_a_workflow_exist(workflow):
    text = "\n".join(step.get("run", "") for step in steps(workflow))
    targets = re.findall(r"\bmake ([a-z-]+)", text)
    known = set(re.findall(r"^([a-z-]+):", (REPO / "Makefile").read_text(), re.MULTILINE))
    assert set(targets) <= known
    scripts = re.findall(r"\bbash (\S+)", text)
    assert targets or scripts
    assert all((REPO / script).is_file() for script in scripts)
