"""Actors that keep a loaded model on a cluster: which call goes to which, and when they end."""

from __future__ import annotations

from typing import Any

import pytest

from dextera_build.workers import ray_models
from dextera_build.workers.capacity import Needs
from dextera_build.workers.protocol import Task
from dextera_build.workers.ray_cluster import Amounts
from dextera_build.workers.ray_models import Models

NODES = [{"CPU": 8.0, "memory": 16.0, "GPU": 2.0}]
SMALL, LARGE = {"CPU": 1.0, "GPU": 0.5, "memory": 2.0}, {"CPU": 1.0, "GPU": 1.0, "memory": 2.0}


class Cluster:
    """Notes which actors live; a call is (actor, number)."""

    def __init__(self) -> None:
        self.alive: list[int] = []
        self.started = self.asked = 0

    def hold(self, reserved: Amounts) -> int:
        self.started += 1
        self.alive.append(self.started)
        return self.started

    def ask(self, actor: int, setup: Any, task: Task) -> tuple[int, int]:
        assert actor in self.alive
        self.asked += 1
        return actor, self.asked

    def end(self, actor: int) -> None:
        self.alive.remove(actor)


@pytest.fixture
def cluster() -> Cluster:
    return Cluster()


@pytest.fixture
def models(cluster: Cluster) -> Models:
    return Models(cluster)  # type: ignore[arg-type]


def task(weights: str = "") -> Task:
    return Task(0, "r", "b", {}, {}, "/", "/", "gpu", Needs(), weights=(weights,) if weights else ())


def test_calls_on_one_model_share_an_actor_unless_it_is_busy(models: Models, cluster: Cluster) -> None:
    first = models.begin(None, task("a"), SMALL)
    second = models.begin(None, task("a"), SMALL)
    assert first[0] != second[0]
    models.ended(first, lost=False)
    assert models.begin(None, task("a"), SMALL)[0] == first[0]
    models.ended(second, lost=False)
    assert models.begin(None, task("b"), SMALL)[0] not in cluster.alive[:2]
    assert models.begin(None, task("a"), LARGE)[0] == 4  # another reservation


def test_idle_actors_end_oldest_first_and_only_where_a_call_does_not_fit(models: Models, cluster: Cluster) -> None:
    calls = [models.begin(None, task(name), SMALL) for name in "abc"]
    for call in calls:
        models.ended(call, lost=False)
    models.make_room(task("c"), SMALL, [], NODES)
    models.make_room(task("d"), SMALL, [], NODES)
    models.make_room(task(), {"CPU": 8.0}, [], NODES)
    assert cluster.alive == [1, 2, 3]
    models.make_room(task("d"), LARGE, [], NODES)
    assert cluster.alive == [2, 3]
    models.make_room(task(), {"CPU": 1.0, "memory": 13.0}, [], NODES)
    assert cluster.alive == [3]
    models.begin(None, task("c"), SMALL)
    models.make_room(task("d"), LARGE, [SMALL], NODES[:0])
    assert cluster.alive == [3]  # busy


def test_an_actor_whose_call_was_lost_serves_no_other(models: Models, cluster: Cluster) -> None:
    call = models.begin(None, task("a"), SMALL)
    models.ended(call, lost=True)
    assert cluster.alive == []
    assert models.begin(None, task("a"), SMALL)[0] == 2


def test_idle_actors_end_after_a_while_and_all_at_the_end(
    models: Models, cluster: Cluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    models.ended(models.begin(None, task("a"), SMALL), lost=False)
    models.begin(None, task("b"), SMALL)
    models.end_stale()
    assert cluster.alive == [1, 2]
    monkeypatch.setattr(ray_models, "IDLE_S", -1.0)
    models.end_stale()
    assert cluster.alive == [2]
    models.stop()
    assert cluster.alive == []
