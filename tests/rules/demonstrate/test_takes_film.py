"""A film of takes by hand: the robot's hands at their targets and the operator's are in the picture."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.base import Artifact
from dextera_build.artifacts.cameras.video import Video
from dextera_build.artifacts.robots.hand_stream import HandStream
from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.errors import RuleError
from dextera_build.sim.render import ghosts
from dextera_build.testing import RuleRunner
from tests import hand_tasks
from tests.robots.robot_recipes import built

pytestmark = pytest.mark.slow
OPTIONS = {"first": 1, "width_px": 320, "rate_hz": 5.0}


@pytest.fixture(scope="module")
def runner(tmp_path_factory: pytest.TempPathFactory) -> RuleRunner:
    return RuleRunner(tmp_path_factory.mktemp("rules"))


@pytest.fixture(scope="module")
def shown(runner: RuleRunner, tmp_path_factory: pytest.TempPathFactory) -> tuple[TaskBundle, Episodes, HandStream]:
    """A task, what a program demonstrates of it by hand, and its hands."""
    bundle = hand_tasks.lift_can(runner, built("kuka_leap", tmp_path_factory.mktemp("robot")), [])
    with pytest.MonkeyPatch.context() as patch:
        _, hands = hand_tasks.shown(runner, bundle, patch)
    episodes = runner.run(
        "demonstrate.operate", backend="hands", bundle=bundle, recording=hands, options={"attempts": 1}
    )
    return bundle, episodes, hands


def filmed(runner: RuleRunner, *shown: Artifact) -> np.ndarray:
    """Pictures (T, H, W, 3) of a film."""
    bundle, episodes, hands = shown
    film = runner.run("demonstrate.takes_film", bundle=bundle, episodes=episodes, recording=hands, options=OPTIONS)
    assert isinstance(film, Video)
    (episode,) = episodes.items.values()  # type: ignore[attr-defined]
    assert len(film.stamps) == -(-len(episode.joints) // round(episodes.rate_hz / 5.0))  # type: ignore[attr-defined]
    return film.frames(range(len(film.stamps))).astype(int)


def test_a_film_shows_targets_and_the_operators_hand(
    runner: RuleRunner, shown: tuple[TaskBundle, Episodes, HandStream], monkeypatch: pytest.MonkeyPatch
) -> None:
    pictures = filmed(runner, *shown)
    assert pictures.shape[1:] == (240, 320, 3)
    with monkeypatch.context() as patch:
        patch.setattr(ghosts, "add_links", lambda *words: None)
        without = filmed(runner, *shown)
    # The robot's hand at its targets is blue, and on every picture.
    changed = (np.abs(pictures - without).max(axis=-1) > 20).reshape(len(pictures), -1).sum(axis=1)
    assert (changed > 50).all()
    with monkeypatch.context() as patch:
        patch.setattr(ghosts, "add_skeleton", lambda *words: None)
        without = filmed(runner, *shown)
    changed = (np.abs(pictures - without).max(axis=-1) > 20).reshape(len(pictures), -1).sum(axis=1)
    assert (changed > 10).mean() > 0.3


def test_episodes_of_another_recording_are_refused(
    runner: RuleRunner, shown: tuple[TaskBundle, Episodes, HandStream], tmp_path: Path
) -> None:
    bundle, episodes, hands = shown
    (episode,) = episodes.items.values()
    foreign = episodes.model_copy(update={"items": {"00007": episode}})
    with pytest.raises(RuleError, match="not those of the recording's takes"):
        runner.run("demonstrate.takes_film", bundle=bundle, episodes=foreign, recording=hands, options=OPTIONS)
