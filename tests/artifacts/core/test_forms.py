"""Values of every type come back as they were stored, also from bundles and remotes; ambiguous types are refused."""

from __future__ import annotations

import importlib
import json
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pydantic import BaseModel

from dextera_build.artifacts.base import Artifact, Collection, File, Value
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.comparison.difference import differences
from dextera_build.artifacts.core.arrays import Array
from dextera_build.bundle import importer, layout
from dextera_build.code.modules import PACKAGE
from dextera_build.engine.key import Writer
from dextera_build.errors import ArtifactError
from dextera_build.remotes.folder import Directory
from dextera_build.remotes.transfer import Transfer
from dextera_build.store import headers
from dextera_build.store.entry import ActionResult
from dextera_build.store.store import Store
from tests.artifacts.generated import kinds, values
from tests.artifacts.test_base import Memory
from tests.bundle.conftest import bundle
from tests.engine.tiny import call, graph

Points = Annotated[np.ndarray, Array("N 3", "float32", unit="m")]


class Box(Value):
    """A box."""

    size: tuple[float, float, float]


class Ball(Value):
    """A ball."""

    size: tuple[float, float, float]
    radius: float | int


class Solid(Artifact):
    """Fields of every sum type, and arrays inside containers."""

    shape: Box | Ball
    shapes: tuple[Box | Ball | None, ...]
    look: Image | File | Points | bytes | str | None
    looks: dict[str, Image | Camera | Literal["none"]]
    points: Points
    clouds: dict[str, Annotated[np.ndarray, Array("* 3", "float64")]]
    pair: tuple[Annotated[np.ndarray, Array("N", "int32")], Collection[File] | int]


TYPES = [*kinds(), Solid]
SETTINGS = settings(
    deadline=None,
    max_examples=10,
    # Values that hold many others are often too large for hypothesis, which then tries again.
    suppress_health_check=list(HealthCheck),
)


def same(one: Any, other: Any) -> bool:
    """Whether two values are of one type and hold the same, bit for bit."""
    if type(one) is not type(other) and not (isinstance(one, dict) and isinstance(other, dict)):
        return False
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and one.shape == other.shape and one.tobytes() == other.tobytes()
    if isinstance(one, BaseModel):
        return all(same(getattr(one, name), getattr(other, name)) for name in type(one).model_fields)
    if isinstance(one, Mapping):
        return one.keys() == other.keys() and all(same(item, other[name]) for name, item in one.items())
    if isinstance(one, tuple):
        return len(one) == len(other) and all(map(same, one, other))
    return bool(one == other)


@pytest.mark.medium
@pytest.mark.parametrize("kind", TYPES, ids=lambda kind: kind.__name__)
@SETTINGS
@given(data=st.data())
def test_any_value_comes_back(kind: type[Artifact], data: st.DataObject) -> None:
    """Promise: what a type can hold is read back equal, of the same types, and stored again as the same bytes."""
    value, memory = data.draw(values(kind)), Memory()
    key = value.encode(memory.put)
    again = kind.decode(key, memory.__getitem__)
    assert same(again, value)
    assert again.encode(Memory().put) == key
    assert differences(key, key, memory.__getitem__) == []


