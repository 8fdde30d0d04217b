"""An artifact as one file."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.base import Artifact, Collection, File
from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.building import one_file
from dextera_build.errors import UsageError


class Body(Artifact):
    """A mesh in a field."""

    mesh: Mesh


class Scene(Artifact):
    """Bodies by name, and a photo."""

    bodies: dict[str, Body]
    photo: Image


def triangle() -> Mesh:
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
    return Mesh(vertices=corners, faces=np.array([[0, 1, 2]], np.int32))


def image() -> Image:
    return Image(pixels=np.zeros((2, 3, 3), np.uint8))


def test_the_one_part_of_that_form_is_written(tmp_path):
    for name in ("body.stl", "body.PLY"):
        written = one_file.write(Body(mesh=triangle()), tmp_path / name)
        assert written[0] == tmp_path / name
        assert len(written[0].read_bytes()) > 80
    scene, said = Scene(bodies={"a": Body(mesh=triangle())}, photo=image()), list[str]()
    assert one_file.write(scene, tmp_path / "s.png", said.append) == [tmp_path / "s.png"]
    assert one_file.write(scene.photo, tmp_path / "s.png", said.append) == [tmp_path / "s.png"]
    assert said == [f"`{tmp_path / 's.png'}` is the Image in Scene, and nothing else of it"]
    assert one_file.write(scene, tmp_path / "s.glb") == [tmp_path / "s.glb"]


def test_a_file_keeps_its_bytes_under_any_name(tmp_path):
    (path,) = one_file.write(File(data=b"x"), tmp_path / "note.v2")
    assert path.read_bytes() == b"x"


@pytest.mark.parametrize(
    ("made", "name", "why", "forms"),
    [
        (lambda: Body(mesh=triangle()), "b.mp4", "neither it nor a part of it has that form", ".glb"),
        (triangle, "b.png", "neither it nor a part of it has that form", ".glb"),
        (
            lambda: Collection[Body](items={"a": Body(mesh=triangle()), "b": Body(mesh=triangle())}),
            "b.glb",
            "it holds 2 parts of that form",
            "",
        ),
    ],
)
def test_what_is_no_single_file_is_refused_with_the_forms_that_work(tmp_path, made, name, why, forms):
    with pytest.raises(UsageError, match=why) as caught:
        one_file.write(made(), tmp_path / name)
    assert forms in caught.value.facts.get("one file", "")
    assert caught.value.hint == f"`-o {(tmp_path / name).with_suffix('')}/` writes a folder with all of its files"
    assert list(tmp_path.iterdir()) == []
