"""Traces of a call: a result is found if and only if a recorded run would read the same now."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dextera_build import digest
from dextera_build.errors import RuleError
from dextera_build.gc.choose import Limits
from dextera_build.gc.collect import collect
from dextera_build.store import traces
from dextera_build.store.entry import ActionResult
from dextera_build.store.results import Found
from dextera_build.store.store import Store
from dextera_build.store.traces import Steps
from tests.store.stores import DAY, age_all, entry, held

_STATIC = {"rule": "tiny.rule", "inputs": [], "read": None}
_FILES = ("a", "b", "c", "d")
World = dict[str, str]


def find(store: Store, answer: traces.Answer) -> tuple[traces.Steps | None, Found | None]:
    """The matching trace and its result, looked up as a build does."""
    steps = traces.fitting(store, _STATIC, answer)
    held = store.actions.find(digest.of_bytes(traces.spelled(_STATIC, steps))) if steps is not None else None
    return (steps, held) if held is not None else (None, None)


def _content(name: str, value: int) -> str:
    return digest.of_bytes(f"{name} {value}".encode())


def _run(program: int, world: World) -> Steps:
    """A call whose next question, or end, depends on all answers so far."""
    told: list[tuple[str, str, str]] = []
    while len(told) < len(_FILES):
        dice = int(digest.of_value([program, told])[:8], 16)
        left = [name for name in _FILES if name not in {name for _, name, _ in told}]
        if dice % 5 == 0:
            break
        name = left[dice % len(left)]
        told.append(("file", name, world[name]))
    return tuple(told)


def _publish(store: Store, steps: Steps) -> str:
    document = store.blobs.put(traces.spelled(_STATIC, steps))
    output = store.blobs.put(digest.canonical({"artifact": "Text", "fields": {"text": repr(steps)}}))
    traces.publish(store, document, ActionResult(output, "", (), {}, 1.0, None, document))
    return output


def _find(store: Store, world: World) -> Found | None:
    return find(store, lambda kind, name: world[name])[1]


_WORLDS = st.fixed_dictionaries(
    {name: st.integers(0, 1).map(lambda n, name=name: _content(name, n)) for name in _FILES}
)


@pytest.mark.medium
@settings(max_examples=40, deadline=None)
@given(st.integers(0, 50), st.lists(_WORLDS, min_size=1, max_size=8))
def test_a_hit_iff_a_recorded_run_would_read_the_same(program: int, worlds: list[World]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        store = Store(Path(folder))
        recorded: dict[Steps, str] = {}
        for world in worlds:
            steps = _run(program, world)
            found = _find(store, world)
            assert (found.result.output if found else None) == recorded.get(steps)
            if found is None:
                recorded[steps] = _publish(store, steps)
            assert _find(store, world) is not None


@pytest.mark.medium
@settings(max_examples=30, deadline=None)
@given(st.integers(0, 50), st.lists(st.tuples(_WORLDS, st.integers(0, 30)), min_size=2, max_size=8))
def test_what_is_lost_or_damaged_is_a_miss_and_comes_back(program: int, rounds: list[tuple[World, int]]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        store = Store(Path(folder))
        for world, dice in rounds:
            steps = _run(program, world)
            found = _find(store, world)
            if found is not None:
                assert find(store, lambda kind, name, world=world: world[name])[0] == steps
            output = _publish(store, steps)
            assert _find(store, world).result.output == output  # type: ignore[union-attr]
            keys = sorted(store.actions.keys())
            victim = entry(store, keys[dice % len(keys)])
            victim.unlink()


@pytest.mark.slow
@settings(max_examples=30, deadline=None)
@given(st.integers(0, 50), st.lists(_WORLDS, min_size=1, max_size=5), st.lists(_WORLDS, min_size=1, max_size=5))
def test_two_stores_that_give_all_to_one_another_find_the_same(
    program: int, here: list[World], there: list[World]
) -> None:
    with tempfile.TemporaryDirectory() as folder:
        stores = [Store(Path(folder) / name) for name in ("one", "two")]
        for store, worlds in zip(stores, (here, there), strict=True):
            for world in worlds:
                _publish(store, _run(program, world))
        for world in there:
            _publish(stores[0], _run(program, world))
        for world in [*here, *there]:
            assert _find(stores[0], world) is not None


def test_of_two_traces_that_fit_the_newest_counts(tmp_path: Path) -> None:
    store, world = Store(tmp_path), {name: _content(name, 0) for name in _FILES}
    first = tuple(("file", name, world[name]) for name in "abc")
    other = tuple(("file", name, world[name]) for name in "acb")
    shorter = first[:2]
    for steps in (first, other, shorter, first):
        output = _publish(store, steps)
        found = _find(store, world)
        assert found is not None
        assert found.result.output == output


def test_the_oldest_traces_are_forgotten(tmp_path: Path) -> None:
    store = Store(tmp_path)
    worlds = [{"a": _content("a", number)} for number in range(traces._MOST + 3)]
    for world in worlds:
        _publish(store, (("file", "a", world["a"]),))
    assert [_find(store, world) is not None for world in worlds] == [False] * 3 + [True] * traces._MOST


def test_long_traces_take_no_more_room_than_one_may(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(traces, "_MOST_STEPS", 5)
    one, two = (tuple(("there", f"{name}{number}", traces.NO) for number in range(3)) for name in "ab")
    assert traces.merged([one], [two]) == [one]
    assert traces.merged([one], [two[:2]]) == [one, two[:2]]


def test_a_trace_that_two_builders_wrote_over_is_a_miss(tmp_path: Path) -> None:
    """Promise: a race may cost one more run, but never gives a wrong answer."""
    store = Store(tmp_path)
    world, other = ({"a": _content("a", number)} for number in (0, 1))
    _publish(store, (("file", "a", world["a"]),))
    path = entry(store, digest.of_bytes(traces.spelled(_STATIC, None)))
    before = path.read_bytes()
    output = _publish(store, (("file", "a", other["a"]),))
    assert _find(store, other).result.output == output  # type: ignore[union-attr]
    path.unlink()
    path.write_bytes(before)
    assert _find(store, other) is None
    assert _find(store, world) is not None


def test_a_question_that_cannot_be_asked_fits_nothing(tmp_path: Path) -> None:
    def answer(kind: str, name: str) -> str:
        raise RuleError("no", code="DXB-B351")

    store = Store(tmp_path)
    _publish(store, (("file", "a", _content("a", 0)),))
    assert find(store, answer)[1] is None


def test_a_call_that_read_nothing_is_found(tmp_path: Path) -> None:
    store = Store(tmp_path)
    assert _find(store, {}) is None
    output = _publish(store, ())
    assert _find(store, {}).result.output == output  # type: ignore[union-attr]


def test_steps_that_no_call_can_have_made_are_a_miss(tmp_path: Path) -> None:
    asked: list[str] = []

    def answer(kind: str, name: str) -> str:
        asked.append(name)
        return traces.YES

    hostile = [
        [["file", "../../etc/passwd", traces.NONE]],
        [["file", "/etc/passwd", traces.NONE]],
        [["names", "a/../../*", "0" * 64]],
        [["there", "a", "perhaps"]],
        [["run", "a", traces.YES]],
        [["there", "a"]],
        "there",
        [[1, 2, 3]],
        5,
    ]
    for number, steps in enumerate(hostile):
        store = Store(tmp_path / str(number))
        document = store.blobs.put(traces.spelled(_STATIC, None))
        header = store.blobs.put(digest.canonical({"artifact": "Reads", "fields": {"traces": [steps]}}))
        store.actions.put(document, ActionResult(header, "", (), {}, 0.0, None, document))
        assert find(store, answer)[1] is None
        # The run that follows is found again.
        _publish(store, (("there", "a", traces.YES),))
        assert find(store, answer)[1] is not None
    assert set(asked) <= {"a"}


def test_a_result_holds_on_to_the_list_that_leads_to_it(tmp_path: Path) -> None:
    store = Store(tmp_path)
    world = {name: _content(name, 0) for name in "ab"}
    steps = tuple(("file", name, world[name]) for name in "ab")
    _publish(store, steps)
    age_all(store, time.time() - 9 * DAY)
    collect(store, held(digest.of_bytes(traces.spelled(_STATIC, steps))), Limits(size=0), dry=False)
    assert _find(store, world) is not None