@pytest.mark.parametrize("kind", TYPES, ids=lambda kind: kind.__name__)
@settings(SETTINGS, max_examples=2)
@given(data=st.data())
def test_any_value_comes_back_from_another_store(
    kind: type[Artifact], data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """Promise: a value that came with a bundle, or from a remote, is the value that was stored."""
    value, root = data.draw(values(kind)), tmp_path_factory.mktemp("stores")
    store, node = Store(root / "store"), call("value", "const", "x")
    document = store.blobs.put(Writer().document(node, {}))
    output = value.encode(store.writer)
    store.actions.put(document, ActionResult(output, "", (), {}, 1.0, None, document))
    bundle(store, graph(node)).write(root / "bundle.tar")
    bundled, fetched = Store(root / "bundled"), Store(root / "fetched")
    importer.take(importer.open_bundle(layout.Layout(root / "bundle.tar")), bundled)
    Transfer(store).send(Directory(root / "share"), document)
    assert Transfer(fetched).fetch(Directory(root / "share"), document) is not None
    for there in (store, bundled, fetched):
        assert same(kind.decode(output, there.reader), value)


def test_the_type_of_a_union_is_told_apart_by_what_is_stored() -> None:
    memory = Memory()
    box, ball = (Image(pixels=np.zeros((2, 2, 3), np.uint8)), File(data=b"x"))
    solid = Solid(
        shape=Ball(size=(1.0, 2.0, 3.0), radius=1),
        shapes=(Box(size=(1.0, 2.0, 3.0)), None),
        look=box,
        looks={"a": "none"},
        points=np.zeros((2, 3), np.float32),
        clouds={"a": np.zeros((0, 3)), "b": np.zeros((5, 3))},
        pair=(np.zeros(2, np.int32), Collection[File](items={"f": ball})),
    )
    fields = json.loads(memory[solid.encode(memory.put)])["fields"]
    assert fields["shape"] == {"$value": {"$type": "Ball", "radius": 1, "size": [1.0, 2.0, 3.0]}}
    assert [each and each["$value"]["$type"] for each in fields["shapes"]] == ["Box", None]
    other = solid.model_copy(update={"shape": Box(size=(1.0, 2.0, 3.0))}).encode(memory.put)
    found = differences(solid.encode(memory.put), other, memory.__getitem__)
    assert [difference.path for difference in found] == ["shape.$type", "shape.radius"]


def test_a_stored_type_that_is_not_declared_is_refused() -> None:
    memory = Memory()
    ball = Ball(size=(1.0, 2.0, 3.0), radius=1)

    class Holder(Artifact):
        part: Box | Ball | Image | File

    key = Holder(part=ball).encode(memory.put)
    forged = memory.put(memory[key].replace(b'"Ball"', b'"Cone"'))
    with pytest.raises(ArtifactError, match="a stored Cone stands where Box or Ball is declared"):
        Holder.decode(forged, memory.__getitem__)
    camera = Camera(width=4, height=3, fx=1.0, fy=1.0, cx=1.5, cy=1.0).encode(memory.put)
    forged = memory.put(json.dumps({"artifact": "tests.Holder", "fields": {"part": {"$ref": camera}}}).encode())
    with pytest.raises(ArtifactError, match="a stored Camera stands where Image or File is declared"):
        Holder.decode(forged, memory.__getitem__)


def test_a_subclass_of_a_declared_type_is_refused_when_it_is_stored() -> None:
    class Cube(Box):
        pass

    class Holder(Artifact):
        part: Box

    with pytest.raises(ArtifactError, match="a Cube cannot be stored where Box is declared"):
        Holder(part=Cube(size=(1.0, 1.0, 1.0))).encode(Memory().put)


@pytest.mark.parametrize(
    ("hint", "said"),
    [
        (Collection[File] | Collection[Image], "two of its types are stored as `Collection`"),
        (Points | Annotated[np.ndarray, Array("N", "float32")], "an array"),
        (dict[str, File] | dict[str, Image] | None, "a dict"),
        (tuple[int, ...] | tuple[str, str], "a sequence"),
        (dict[str, tuple[Collection[File] | Collection[Image], ...]], "`Collection`"),
    ],
    ids=str,
)
def test_a_type_that_cannot_be_read_back_is_refused_when_it_is_made(hint: Any, said: str) -> None:
    with pytest.raises(ArtifactError, match=r"`Unclear.part` cannot be read back") as caught:
        type("Unclear", (Artifact,), {"__annotations__": {"part": hint}, "__module__": __name__})
    assert said in caught.value.message
    assert caught.value.code == "DXB-A114"


def test_arrays_in_containers_are_checked_like_fields() -> None:
    class Views(Artifact):
        width: Annotated[np.ndarray, Array("W", "int32")]
        rows: dict[str, Annotated[np.ndarray, Array("W 2", "float32")]]
        steps: tuple[Annotated[np.ndarray, Array("*", "uint8")], ...] = ()

    width, right = np.zeros(3, np.int32), np.zeros((3, 2), np.float32)
    made = Views(width=width, rows={"a": right.copy(), "b": right.copy()}, steps=(np.zeros(1, np.uint8),))
    with pytest.raises(ValueError, match="read-only"):
        made.rows["a"][0] = 1
    for rows, said in (
        ({"a": right, "b": right.astype(np.float64)}, r"Views\.rows\[b\]: dtype is float64"),
        ({"a": np.zeros((4, 2), np.float32)}, r"Views\.rows\[a\]: axis W is 4, but width says 3"),
        ({"a": np.full((3, 2), np.nan, np.float32)}, r"Views\.rows\[a\]: 6 of 6 numbers are not finite"),
    ):
        with pytest.raises(ArtifactError, match=said):
            Views(width=width, rows=rows)
    with pytest.raises(ArtifactError, match=r"Views\.steps\[1\]: shape is \(\)"):
        Views(width=width, rows={}, steps=(np.zeros(2, np.uint8), np.zeros((), np.uint8)))


def test_the_type_in_the_docs_works(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = (PACKAGE / "docs" / "writing_rules.md").read_text()
    block = next(text for text in page.split("```python\n") if text.startswith('"""Grasps'))
    (tmp_path / "grasps_of_the_docs.py").write_text(block.partition("```")[0])
    monkeypatch.syspath_prepend(str(tmp_path))
    shown = importlib.import_module("grasps_of_the_docs")
    points, memory = np.ones((2, 3), np.float32), Memory()
    tools = (shown.Pinch(width_m=0.05), shown.Suction(force_n=20.0))
    value = shown.Grasps(tools=tools, points=points, normals={"cross": points.copy()})
    assert same(shown.Grasps.decode(value.encode(memory.put), memory.__getitem__), value)
    with pytest.raises(ArtifactError, match=r"Grasps\.normals\[cross\]: axis N is 1, but points says 2"):
        shown.Grasps(tools=tools, points=points, normals={"cross": points[:1].copy()})


def test_containers_are_exported_with_their_labels(tmp_path: Path) -> None:
    class Views(Artifact):
        rows: dict[str, Annotated[np.ndarray, Array("*", "float32")]]
        parts: tuple[File, ...]

    made = Views(rows={"a": np.ones(3, np.float32)}, parts=(File(data=b"x"), File(data=b"y")))
    names = [path.name for path in made.export(tmp_path, "views")]
    assert sorted(names) == ["views.npz", "views.parts.0", "views.parts.1"]
    assert np.load(tmp_path / "views.npz")["rows.a"].tolist() == [1.0, 1.0, 1.0]


PEAK = """
import sys
from pathlib import Path
from dextera_build.store.store import Store
from tests.artifacts.core.test_forms import Cloud
store = Store(Path(sys.argv[1]))
cloud = Cloud.decode(sys.argv[2], store.reader)
print(float(cloud.points[-1, -1]), type(cloud.points).__name__)
with open("/proc/self/status") as status:
    print(next(int(line.split()[1]) for line in status if line.startswith("RssAnon")))
"""


class Cloud(Artifact):
    """A large array."""

    points: Annotated[np.ndarray, Array("N 3", "float64", finite=False)]


@pytest.mark.medium
def test_a_large_array_stays_in_its_file(tmp_path: Path) -> None:
    store = Store(tmp_path / "store")
    points = np.zeros((4_000_000, 3))
    points[-1, -1] = 7.0
    key = Cloud(points=points).encode(store.writer)
    words = [sys.executable, "-c", PEAK, str(tmp_path / "store"), key]
    done = subprocess.run(words, capture_output=True, text=True, check=True, cwd=PACKAGE.parent)
    shown, memory_kb = done.stdout.splitlines()
    assert shown == "7.0 ndarray"
    assert int(memory_kb) * 1024 < points.nbytes
    again = Cloud.decode(key, store.reader)
    assert again.encode(Memory().put) == key
    with pytest.raises(ValueError, match="read-only"):
        again.points[0] = 1.0
    header = json.loads(store.blobs.get(key))
    header["fields"]["points"]["$array"][1] = [3_999_999, 3]
    forged = store.writer(json.dumps(header).encode())
    with pytest.raises(ArtifactError, match="the stored header of `cloud` is malformed"), headers.reading("`cloud`"):
        Cloud.decode(forged, store.reader)
