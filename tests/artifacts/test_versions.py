"""What earlier versions stored is read; a type does not change without a new version."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

import pytest

from dextera_build.artifacts.base import Artifact, Collection, File
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.comparison.difference import differences
from dextera_build.artifacts.core.identity import identity, parse, spelled
from dextera_build.errors import ArtifactError
from dextera_build.store.store import Store
from tests.artifacts import generated, samples

KINDS = {identity(kind): kind for kind in generated.kinds()}
SAMPLES = samples.read()


@pytest.mark.parametrize("name", SAMPLES)
def test_every_stored_version_is_read(name: str) -> None:
    stored, kind = samples.blobs(SAMPLES[name]), KINDS[parse(name)[0]]
    key = SAMPLES[name]["key"]
    assert json.loads(stored[key])["artifact"] == name
    value = kind.decode(key, stored.__getitem__)
    again: dict[str, bytes] = {}
    back = kind.decode(value.encode(lambda data: keep(again, data)), again.__getitem__)
    assert repr(back) == repr(value)


def keep(blobs: dict[str, bytes], data: bytes) -> str:
    from dextera_build import digest

    key = digest.of_bytes(data)
    blobs[key] = data
    return key


@pytest.mark.parametrize("name", sorted(KINDS))
def test_a_type_that_changed_has_a_new_version(name: str) -> None:
    sample = SAMPLES.get(spelled(KINDS[name]))
    assert sample is not None, "`python -m tests.artifacts.samples` adds a sample of the new version"
    assert sample["fields"] == samples.structure(KINDS[name]), (
        f"the fields of {name} changed: increment `type_version`, add a reader of the version before to `readers`, and "
        "a sample with `python -m tests.artifacts.samples`; before 0.1.0 is tagged, only replace the sample"
    )


class Cup(Artifact):
    """Version 3: a height, with readers of both versions before."""

    type_version: ClassVar[int] = 3
    readers: ClassVar[Mapping[int, Any]] = {
        1: lambda fields: {"height_mm": fields["size"]},
        2: lambda fields: {"height_m": fields["height_mm"] / 1000, "lens": fields.get("lens")},
    }
    former_fields: ClassVar[Mapping[str, Any]] = {"lens": Camera}

    height_m: float
    lens: Camera | None = None


def stored(store: Store, artifact: str, **fields: Any) -> str:
    return store.blobs.put(json.dumps({"artifact": artifact, "fields": fields}).encode())


def test_readers_lead_from_version_to_version(store: Store) -> None:
    assert spelled(Cup) == "tests.Cup@3"
    assert Cup.decode(stored(store, "tests.Cup", size=90.0), store.reader) == Cup(height_m=0.09)
    assert Cup.decode(stored(store, "tests.Cup@2", height_mm=90.0), store.reader) == Cup(height_m=0.09)
    camera = Camera(width=4, height=3, fx=1.0, fy=1.0, cx=0.0, cy=0.0)
    old = stored(store, "tests.Cup@2", height_mm=90.0, lens={"$ref": camera.encode(store.writer)})
    assert Cup.decode(old, store.reader) == Cup(height_m=0.09, lens=camera)


def test_a_version_without_a_reader_says_so(store: Store) -> None:
    made: Any = type("Cup", (Artifact,), {"type_version": 2, "__module__": __name__, "__annotations__": {}})
    with pytest.raises(ArtifactError, match="was stored by an earlier dxb") as caught:
        made.decode(stored(store, "tests.Cup"), store.reader)
    assert caught.value.code == "DXB-A116"


def test_a_newer_version_says_so(store: Store) -> None:
    with pytest.raises(ArtifactError, match=r"a tests\.Cup of version 4 was stored by a newer dxb") as caught:
        Cup.decode(stored(store, "tests.Cup@4", height_m=0.1), store.reader)
    assert caught.value.code == "DXB-A115"


def test_types_of_one_name_in_two_places_are_two_types(store: Store) -> None:
    other: Any = type("Cup", (Artifact,), {"__module__": "lab.types", "__annotations__": {"height_m": "float"}})
    rule: Any = type("Cup", (Artifact,), {"__module__": f"dxb_rules_{'ab' * 6}.lab.cup", "__annotations__": {}})
    assert [identity(kind) for kind in (Cup, other, rule)] == ["tests.Cup", "lab.Cup", "lab.Cup"]
    assert [identity(kind) for kind in (File, Collection[File], Collection)] == ["File", "Collection", "Collection"]
    key = other(height_m=0.1).encode(store.writer)
    with pytest.raises(ArtifactError, match=r"a tests\.Cup is needed here, but a lab\.Cup came"):
        Cup.decode(key, store.reader)


def test_values_of_two_versions_are_compared_field_by_field(store: Store) -> None:
    old = stored(store, "tests.Cup@2", height_mm=90.0, colour="red")
    new = stored(store, "tests.Cup@3", height_m=0.09, colour="blue")
    found = {difference.path: str(difference) for difference in differences(old, new, store.reader)}
    assert found[""] == "tests.Cup@2 -> tests.Cup@3"
    assert found["colour"] == "red -> blue"
    assert {"height_mm", "height_m"} <= found.keys()


def test_samples_stay_small() -> None:
    assert Path(samples.FILE).stat().st_size < 1 << 20
