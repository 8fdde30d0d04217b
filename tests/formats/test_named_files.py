"""Files that meshes name: those of the input are read, no others, and none is left out without a word."""

from __future__ import annotations

import json
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dextera_build.artifacts.cameras.image import Image, png
from dextera_build.errors import ArtifactError
from dextera_build.formats import bounds
from dextera_build.formats import mesh as mesh_files
from tests import factories

PICTURE = Image(pixels=np.random.default_rng(5).integers(0, 256, (16, 24, 3), np.uint8))


OBJ = "mtllib %s\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\n"
"""One triangle with a material."""


def textured(folder: Path, library: str, picture: str) -> Path:
    """An OBJ in `folder/in`, its library and the picture of that in the places that it names."""
    (folder / "in" / "sub").mkdir(parents=True)
    path = folder / "in" / "a.obj"
    path.write_text(OBJ % library.format(folder))
    library_path = path.parent / library.format(folder)
    library_path.write_text(f"newmtl m\nmap_Kd {picture.format(folder)}\n")
    (library_path.parent / picture.rpartition(" ")[2].format(folder)).write_bytes(png(PICTURE.pixels))
    return path


@pytest.mark.parametrize("picture", ["a.png", "-s 1 1 1 a.png", "-clamp on -o 0.5 a.png"])
@pytest.mark.parametrize("library", ["a.mtl", "sub/a.mtl"])
def test_pictures_lie_beside_the_library_that_names_them(tmp_path, library, picture):
    read = mesh_files.load(textured(tmp_path, library, picture))
    assert read.texture is not None
    assert np.array_equal(read.texture.pixels, PICTURE.pixels)


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        ("vt 0 0 0\nvt 1 0 0.5\nvt 0 1 0\n", [[0, 0], [1, 0], [0, 1]]),
        ("vt 0\nvt 1\nvt 0.5\n", [[0, 0], [1, 0], [0.5, 0]]),
    ],
)
def test_texture_coordinates_of_an_obj_have_one_to_three_values(tmp_path, lines, expected):
    path = textured(tmp_path, "a.mtl", "a.png")
    path.write_text(path.read_text().replace("vt 0 0\nvt 1 0\nvt 0 1\n", lines))
    read = mesh_files.load(path)
    assert read.uv is not None
    assert read.uv[0].tolist() == expected


@pytest.mark.parametrize(
    ("library", "picture"),
    [
        ("../a.mtl", "a.png"),
        ("{}/a.mtl", "a.png"),
        ("a.mtl", "../a.png"),
        ("a.mtl", "{}/a.png"),
        ("a.mtl", "..\\a.png"),
    ],
)
def test_materials_and_pictures_outside_of_the_input_are_refused(tmp_path, library, picture):
    (tmp_path / "a.png").write_bytes(png(PICTURE.pixels))
    with pytest.raises(ArtifactError) as caught:
        mesh_files.load(textured(tmp_path, library, picture))
    assert caught.value.facts["why"].endswith("lies outside of the input")


def glb(**more: Any) -> bytes:
    """A GLB of one triangle, with more fields."""
    numbers = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32).tobytes()
    tree = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        "textures": [{"source": 0}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "bufferViews": [{"buffer": 0, "byteLength": len(numbers)}],
        "buffers": [{"byteLength": len(numbers)}],
        **more,
    }
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(numbers), b"BIN\0") + numbers
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


def test_a_buffer_beside_a_glb_is_read(tmp_path):
    (tmp_path / "b.data").write_bytes(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32).tobytes())
    (tmp_path / "a.glb").write_bytes(glb(buffers=[{"byteLength": 36, "uri": "b.data"}], textures=[], materials=[{}]))
    assert len(mesh_files.load(tmp_path / "a.glb").faces) == 1


EMPTY = {"componentType": 5126, "count": 10**9, "type": "VEC3"}
"""An accessor without content."""


@pytest.mark.parametrize(
    ("more", "why"),
    [
        ({"images": [{"uri": "../a.png"}]}, "`../a.png`, which `a.glb` names, lies outside of the input"),
        ({"images": [{"uri": "b.png"}]}, "`b.png`, which `a.glb` names, is missing"),
        ({"images": [{"uri": "c.png"}]}, "the picture `c.png` is none of PNG"),
        ({"images": [{"bufferView": 0}]}, "the picture `image 0` is none of PNG"),
        ({"buffers": [{"byteLength": 36, "uri": "/dev/zero"}]}, "`/dev/zero`, which `a.glb` names, lies outside"),
        ({"meshes": [{"primitives": [{}]}]}, "its JSON is damaged"),
    ],
)
def test_a_glb_loses_no_colours_without_a_word(tmp_path, more, why):
    (tmp_path / "in").mkdir()
    (tmp_path / "a.png").write_bytes(png(PICTURE.pixels))
    (tmp_path / "in" / "c.png").write_bytes(b"no picture")
    (tmp_path / "in" / "a.glb").write_bytes(glb(**more))
    with pytest.raises(ArtifactError) as caught:
        mesh_files.load(tmp_path / "in" / "a.glb")
    assert why in caught.value.facts["why"]


def test_a_small_file_that_stands_for_billions_of_numbers_is_refused(tmp_path, monkeypatch):
    whole = json.loads(glb()[20:].split(b"BIN")[0][:-4])
    (tmp_path / "a.glb").write_bytes(glb(accessors=[*whole["accessors"], EMPTY]))
    with pytest.raises(ArtifactError, match=r"`a\.glb` holds too many numbers") as caught:
        mesh_files.load(tmp_path / "a.glb")
    assert caught.value.facts == {"found": "at least 3,000,000,009", "most": "200,000,000"}
    many = {"nodes": [{"mesh": 0}] * 20, "scenes": [{"nodes": list(range(20))}]}
    (tmp_path / "a.glb").write_bytes(glb(**many, textures=[], materials=[{}]))
    assert len(mesh_files.load(tmp_path / "a.glb").faces) == 20
    monkeypatch.setattr(bounds, "MOST_TRIANGLES", 10)
    with pytest.raises(ArtifactError, match="too many triangles") as caught:
        mesh_files.load(tmp_path / "a.glb")
    assert caught.value.facts["found"] == "at least 11"


def test_a_texture_that_would_fill_the_memory_is_refused(tmp_path):
    header = png(np.zeros((1, 1, 3), np.uint8))
    large = header[:16] + struct.pack(">II", 60_000, 60_000) + header[24:29]
    large += struct.pack(">I", zlib.crc32(large[12:29])) + header[33:]
    box = factories.box_mesh((-0.1, -0.2, 0.0), (0.1, 0.2, 0.3))
    path = box.model_copy(update={"uv": np.zeros((12, 3, 2), np.float32), "texture": PICTURE}).save(
        tmp_path / "a.usda"
    )[0]
    (tmp_path / "a.png").write_bytes(large)
    with pytest.raises(ArtifactError) as caught:
        mesh_files.load(path)
    assert "the picture `./a.png` is too large" in caught.value.facts["why"]


def test_several_material_libraries_are_refused(tmp_path):
    (tmp_path / "a.obj").write_text("mtllib a.mtl\n" + OBJ % "b.mtl")
    with pytest.raises(ArtifactError) as caught:
        mesh_files.load(tmp_path / "a.obj")
    assert caught.value.facts["why"] == "it names 2 material libraries, and one is read: a.mtl, b.mtl"
