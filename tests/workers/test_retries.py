"""Which failures are tried again, how often, and what is said of it."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator, Mapping
from typing import Any

import pytest

from dextera_build.engine.graph import Graph
from dextera_build.engine.policy import RunPolicy
from dextera_build.engine.run import RunResult, build
from dextera_build.errors import ArtifactError, MachineError, RuleError
from dextera_build.runs.events import Event, NodeFinished, NodeRetried, NodeStarted
from dextera_build.store.backoff import backoff
from dextera_build.store.store import Store
from dextera_build.workers.capacity import Capacity
from dextera_build.workers.pool import LocalExecutor
from dextera_build.workers.retries import Retries, name_of, names_of
from tests.engine.inline import Emit, InlineExecutor
from tests.engine.tiny import RUNNER, Record, call, facts, graph, inline, out, run_task

QUICK = 0.01


class Flaky:
    """A runner that fails as often as it is told before it works."""

    def __init__(self, error: Exception, times: int) -> None:
        self.error, self.times, self.calls = error, times, 0

    def __call__(self, task: Mapping[str, Any], emit: Emit) -> Mapping[str, Any]:
        self.calls += 1
        if task["options"]["name"] == "shaky" and self.times > 0:
            self.times -= 1
            print("about to fail")
            raise self.error
        return run_task(task, emit)


def shaky(retries: Retries, **more: Any) -> Graph:
    return graph(call("shaky", rule=facts(retries=retries)), call("after", x=out("shaky")))


def run(plan: Graph, store: Store, executor: Any, **flags: Any) -> tuple[RunResult, Record]:
    record = Record()
    policy = RunPolicy(**flags)
    return build(plan, plan.targets["default"], store=store, executor=executor, listen=record, policy=policy), record


@pytest.mark.parametrize(
    "error",
    [ConnectionResetError("peer went away"), MachineError("no licence", code="DXB-E301")],
    ids=["on", "machine"],
)
def test_a_failure_that_counts_is_tried_again(store: Store, error: Exception) -> None:
    runner = Flaky(error, 2)
    result, record = run(shaky(Retries(2, ("ConnectionError",), QUICK)), store, InlineExecutor(runner))
    assert result.ok
    assert runner.calls == 4
    assert [(event.node, event.tries) for event in record.of(NodeRetried)] == [("shaky", 1), ("shaky", 2)]
    assert record.of(NodeRetried)[0].error["code"] in ("DXB-B302", "DXB-E301")
    assert [event.node for event in record.of(NodeStarted)] == ["shaky"] * 3 + ["after"]
    assert [event.tries for event in record.of(NodeFinished)] == [3, 1]
    assert (result.nodes["shaky"].tries, result.nodes["after"].tries) == (3, 1)


@pytest.mark.parametrize(
    ("error", "retries"),
    [
        (ConnectionResetError("x"), Retries(1, ("ConnectionError",), QUICK)),  # once more, and then no more
        (ConnectionResetError("x"), Retries(2, ("TimeoutError",), QUICK)),
        (ValueError("a fault of the rule"), Retries(2, ("ConnectionError",), QUICK)),
        (RuleError("a bad input", code="DXB-B202"), Retries(2, ("ConnectionError", "Exception"), QUICK)),
        (ArtifactError("a wrong shape"), Retries(2, ("Exception",), QUICK)),
        (ConnectionResetError("x"), Retries()),
    ],
)
def test_a_failure_that_does_not_count_ends_the_node(store: Store, error: Exception, retries: Retries) -> None:
    runner = Flaky(error, 9)
    result, record = run(shaky(retries), store, InlineExecutor(runner))
    allowed = retries.most if "ConnectionError" in retries.on and isinstance(error, ConnectionError) else 0
    assert not result.ok
    assert len(record.of(NodeRetried)) == allowed
    assert runner.calls == allowed + 1
    assert (result.nodes["shaky"].status, result.nodes["after"].status) == ("failed", "waits")


def test_retries_are_in_no_key(store: Store) -> None:
    first, _ = run(shaky(Retries()), store, inline())
    second, record = run(shaky(Retries(5, ("ConnectionError",))), store, inline())
    assert second.nodes["shaky"].key == first.nodes["shaky"].key
    assert record.of(NodeStarted) == []


@pytest.fixture
def pool() -> Iterator[LocalExecutor]:
    with LocalExecutor(RUNNER, Capacity(2, 4.0)) as executor:
        yield executor


def test_a_worker_that_died_is_one_of_them(store: Store, pool: LocalExecutor) -> None:
    plan = graph(call("dies", "kill", rule=facts(retries=Retries(1, wait_s=QUICK))))
    result, record = run(plan, store, pool)
    assert not result.ok
    (again,) = record.of(NodeRetried)
    assert again.error["code"] == "DXB-B301"
    assert again.log is not None
    assert store.blobs.get(again.log) == b"about to die\n"
    assert result.nodes["dies"].tries == 2


def test_an_exception_crosses_the_border_with_its_bases(store: Store, pool: LocalExecutor) -> None:
    plan = graph(call("bad", "crash", rule=facts(retries=Retries(1, ("ValueError",), QUICK))))
    result, record = run(plan, store, pool)
    assert (len(record.of(NodeRetried)), result.nodes["bad"].tries) == (1, 2)


def test_others_go_on_meanwhile_and_a_failure_ends_the_rest(store: Store) -> None:
    plan = graph(
        call("shaky", rule=facts(retries=Retries(1, ("ConnectionError",), 60))), call("bad", "fail"), call("good"),
        default=("shaky", "good", "bad"),
    )  # fmt: skip
    began = time.monotonic()
    result, _ = run(plan, store, InlineExecutor(Flaky(ConnectionResetError("x"), 9)))
    assert time.monotonic() - began < 25  # the rest would be half a minute at least
    assert [result.nodes[name].status for name in ("shaky", "good", "bad")] == ["cancelled", "ran", "failed"]


def test_the_rest_grows_and_is_spread_but_bounded() -> None:
    low, high = "00000000", "ffffffff"
    assert [backoff(tries, 2.0, low) for tries in (1, 2, 3)] == [1.0, 2.0, 4.0]
    assert [round(backoff(tries, 2.0, high), 3) for tries in (1, 2, 3)] == [2.0, 4.0, 8.0]
    assert backoff(40, 2.0, high) <= 60


def test_names_are_those_that_a_rule_would_write() -> None:
    assert name_of(ConnectionError) == "ConnectionError"
    assert names_of(ConnectionResetError()) == ["ConnectionResetError", "ConnectionError", "OSError", "Exception"]
    assert name_of(Flaky(ValueError(), 1).__class__) == f"{Flaky.__module__}.Flaky"  # type: ignore[arg-type]


@pytest.mark.slow
def test_another_build_may_make_what_rests(store: Store) -> None:
    """The lock of the key is free during the rest: a result that comes from elsewhere meanwhile is taken."""
    plan = shaky(Retries(1, ("ConnectionError",), 4.0))
    elsewhere: list[RunResult] = []

    def other() -> None:
        elsewhere.append(run(graph(call("shaky")), Store(store.root), inline())[0])

    def listen(event: Event) -> None:
        if isinstance(event, NodeRetried):
            threading.Thread(target=other).start()

    executor = InlineExecutor(Flaky(ConnectionResetError("x"), 9))
    result = build(plan, plan.targets["default"], store=store, executor=executor, listen=listen)
    assert [one.ok for one in elsewhere] == [True]
    assert result.ok
    assert result.nodes["shaky"].status == "cached"
