"""Collection of random stores agrees with a model, also while builds use the store."""

from __future__ import annotations

import tempfile
import time
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dextera_build import digest
from dextera_build.gc import inventory
from dextera_build.gc.choose import Limits
from dextera_build.gc.collect import Collection, collect
from dextera_build.store.last_use import Use
from dextera_build.store.store import Store
from tests.store.stores import (
    DAY,
    age,
    age_all,
    assert_whole,
    entry,
    harm,
    held,
    key_of,
    keys,
    publish,
)


@dataclass
class World:
    """A planned store: results with last use and blobs, unreferenced blobs, held results, limits."""

    results: dict[str, tuple[int, list[int]]]
    loose: dict[int, int]
    broken: set[str]
    roots: set[str]
    size: int | None
    days: int | None
    building: bool
    meanwhile: list[tuple[str, str, list[int]]] = field(default_factory=list)


NAMES = [f"r{n}" for n in range(6)]
BLOBS = st.lists(st.integers(0, 7), max_size=4)
DAYS = st.integers(0, 5)
WORLDS = st.builds(
    World,
    results=st.dictionaries(st.sampled_from(NAMES), st.tuples(DAYS, BLOBS), max_size=6),
    loose=st.dictionaries(st.integers(0, 11), DAYS, max_size=4),
    broken=st.sets(st.sampled_from(NAMES), max_size=2),
    roots=st.sets(st.sampled_from(NAMES), max_size=3),
    size=st.none() | st.integers(0, 9000),
    days=st.none() | DAYS,
    building=st.booleans(),
    meanwhile=st.lists(
        st.tuples(st.sampled_from(["hit", "publish"]), st.sampled_from([*NAMES, "new"]), BLOBS), max_size=5
    ),
)


def data_of(number: int) -> bytes:
    return b"%d" % number * (200 * (number + 1))


def make(world: World, store: Store) -> None:
    now = time.time()
    for name, (_, blobs) in world.results.items():
        publish(store, name, map(data_of, blobs))
    for number in world.loose:
        store.blobs.put(data_of(number))
    age_all(store, now - 4.5 * DAY)
    for number, days in world.loose.items():
        age(store.blobs.path(digest.of_bytes(data_of(number))), now - days * DAY - 1)
    for name, (days, _) in world.results.items():
        age(entry(store, key_of(name)), now - days * DAY - 1)
        if name in world.broken:
            harm(entry(store, key_of(name)), b"torn")
            age(entry(store, key_of(name)), now - days * DAY - 1)


def model(world: World, store: Store) -> tuple[set[str], set[str]]:
    """(keys, blobs) that stay, by brute force: each step recomputes everything."""
    found, now = inventory.read(store), time.time()
    horizon = now - 3660
    alive = dict(found.results)
    named = {name for one in (*found.results.values(), *found.broken.values()) for name in one.needs}

    def blobs() -> set[str]:
        needed = {name for one in alive.values() for name in one.needs}
        late = {n for n, (_, used) in found.blobs.items() if used >= horizon and (world.building or n not in named)}
        return (needed | late) & set(found.blobs)

    def total() -> int:
        return sum(one.size for one in alive.values()) + sum(found.blobs[name][0] for name in blobs())

    free = [key for key in alive if key not in {key_of(root) for root in world.roots}]
    for key in sorted(free, key=lambda key: (alive[key].used, key)):
        used = alive[key].used
        if world.building and used >= horizon:
            continue
        too_old = world.days is not None and used < now - world.days * DAY
        if too_old or (world.size is not None and total() > world.size):
            del alive[key]
    return set(alive), blobs()


def take(world: World, store: Store, *, dry: bool = False) -> Collection:
    since = None if world.days is None else time.time() - world.days * DAY
    return collect(store, held(*map(key_of, world.roots)), Limits(world.size, since), dry=dry)


@pytest.mark.slow
@settings(max_examples=150, deadline=None)
@given(world=WORLDS)
def test_a_collection_agrees_with_the_model(world: World) -> None:
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        store = Store(Path(folder) / "store")
        make(world, store)
        if world.building:
            stack.enter_context(store.running.announced())
        expected = model(world, store)
        planned = take(world, store, dry=True)
        said = take(world, store)
        assert (keys(store), {name for name, _ in store.blobs.all()}) == expected
        assert_whole_untouched(store)
        assert said.after == planned.after == inventory.read(store).bytes()
        again = take(world, store)
        assert not again.gone


def assert_whole_untouched(store: Store) -> None:
    """As `assert_whole`, without lookups, which would count as uses."""
    assert inventory.read(store).broken == {}


@pytest.mark.slow
@settings(max_examples=150, deadline=None)
@given(world=WORLDS)
def test_what_a_build_does_meanwhile_stays_whole(world: World) -> None:
    with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        store = Store(Path(folder) / "store")
        make(world, store)
        relied: set[str] = set()

        def act(what: str, name: str, blobs: list[int]) -> None:
            if what == "publish":
                relied.add(publish(store, name, map(data_of, blobs)))
            elif store.actions.get(key_of(name)) is not None:
                relied.add(key_of(name))

        things = iter([lambda row=row: act(*row) for row in world.meanwhile])
        drop = Use.drop

        def disturbed(use: Use, path: str, older_than: float) -> bool:
            next(things, lambda: None)()
            return drop(use, path, older_than)

        patch.setattr(Use, "drop", disturbed)
        with store.running.announced():
            take(world, store)
            assert relied <= keys(store)
            assert_whole(store)
