"""Parsers under values and bytes that no program of ours wrote: each reads them, or refuses with its one error.

`DXB_FUZZ` sets how many cases the slow tests try.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dextera_build.artifacts.base import Artifact, Collection, File, Folder
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.table import Table
from dextera_build.bundle import importer, layout, oci, sign
from dextera_build.bundle.closure import read_result
from dextera_build.bundle.config import Contents
from dextera_build.bundle.errors import BundleRefused
from dextera_build.digest import canonical, of_bytes
from dextera_build.errors import ArtifactError, DxbError, RecipeError, StoreError
from dextera_build.project import lockfile
from dextera_build.project.project import Project
from dextera_build.recipe import schema, strict_yaml
from dextera_build.recipe.plan import plan
from dextera_build.recipe.settings import parse as parse_setting
from dextera_build.store import entry as entries
from dextera_build.store import headers
from dextera_build.store.references import UNREADABLE
from dextera_build.store.store import Store
from tests.bundle.conftest import bundle, small
from tests.bundle.forge import unpacked
from tests.engine.tiny import run
from tests.hostile.values import PLAIN, mutate, torn
from tests.recipe.conftest import RECIPE
from tests.store.stores import forged

CHECKS = [HealthCheck.function_scoped_fixture, HealthCheck.too_slow, HealthCheck.data_too_large]
FEW = settings(max_examples=15, deadline=None, suppress_health_check=CHECKS)
MANY = settings(FEW, max_examples=int(os.environ.get("DXB_FUZZ", "500")))


@dataclass(frozen=True)
class Good:
    """Documents that dxb itself wrote."""

    project: Project
    documents: dict[str, bytes]
    entry: bytes


@pytest.fixture(scope="module")
def good(project, tmp_path_factory) -> Good:
    root = tmp_path_factory.mktemp("good")
    (root / "photo.bin").write_bytes(b"photo")
    graph, store = small(root / "photo.bin"), Store(root / "store")
    result, _ = run(graph, store)
    made = bundle(store, graph, "full")
    sign.generate(root / "key", "anna")
    signature, _ = sign.seal(made.digest, root / "key")
    made.attach(signature)
    made.write(root / "bundle.tar")
    opened = importer.open_bundle(layout.Layout(root / "bundle.tar"))
    key = result.nodes["scene"].key or ""
    found = store.actions.get(key)
    entry = store.actions.entry(key)
    assert found is not None
    assert entry is not None
    documents = {
        "index": (unpacked(root / "bundle.tar") / "index.json").read_bytes(),
        "manifest": opened.manifest.spell(),
        "config": opened.contents.spell(),
        "signature": signature,
        "result": found.document,
    }
    return Good(Project(project.root), documents, entry.spell())


Check = Callable[[Good, st.DataObject, Path], None]
FUZZ: dict[str, Check] = {}


def fuzz(check: Check) -> Check:
    FUZZ[check.__name__] = check
    return check


WORDS = st.sampled_from(
    [
        *("$start", "$words", "$word", "$matrix.a", "$", "$.", "$start.data", "$word.louder", "$nothing"),
        *("toy.start", "toy.split", "toy.shout", "toy.join", "toy.spoken", "say/words", "x", "quiet", "", "..", "a.b"),
    ]
)
NAMES = st.sampled_from(
    [
        *("summary", "extends", "inputs", "nodes", "targets", "rule", "recipe", "each", "as", "matrix", "overrides"),
        *("start", "words", "word", "text", "texts", "times", "more", "backend", "salt", "default", "help", "a", "B"),
    ]
)
PARTS = st.recursive(
    WORDS | st.integers() | st.booleans() | st.none() | st.floats(allow_nan=False, allow_infinity=False),
    lambda inner: st.dictionaries(NAMES, inner, max_size=4) | st.lists(inner, max_size=3),
    max_leaves=12,
)


def planned(good: Good, text: str, folder: Path) -> None:
    """Read and resolve a recipe."""
    file = folder / "x.yaml"
    file.write_text(text, encoding="utf-8", errors="surrogatepass")
    recipe = schema.read(file, "x")
    plan("x", lambda address: recipe if address == "x" else None, good.project.library, good.project.root)


def only(error: type[DxbError] | tuple[type[DxbError], ...], work: Callable[[], object]) -> None:
    """Carry out `work`, which may raise nothing but these."""
    code = "DXB-A000"
    try:
        work()
    except error as raised:
        code = raised.code
    assert re.fullmatch("DXB-[A-Z][0-9]{3}", code)


@fuzz
def recipes_of_known_words(good, data, folder):
    parts = data.draw(st.fixed_dictionaries({"nodes": st.dictionaries(NAMES, PARTS, max_size=4)}) | PARTS)
    only(DxbError, lambda: planned(good, json.dumps(parts), folder))


@fuzz
def recipes_with_one_value_changed(good, data, folder):
    parts = strict_yaml.parse(RECIPE, "x").plain()
    mutate(parts, data)
    only(DxbError, lambda: planned(good, json.dumps(parts), folder))


@fuzz
def recipes_that_were_torn(good, data, folder):
    text = torn(RECIPE.encode(), data).decode(errors="replace")
    only(DxbError, lambda: planned(good, text, folder))


@fuzz
def text_as_yaml(good, data, folder):
    text = data.draw(st.text(st.characters(codec="utf-8") | st.sampled_from("[]{}:,&*!|>'\"%@`#-? \n\t"), max_size=60))
    only(RecipeError, lambda: strict_yaml.parse(text, "x"))


@fuzz
def settings_of_one_option(good, data, folder):
    text = data.draw(st.text(st.sampled_from("ab[].=:$'\"{}1 \n\\"), max_size=24) | st.text(max_size=24))
    only(DxbError, lambda: parse_setting(text))


TOML = (
    b'cache = "cache"\njobs = 2\nprofile = "cpu"\n[resources]\nmemory = 8\n'
    b'[remotes.lab]\naddress = "/lab"\nmode = "r"\n'
)
LOCK = f'version = 1\n[cpu."a/b:c"]\nkey = "{"0" * 64}"\noutput = "{"1" * 64}"\nsize = 3\n'.encode()


@fuzz
def settings_that_were_torn(good, data, folder):
    (folder / "dxb.toml").write_bytes(torn(TOML, data))
    read = Project(folder)
    only(DxbError, lambda: (read.config, read.jobs, read.cache, read.trusted_keys, read.remotes.used, read.durable))


@fuzz
def locks_that_were_torn(good, data, folder):
    (folder / "dxb.lock").write_bytes(torn(LOCK, data))
    only(RecipeError, lambda: lockfile.read(folder / "dxb.lock"))


READERS: dict[str, Callable[[bytes], object]] = {
    "index": oci.read_index,
    "manifest": oci.Manifest.read,
    "config": Contents.read,
    "signature": sign.read_signature,
    "result": lambda text: read_result(text, "a"),
}


@fuzz
def documents_of_a_bundle(good, data, folder):
    name = data.draw(st.sampled_from(sorted(READERS)))
    text = good.documents[name]
    if data.draw(st.booleans()):
        parts = json.loads(text)
        mutate(parts, data)
        text = json.dumps(parts).encode()
    else:
        text = torn(text, data)
    only((BundleRefused, StoreError), lambda: READERS[name](text))


TAGS = st.sampled_from(["$ref", "$bytes", "$array", "$map", "$value", "$"])
FIELDS = st.recursive(
    PLAIN,
    lambda inner: st.dictionaries(TAGS, inner, min_size=1, max_size=1) | st.lists(inner, max_size=4),
    max_leaves=6,
)
KINDS: tuple[type[Artifact], ...] = (File, Folder, Image, Table, Camera, Collection[File])


@fuzz
def headers_of_artifacts(good, data, folder):
    kind = data.draw(st.sampled_from(KINDS))
    names = st.sampled_from([*kind.model_fields, "more"])
    fields = data.draw(st.dictionaries(names, FIELDS, max_size=4) | FIELDS)
    try:
        text = canonical({"artifact": kind.name(), "fields": fields})
    except ValueError:  # a number or half a pair that has no spelling
        return
    with suppress(*UNREADABLE, StoreError):
        headers.closure(text)
    blobs = {of_bytes(text): text}

    def decode() -> None:
        with headers.reading("a value"):
            kind.decode(of_bytes(text), lambda digest: blobs.get(digest, b"12345678"))

    only(ArtifactError, decode)


@fuzz
def results_from_elsewhere(good, data, folder):
    def changed(made: bytes) -> bytes:
        parts = json.loads(made)
        mutate(parts, data)
        return json.dumps(parts).encode()

    sent = forged(good.entry, result=changed)
    try:
        found = entries.read(sent if data.draw(st.booleans()) else torn(sent, data))
    except ValueError:
        return
    assert entries.read(found.spell()) == found


@pytest.mark.medium
@pytest.mark.parametrize("name", sorted(FUZZ))
@FEW
@given(data=st.data())
def test_a_parser_reads_or_refuses(good, tmp_path, name, data):
    FUZZ[name](good, data, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(FUZZ))
@MANY
@given(data=st.data())
def test_a_parser_reads_or_refuses_at_length(good, tmp_path, name, data):
    FUZZ[name](good, data, tmp_path)
