"""Values outside: what is written is read back, and what a program may not say is refused."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dextera_build import digest
from dextera_build.artifacts.base import Array, Artifact, Collection, File, Folder
from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.shapes.mesh import Hull, Mesh
from dextera_build.artifacts.shapes.splats import Splats
from dextera_build.artifacts.spatial.point_cloud import PointCloud
from dextera_build.errors import ArtifactError
from dextera_build.formats import exchange
from dextera_build.rule import Options
from tests.artifacts import generated
from tests.factories import box_mesh


class Both(NamedTuple):
    """Two answers."""

    mask: Annotated[np.ndarray, Array("H W", "bool")]
    label: str | None


@dataclass
class Pair:
    """Two parts."""

    images: list[Image]
    by_name: dict[str, tuple[int, float]]


@dataclass
class Branch:
    """One that holds others like it, as a link of a body does."""

    mesh: Mesh
    branches: tuple[Branch, ...] = ()


class Look(Options):
    """Options."""

    kind: Literal["near", "far"] = "near"
    """How near."""


def there_and_back(value: Any, hint: Any, folder: Path) -> Any:
    return exchange.read(json.loads(json.dumps(exchange.write(value, folder), allow_nan=False)), hint, folder)


def digest_of(value: Artifact) -> str:
    return value.encode(digest.of_bytes)


@pytest.fixture
def lossy_as_fields(monkeypatch):
    """A mesh through GLB is the same surface, but not the same arrays; a PLY holds logarithms of sizes of Gaussians."""
    kept = {kind: suffix for kind, suffix in exchange._SUFFIXES.items() if kind not in (Mesh, Splats)}
    monkeypatch.setattr(exchange, "_SUFFIXES", kept)


@pytest.mark.medium
@pytest.mark.parametrize("kind", generated.kinds(), ids=lambda kind: kind.__name__)
@settings(max_examples=5, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_every_type_is_read_back_as_it_was_written(kind, data, tmp_path_factory, lossy_as_fields):
    value = data.draw(generated.values(kind))
    assert digest_of(there_and_back(value, kind, tmp_path_factory.mktemp("out"))) == digest_of(value)


@pytest.mark.medium
def test_a_mesh_is_the_same_surface_after_glb(tmp_path):
    mesh = box_mesh((-0.1, 0.0, 0.0), (0.1, 0.3, 0.5))
    raw = exchange.write(mesh, tmp_path, "shape")
    assert raw == {"type": "Mesh", "file": "shape.glb"}
    back = exchange.read(raw, Mesh, tmp_path)
    assert np.array_equal(np.sort(back.vertices[back.faces], axis=None), np.sort(mesh.vertices[mesh.faces], axis=None))
    assert np.allclose(back.extent, [0.2, 0.3, 0.5])
    assert back.is_closed


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".stl", ".glb"])
def test_a_program_may_answer_with_any_format_of_a_mesh(tmp_path, suffix):
    box_mesh((0.0, 0.0, 0.0), (0.1, 0.2, 0.3)).save(tmp_path / f"out{suffix}")
    back = exchange.read({"type": "Mesh", "file": f"out{suffix}"}, Mesh, tmp_path)
    assert np.allclose(back.extent, [0.1, 0.2, 0.3], atol=1e-6)


def test_structures_of_backends_are_read_back(tmp_path):
    mask = np.eye(3, dtype=bool)
    both = there_and_back(Both(mask, None), Both, tmp_path)
    assert (both.mask == mask).all()
    assert both.label is None
    image = Image(pixels=np.zeros((2, 2, 3), np.uint8))
    pair = there_and_back(Pair([image, image], {"a": (1, 2.5)}), Pair, tmp_path)
    assert (len(pair.images), pair.by_name) == (2, {"a": (1, 2.5)})
    assert there_and_back(Look(kind="far"), Look, tmp_path) == Look(kind="far")
    assert there_and_back({"a": b"1"}, dict[str, bytes], tmp_path) == {"a": b"1"}
    assert (
        there_and_back(Collection[File](items={"a": File(data=b"x")}), Collection[File], tmp_path).items["a"].data
        == b"x"
    )


def test_an_iterator_is_written_as_a_list_and_read_as_an_iterator(tmp_path):
    found = there_and_back(iter([("a", 1), ("b", 2)]), Iterator[tuple[str, int]], tmp_path)
    assert (next(found), next(found)) == (("a", 1), ("b", 2))


def test_a_union_is_read_by_the_name_of_its_type(tmp_path):
    hull = Hull(vertices=np.eye(4, 3, dtype=np.float32))
    assert isinstance(there_and_back(hull, Mesh | Hull | None, tmp_path), Hull)
    assert there_and_back(None, Mesh | Hull | None, tmp_path) is None


def test_nan_has_no_form(tmp_path):
    with pytest.raises(ArtifactError, match="not finite"):
        exchange.write(float("nan"), tmp_path)
    with pytest.raises(ArtifactError, match="a object has no form outside"):
        exchange.write(object(), tmp_path)


def array(folder: Path, name: str, value: np.ndarray, **how: Any) -> dict[str, str]:
    np.save(folder / name, value, **how)
    return {"type": "array", "file": name}


REFUSED = {
    '`output` is invalid: {"type": "Mesh"': {"type": "Image", "file": "a.npy"},
    "there is no such file": {"type": "Mesh", "file": "none.glb"},
    "leads out": {"type": "Mesh", "file": "linked.glb"},
    "no plain file": {"type": "Mesh", "file": "pipe.glb"},
    "has no field `colours`": {"type": "Mesh", "fields": {"colours": 1}},
    "`fields` is no object": {"type": "Mesh", "fields": [1]},
    "Field required": {"type": "Mesh", "fields": {}},
    "cannot be read as NPY": {"type": "Mesh", "fields": {"vertices": {"type": "array", "file": "bad.npy"}}},
    "are not finite": {"type": "Mesh", "fields": {"vertices": {"type": "array", "file": "nan.npy"}}},
    "Python objects": {"type": "Mesh", "fields": {"vertices": {"type": "array", "file": "object.npy"}}},
    "dtype is float64": {"type": "Mesh", "fields": {"vertices": {"type": "array", "file": "wide.npy"}}},
    "a name is empty": {"type": "Mesh", "file": "/etc/passwd"},
    "\\.\\.": {"type": "Mesh", "file": "../out.glb"},
}


@pytest.mark.parametrize("why", REFUSED)
def test_an_answer_of_another_form_is_refused(tmp_path, why):
    folder = tmp_path / "response"
    folder.mkdir()
    (tmp_path / "out.glb").write_bytes(b"")
    (folder / "linked.glb").symlink_to("/etc/passwd")
    os.mkfifo(folder / "pipe.glb")
    (folder / "bad.npy").write_bytes(b"garbage")
    array(folder, "nan.npy", np.full((3, 3), np.nan, np.float32))
    array(folder, "object.npy", np.array([{}]), allow_pickle=True)
    array(folder, "wide.npy", np.zeros((3, 3)))
    with pytest.raises(ArtifactError, match=why) as caught:
        exchange.read(REFUSED[why], Mesh, folder)
    assert caught.value.hint or caught.value.code in ("DXB-A103", "DXB-A106")


def test_an_array_that_claims_more_than_its_file_holds_is_refused(tmp_path):
    raw = array(tmp_path, "a.npy", np.zeros((2, 2), np.float32))
    with (tmp_path / "a.npy").open("wb") as file:
        header = {"descr": "<f4", "fortran_order": False, "shape": (10**12, 9)}
        np.lib.format.write_array_header_1_0(file, header)
    with pytest.raises(ArtifactError, match="cannot be read as NPY"):
        exchange.read(raw, np.ndarray, tmp_path)


@pytest.mark.parametrize(
    ("raw", "hint"),
    [("a", int), (1.5, int), (True, float), ([1], tuple[int, int]), ({"a": 1}, dict[str, int]), (1, list[int])],
)
def test_plain_values_are_strict(tmp_path, raw, hint):
    with pytest.raises(ArtifactError, match="`output` is invalid"):
        exchange.read(raw, hint, tmp_path)


def test_a_picture_that_is_none_is_refused(tmp_path):
    (tmp_path / "a.png").write_bytes(b"no picture")
    with pytest.raises(ArtifactError, match="cannot be read as a picture"):
        exchange.read({"type": "Image", "file": "a.png"}, Image, tmp_path)
    (tmp_path / "a.ply").write_bytes(b"no cloud")
    with pytest.raises(ArtifactError, match="`output`"):
        exchange.read({"type": "PointCloud", "file": "a.ply"}, PointCloud, tmp_path)


def test_a_folder_with_a_link_is_refused(tmp_path):
    (tmp_path / "tree").mkdir()
    (tmp_path / "tree" / "a").write_text("a")
    assert exchange.read({"type": "Folder", "folder": "tree"}, Folder, tmp_path).files == {"a": b"a"}
    (tmp_path / "tree" / "b").symlink_to("/etc/passwd")
    with pytest.raises(ArtifactError, match="no plain file"):
        exchange.read({"type": "Folder", "folder": "tree"}, Folder, tmp_path)


def test_only_data_has_a_form():
    known = [
        Mesh | None,
        Pair,
        Both,
        dict[str, tuple[int, ...]],
        Iterator[Image],
        Literal["a"],
        Any,
        Collection[File],
        Look,
        Branch,
    ]
    assert [hint for hint in known if not exchange.has_form(hint)] == []
    strange = [object, dict[str, object], os.stat_result, tuple[Image, type]]
    assert [hint for hint in strange if exchange.has_form(hint)] == []
