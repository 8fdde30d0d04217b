"""Random changes to a good bundle: it is imported unchanged or refused with one error, without side effects."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dextera_build.bundle import importer, layout, sign
from dextera_build.bundle.errors import BundleRefused
from dextera_build.digest import of_bytes
from dextera_build.engine.graph import Graph
from dextera_build.store.store import Store
from tests.bundle.conftest import bundle, small
from tests.bundle.forge import Forgery, Raw, packed, unpacked
from tests.engine.tiny import run

JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=6,
)
pytestmark = pytest.mark.slow
CASES = int(os.environ.get("DXB_FUZZ", "50"))
SETTINGS = settings(
    max_examples=CASES, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A good signed bundle, as `good` and `good.tar`, beside its store."""
    root = tmp_path_factory.mktemp("fuzz")
    (root / "photo.bin").write_bytes(b"photo")
    plan: Graph = small(root / "photo.bin")
    store = Store(root / "store")
    run(plan, store)
    made = bundle(store, plan, "full")
    sign.generate(root / "key", "anna")
    made.attach(sign.seal(made.digest, root / "key")[0])
    made.write(root / "good.tar")
    unpacked(root / "good.tar")
    return root


def take(path: Path, root: Path) -> bool:
    """Whether a bundle was imported into a new store; asserts the invariants."""
    path = packed(path)
    shutil.rmtree(root / "other", ignore_errors=True)
    other = Store(root / "other")
    outside = {file for file in root.rglob("*") if not file.is_relative_to(other.root)}
    error = None
    try:
        opened = importer.open_bundle(layout.Layout(path))
        sign.judge(opened, sign.trusted([root / "key.pub"]))
        importer.take(opened, other)
    except BundleRefused as refused:
        error = refused
    if error is not None:
        assert error.code.startswith("DXB-S3")
        assert "\n" not in error.message
        assert list(other.actions.keys()) == []
    assert {file for file in root.rglob("*") if not file.is_relative_to(other.root)} == outside
    assert all(of_bytes(other.blobs.path(digest).read_bytes()) == digest for digest, _ in other.blobs.all())
    mine = Store(root / "store")
    for key in other.actions.keys():  # noqa: SIM118 - a method, not a mapping
        theirs = other.actions.get(key)
        assert theirs is not None  # with all of its blobs
        assert theirs.output == mine.actions.get(key).output  # type: ignore[union-attr]
    return error is None


@SETTINGS
@given(data=st.data())
def test_bytes_of_an_archive(place, data):
    good = (place / "good.tar").read_bytes()
    start = data.draw(st.integers(0, len(good) - 1))
    end = data.draw(st.integers(start, min(len(good), start + 2000)))
    bad = good[:start] + data.draw(st.binary(max_size=64)) + good[end:]
    (place / "bad.tar").write_bytes(bad)
    take(place / "bad.tar", place)


@SETTINGS
@given(data=st.data())
def test_values_of_the_documents(place, data):
    """The digests are correct, so a refusal is due to the documents' content."""
    shutil.rmtree(place / "bad", ignore_errors=True)
    shutil.copytree(place / "good", place / "bad")
    forged = Forgery(place / "bad")
    which = data.draw(st.sampled_from(["config", "manifest", "result"]))

    def change(raw: Raw) -> None:
        mutate(raw, data)

    if which == "config":
        forged.edit_config(change)
    elif which == "manifest":
        forged.edit_manifest(change)
    else:
        forged.edit_result("scene", change)
    take(forged.write(), place)


@SETTINGS
@given(header=JSON.map(lambda raw: {"artifact": "Text", "fields": raw}) | JSON)
def test_outputs(place, header):
    from dextera_build.digest import canonical

    shutil.rmtree(place / "bad", ignore_errors=True)
    shutil.copytree(place / "good", place / "bad")
    forged = Forgery(place / "bad")
    forged.replace_output("scene", canonical(header))
    assert not take(forged.write(), place)  # even a valid header does not refer to the old one's blobs


def mutate(raw: Raw, data: st.DataObject) -> None:
    """Replace, remove or duplicate one value."""
    here: object = raw
    while True:
        steps = list(here) if isinstance(here, dict) else list(range(len(here))) if isinstance(here, list) else []
        if not steps:
            return
        step = data.draw(st.sampled_from(steps))
        inner = here[step]  # type: ignore[index]
        if isinstance(inner, dict | list) and inner and data.draw(st.booleans()):
            here = inner
            continue
        kind = data.draw(st.sampled_from(["replace", "remove", "double"]))
        if kind == "replace":
            here[step] = data.draw(JSON)  # type: ignore[index]
        elif kind == "remove":
            del here[step]  # type: ignore[attr-defined]
        elif isinstance(here, list):
            here.append(inner)
        else:
            here[f"{step}x"] = inner  # type: ignore[index]
        return


def test_the_good_one_is_taken(place):
    assert take(place / "good.tar", place)
    assert take(place / "good", place)
