"""What an operator saw, and what the recording of it becomes: the same, bit for bit."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from dextera_build.artifacts.robots.hand_stream import HandStream
from dextera_build.artifacts.tasks.episode import Episode, Episodes
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.sim.experts.drive import Driver
from dextera_build.testing import RuleRunner


@contextmanager
def watched(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[Episode]]:
    """Successful episodes of sessions, in order, as their operators saw them."""
    found: list[Episode] = []
    run = Driver.run

    def kept(self: Driver, *words: Any, **named: Any) -> Episode:
        episode = run(self, *words, **named)
        found.extend([episode] if episode.success else [])
        return episode

    with monkeypatch.context() as patch:
        patch.setattr(Driver, "run", kept)
        yield found


def assert_same(
    runner: RuleRunner, bundle: TaskBundle, recording: HandStream, seen: list[Episode], **options: Any
) -> None:
    """Build the episodes of a recording, and compare them with those that were seen."""
    made = runner.run("demonstrate.operate", backend="hands", bundle=bundle, recording=recording, options=options)
    assert isinstance(made, Episodes)
    assert len(made.items) == len(recording.takes) == len(seen)
    for replayed, was in zip(made.items.values(), seen, strict=True):
        assert differences(replayed, was) == []


def followed(runner: RuleRunner, bundle: TaskBundle, recording: HandStream, **options: Any) -> Episode:
    """What the only take of a recording becomes, successful or not."""
    made = runner.run(
        "demonstrate.operate",
        backend="hands",
        bundle=bundle,
        recording=recording,
        options={"attempts": 1} | options,
    )
    (episode,) = (*made.items.values(), *made.failures.values())
    assert isinstance(episode, Episode)
    return episode


def differences(one: Episode, other: Episode) -> list[str]:
    """Arrays of two episodes that are not the same, bit for bit."""
    both = [
        {name: getattr(each, name) for name in ("action", "executed", "hand")} | each.terms for each in (one, other)
    ]
    assert both[0].keys() == both[1].keys()
    return [name for name, values in both[0].items() if values.tobytes() != both[1][name].tobytes()]
