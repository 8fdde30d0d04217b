"""A policy of another project, which trains and acts in a process of its own environment."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path
from typing import Any

import numpy as np

from dextera_build.policy.layout import Layout
from dextera_build.policy.observation import DeployableObservation
from tests.readers import ENVIRONMENTS

HERE = Path(__file__).parent


class Peer:
    """A policy for `closed_loop`; used as a context, it ends its process.

    Args:
        name: Environment below `.venv/readers`, and start of the name of its program here.
        setting: What the program is told, as a file in `folder`.
        layout: The world's layout.
        folder: For the setting, and for what the program prints.
    """

    def __init__(self, name: str, setting: dict[str, Any], layout: Layout, folder: Path) -> None:
        file = folder / f"{name}.json"
        file.write_text(json.dumps(setting))
        self._layout = layout
        kept = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
        self._log = folder / f"{name}.log"
        with self._log.open("w") as log:
            self._process = subprocess.Popen(
                [ENVIRONMENTS / name / "bin" / "python", HERE / f"{name}_peer.py", file],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=log,
                env=kept,
                text=True,
            )
        self.facts: dict[str, Any] = self._answer()
        """What it said about its training."""

    def __enter__(self) -> Peer:
        return self

    def __exit__(self, *caught: object) -> None:
        self._process.communicate()

    def reset(self) -> None:
        """Begin an episode."""
        self._ask("")

    def act(self, observation: DeployableObservation) -> np.ndarray:
        """Joint targets (A,) [rad]."""
        return np.array(self._ask(json.dumps(by_feature(self._layout, observation))))

    def _ask(self, line: str) -> Any:
        assert self._process.stdin is not None
        self._process.stdin.write(line + "\n")
        self._process.stdin.flush()
        return self._answer()

    def _answer(self) -> Any:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            raise RuntimeError(f"the peer ended with {self._process.wait()}:\n{self._log.read_text()[-3000:]}")
        return json.loads(line)


def by_feature(layout: Layout, observation: DeployableObservation) -> dict[str, list[float]]:
    """The numbers of an observation as data sets group them: feature -> those of its terms, in order."""
    seen: dict[str, list[float]] = {}
    for term in layout.terms():
        if term.feature.startswith("observation."):
            seen.setdefault(term.feature, []).extend(np.ravel(observation[term.declared.name]).tolist())
    return seen
