"""What the tests of imitation learning rules share: runs, films, kills, and a swing to be learned."""

from __future__ import annotations

from collections.abc import Mapping
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
from dextera_build.testing import RuleRunner
from tests import episodes
from tests.policy.policies import load

BUNDLE = episodes.bundle()


def learn(
    rule: str, folder: Path, data: Episodes | Mixture, options: Mapping[str, Any], backend: str = "torch"
) -> Checkpoint:
    """The checkpoint of a rule; `options` may also have its `film` or `films`."""
    film = {name: options[name] for name in ("film", "films") if name in options}
    rest = {name: value for name, value in options.items() if name not in film}
    made = RuleRunner(folder).run(rule, backend=backend, bundle=BUNDLE, episodes=data, options=rest, **film)
    assert isinstance(made, Checkpoint)
    return made


def filmed(data: Episodes, height: int = 32, width: int = 48) -> Film:
    """A film in which a bright square stands where the box is."""
    return Film(
        frames={name: _frames(one, height, width) for name, one in data.items.items()}, width=width, height=height
    )


def _frames(one: Episode, height: int, width: int) -> bytes:
    frames = np.zeros((len(one.action), height, width, 3), np.uint8)
    for frame, position in zip(frames, one.objects[:, 0, :2], strict=True):
        row, column = (
            int(size / 2 + 100 * (value - 0.4)) for size, value in zip((height, width), position, strict=True)
        )
        frame[max(0, row - 4) : max(0, row + 4), max(0, column - 4) : max(0, column + 4)] = 255
    return Film.packed(frames)


class Killed(Exception):  # noqa: N818 - it stands for a signal
    """The process ends here."""


def interrupted(
    rule: str,
    folder: Path,
    data: Episodes,
    stop: int | None,
    monkeypatch: pytest.MonkeyPatch,
    options: Mapping[str, Any],
) -> tuple[Any, list[str]]:
    """A training that is killed after `stop` steps: its checkpoint, if it got that far, and its logged lines."""
    found = RuleRunner(folder).find(rule)
    monkeypatch.setattr(training, "SAVE_EVERY_S", 0.0)
    lines: list[str] = []

    def emit(kind: str, event: Mapping[str, object]) -> None:
        if kind == "log":
            lines.append(str(event["text"]))
        elif event["done"] == stop:
            raise Killed

    module = found.backends["torch"].module
    ctx = Context(module, scratch=folder / "scratch", emit=emit, keep=folder / "keep")
    film = {"film": filmed(data)} if "rgb" in options.get("inputs", ()) else {}
    try:
        return found.rule(ctx, BUNDLE, data, **film, options=found.rule.options.model_validate(options)), lines
    except Killed:
        return None, lines


def check_resumed(rule: str, folder: Path, monkeypatch: pytest.MonkeyPatch, options: Mapping[str, Any]) -> None:
    """Check that a training that was killed three times ends with the same bytes as one that was not."""
    data = episodes.small(4)
    whole, _ = interrupted(rule, folder / "whole", data, None, monkeypatch, options)
    for stop in (3, 7, 11):
        nothing, _ = interrupted(rule, folder / "cut", data, stop, monkeypatch, options)
        assert nothing is None
    rest, lines = interrupted(rule, folder / "cut", data, None, monkeypatch, options)
    assert lines[0] == "resumes after step 11"
    assert rest.weights == whole.weights
    np.testing.assert_array_equal(rest.curve, whole.curve)
    np.testing.assert_array_equal(rest.steps, whole.steps)


def missed(made: Checkpoint, steps: int = 30) -> float:
    """How far a policy that saw swings ends from where swings towards other boxes end, relative to their length."""
    policy, far = load(made, BUNDLE), list[float]()
    for seed in range(100, 106):
        shown = episodes.episode(steps, seed=seed)
        joints = sent = shown.start.ctrl
        policy.reset()
        for step in range(steps):
            seen = Measurement(joints, shown.objects[step], shown.displacement[step])
            joints = sent = policy.act(deployable(seen, sent, shown.goal))
        swing = np.abs(shown.joints[-1] - shown.joints[0]).max()
        far.append(float(np.abs(joints - shown.joints[-1]).max() / swing))
    return float(np.median(far))
