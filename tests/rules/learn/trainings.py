"""Trainings of imitation learning rules on the hand-made task, also such as are killed and resumed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dextera_build.artifacts.tasks.episode import Episode, Episodes, Film
from dextera_build.artifacts.tasks.mixture import Mixture
from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.learning import training
from dextera_build.policy.observation import Measurement, deployable
from dextera_build.rule import Context
from dextera_build.rule.pretrained import Device, Pretrained
from dextera_build.testing import RuleRunner
from tests import episodes
from tests.policy.policies import load

BUNDLE = episodes.bundle()
CUT_STEPS = 14
"""Steps of a training that is killed, three more than the last kill has seen."""
MIDDLE = np.array([0.3, -0.28])
"""Place of a box in the middle of a picture of `filmed` [m]; those of `episodes.small` are near it."""
FEW = {"steps": 3}
"""Of a training of which is asked what it read, and not what it learned."""


@dataclass(frozen=True)
class Trainings:
    """Trainings by one rule."""

    rule: str
    """`learn.act`."""
    small: Mapping[str, Any]
    """Options that make a training quick."""

    def learn(self, tmp_path: Path, data: Episodes | Mixture, backend: str = "torch", **more: Any) -> Checkpoint:
        """The policy of a training; `more` are options, and inputs of pictures."""
        film = {name: more.pop(name) for name in ("film", "films", "backdrop", "backdrops") if name in more}
        options = {**self.small, **more}
        made = RuleRunner(tmp_path, gpu_gb=80.0 if backend == "cuda" else 0.0).run(
            self.rule, backend=backend, bundle=BUNDLE, episodes=data, options=options, **film
        )
        assert isinstance(made, Checkpoint)
        return made

    def interrupted(
        self,
        folder: Path,
        data: Episodes,
        stop: int | None,
        monkeypatch: pytest.MonkeyPatch,
        device: Device = "cpu",
        **more: Any,
    ) -> tuple[Any, list[str]]:
        """The policy of a training, None if it was killed after `stop` steps, and its logged lines."""
        found = RuleRunner(folder).find(self.rule)
        monkeypatch.setattr(training, "SAVE_EVERY_S", 0.0)
        lines: list[str] = []

        def emit(kind: str, event: Mapping[str, object]) -> None:
            if kind == "log":
                lines.append(str(event["text"]))
            elif event["done"] == stop:
                raise Killed

        module = found.backends["torch"].module
        pretrained = Pretrained(device=device)
        ctx = Context(module, scratch=folder / "scratch", emit=emit, keep=folder / "keep", pretrained=pretrained)
        steps = min(self.small["steps"], CUT_STEPS)
        options = found.rule.options.model_validate({**self.small, "steps": steps, **more})
        film = {"film": filmed(data)} if "rgb" in more.get("inputs", ()) else {}
        try:
            return found.rule(ctx, BUNDLE, data, **film, options=options), lines
        except Killed:
            return None, lines

    def assert_resumes(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, device: Device = "cpu", **more: Any
    ) -> None:
        """A training that was killed three times ends with the same bytes and the same curve."""
        data = episodes.small(4)
        whole, _ = self.interrupted(tmp_path / "whole", data, None, monkeypatch, device, **more)
        for stop in (3, 7, 11):
            nothing, _ = self.interrupted(tmp_path / "cut", data, stop, monkeypatch, device, **more)
            assert nothing is None
        rest, lines = self.interrupted(tmp_path / "cut", data, None, monkeypatch, device, **more)
        assert lines[0] == "resumes after step 11"
        assert rest.weights == whole.weights
        assert rest.snapshots == whole.snapshots
        np.testing.assert_array_equal(rest.curve, whole.curve)
        np.testing.assert_array_equal(rest.steps, whole.steps)


class Killed(Exception):  # noqa: N818 - not an error
    """Stands for a signal that ends the process."""


def miss(made: Checkpoint, steps: int = 30) -> float:
    """How far the arm ends from the demonstrated joints, as a fraction of the swing.

    The median over swings to boxes that no training saw.
    """
    policy, missed = load(made, BUNDLE), []
    for seed in range(100, 106):
        shown = episodes.episode(steps, seed=seed)
        joints = sent = shown.start.ctrl
        policy.reset()
        for step in range(steps):
            seen = Measurement(joints, shown.objects[step], shown.displacement[step])
            joints = sent = policy.act(deployable(seen, sent, shown.goal))
        swing = np.abs(shown.joints[-1] - shown.joints[0]).max()
        missed.append(np.abs(joints - shown.joints[-1]).max() / swing)
    return float(np.median(missed))


def changed(count: int, steps: int, actions: np.ndarray, places: np.ndarray) -> Episodes:
    """Episodes that differ in `actions` [rad] of joint 1 and `places` [m] of the box along x, (count, steps) each."""
    data = episodes.small(count, steps)
    first, items = data.items["0"], {}
    for (name, one), sent, seen in zip(data.items.items(), actions, places, strict=True):
        objects = np.tile(first.objects[:1], (steps, 1, 1))
        objects[:, 0, 0] = seen
        action = np.tile(first.action[:1], (steps, 1))
        action[:, 0] = sent
        items[name] = episodes.observed(one.model_copy(update={"action": action}), objects=objects)
    return data.model_copy(update={"items": items})


def square(height: int, width: int, position: np.ndarray) -> tuple[slice, slice]:
    """Rows and columns of a picture where a box at `position` (2,) [m] is seen."""
    middle = (
        round(half + 100 * float(at)) for half, at in zip((height / 2, width / 2), position - MIDDLE, strict=True)
    )
    rows, columns = (slice(max(0, each - 4), max(0, each + 4)) for each in middle)
    return rows, columns


def filmed(data: Episodes, height: int = 32, width: int = 48) -> Film:
    """A film in which a bright square stands where the box is."""
    return Film(
        frames={name: _frames(one, height, width) for name, one in data.items.items()}, width=width, height=height
    )


def _frames(one: Episode, height: int, width: int) -> bytes:
    frames = np.zeros((len(one.action), height, width, 3), np.uint8)
    for frame, position in zip(frames, one.objects[:, 0, :2], strict=True):
        frame[square(height, width, position)] = 255
    assert frames.any(), "the box is in the picture"
    return Film.packed(frames)
