"""A tree of traces: a call is found iff one that was recorded would read the same today."""

from __future__ import annotations

import tempfile
from pathlib import Path

from hypothesis import given, settings
from hypothesis import strategies as st

from dextera_build import digest
from dextera_build.store.entry import ActionResult
from dextera_build.store.store import Store
from dextera_build.store.traces import steps as traces
from dextera_build.store.traces import tree
from dextera_build.store.traces.steps import Steps
from tests.store.stores import entry

_STATIC = {"rule": "tiny.rule", "inputs": [], "read": []}
_FILES = ("a", "b", "c", "d")
World = dict[str, str]


def _content(name: str, value: int) -> str:
    return digest.of_bytes(f"{name} {value}".encode())


def _run(program: int, world: World) -> Steps:
    """A call that chooses by all that it was told what it asks next, or that it knows enough."""
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
    tree.publish(store, document, ActionResult(output, "", (), {}, 1.0, None, document))
    return output


def _find(store: Store, world: World) -> tree.Found:
    return tree.find(store, _STATIC, lambda kind, name: world[name])


_WORLDS = st.fixed_dictionaries(
    {name: st.integers(0, 1).map(lambda n, name=name: _content(name, n)) for name in _FILES}
)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 50), st.lists(_WORLDS, min_size=1, max_size=8))
def test_a_hit_iff_a_recorded_run_would_read_the_same(program: int, worlds: list[World]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        store = Store(Path(folder))
        recorded: dict[Steps, str] = {}
        for world in worlds:
            steps = _run(program, world)
            found = _find(store, world)
            assert (found.held.result.output if found.held else None) == recorded.get(steps)
            if found.held is None:
                assert steps[: len(found.steps)] == found.steps
                recorded[steps] = _publish(store, steps)
            assert _find(store, world).held is not None


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 50), st.lists(st.tuples(_WORLDS, st.integers(0, 30)), min_size=2, max_size=8))
def test_what_is_lost_or_damaged_is_a_miss_and_comes_back(program: int, rounds: list[tuple[World, int]]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        store = Store(Path(folder))
        for world, dice in rounds:
            steps = _run(program, world)
            found = _find(store, world)
            if found.held is not None:
                assert found.steps == steps
            output = _publish(store, steps)
            assert _find(store, world).held.result.output == output  # type: ignore[union-attr]
            keys = sorted(store.actions.keys())
            victim = entry(store, keys[dice % len(keys)])
            victim.unlink()


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
            assert _find(stores[0], world).held is not None


def test_a_call_that_asks_in_another_order_takes_the_place_of_the_old_way(tmp_path: Path) -> None:
    store, world = Store(tmp_path), {name: _content(name, 0) for name in _FILES}
    first = tuple(("file", name, world[name]) for name in "abc")
    other = tuple(("file", name, world[name]) for name in "acb")
    shorter = first[:2]
    for steps in (first, other, shorter, first):
        output = _publish(store, steps)
        found = _find(store, world)
        assert found.held is not None
        assert found.held.result.output == output


def test_a_call_that_read_nothing_has_its_result_at_the_root(tmp_path: Path) -> None:
    store = Store(tmp_path)
    assert _find(store, {}).held is None
    output = _publish(store, ())
    assert _find(store, {}).held.result.output == output  # type: ignore[union-attr]


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
        [],
        "there",
        [[1, 2, 3]],
    ]
    for number, steps in enumerate(hostile):
        store = Store(tmp_path / str(number))
        document = store.blobs.put(traces.spelled(_STATIC, ()))
        header = store.blobs.put(digest.canonical({"artifact": "Reads", "fields": {"steps": steps}}))
        store.actions.put(document, ActionResult(header, "", (), {}, 0.0, None, document))
        assert tree.find(store, _STATIC, answer).held is None
        # What runs then is found again.
        _publish(store, (("there", "a", traces.YES),))
        assert tree.find(store, _STATIC, answer).held is not None
    assert set(asked) <= {"a"}


def test_a_result_holds_on_to_the_way_that_leads_to_it(tmp_path: Path) -> None:
    store = Store(tmp_path)
    worlds = [
        {name: _content(name, int(sign)) for name, sign in zip("ab", signs, strict=True)} for signs in ("00", "01")
    ]
    for world in worlds:
        steps = tuple(("file", name, world[name]) for name in "ab")
        key = digest.of_bytes(traces.spelled(_STATIC, steps))
        _publish(store, steps)
        found = store.actions.entry(key)
        assert found is not None
        assert digest.of_bytes(traces.spelled(_STATIC, ())) in {file.digest for file in found.files}
