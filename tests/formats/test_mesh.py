"""Meshes in the formats of other programs: what comes back, what is joined, and what is refused."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.errors import ArtifactError
from dextera_build.formats import mesh as mesh_files
from dextera_build.formats import registry
from tests import factories

RNG = np.random.default_rng(5)
PLAIN = factories.box_mesh((-0.1, -0.2, 0.0), (0.1, 0.2, 0.3))
PICTURE = Image(pixels=RNG.integers(0, 256, (16, 24, 3), np.uint8))
PAINTED = PLAIN.model_copy(update={"uv": RNG.uniform(0, 1, (12, 3, 2)).astype(np.float32), "texture": PICTURE})
TEXTURED = [".obj", ".glb", ".usda", ".usdc", ".usd", ".usdz"]


@pytest.mark.parametrize("suffix", registry.suffixes(Mesh))
@pytest.mark.parametrize("mesh", [PLAIN, PAINTED], ids=["plain", "painted"])
def test_the_geometry_comes_back(tmp_path, mesh, suffix):
    path = mesh.save(tmp_path / f"a{suffix}")[0]
    again = mesh_files.load(path)
    assert np.array_equal(again.vertices[again.faces], mesh.vertices[mesh.faces])
    assert len(again.vertices) == 8
    assert again.is_closed


@pytest.mark.parametrize("suffix", TEXTURED)
def test_the_texture_comes_back(tmp_path, suffix):
    path = PAINTED.save(tmp_path / f"a{suffix}")[0]
    again = mesh_files.load(path)
    assert again.texture is not None
    assert again.uv is not None
    assert PAINTED.uv is not None
    assert np.array_equal(again.texture.pixels, PICTURE.pixels)
    assert np.abs(again.uv - PAINTED.uv).max() < 1e-6


@pytest.mark.parametrize("suffix", [*TEXTURED, ".ply"])
def test_the_colour_comes_back(tmp_path, suffix):
    again = mesh_files.load(PLAIN.save(tmp_path / f"a{suffix}")[0])
    assert again.texture is None
    # A reader of GLB keeps linear light to 1/255, which is coarse for dark colours.
    assert again.colour == pytest.approx(PLAIN.colour, abs=0.01 if suffix == ".glb" else 0.003)


def test_a_ply_of_a_texture_has_the_colours_of_the_vertices(tmp_path):
    striped = factories.box_asset().body.links["base"].mesh
    again = mesh_files.load(striped.save(tmp_path / "a.ply")[0])
    face, weight = np.arange(len(striped.faces)), np.full((len(striped.faces), 3), 1 / 3)
    assert again.texture is not None
    assert np.abs(again.paint(face, weight) - striped.paint(face, weight)).mean() < 0.2


@pytest.mark.parametrize("suffix", registry.suffixes(Mesh))
def test_equal_meshes_are_equal_files(tmp_path, suffix):
    first, second = (PAINTED.save(tmp_path / folder / f"a{suffix}") for folder in ("x", "y"))
    if suffix not in (".usdc", ".usdz"):  # the binary form of USD may differ
        assert [path.read_bytes() for path in first] == [path.read_bytes() for path in second]
    assert [path.name for path in first] == [path.name for path in second]


def glb(path: Path) -> dict[str, Any]:
    data = path.read_bytes()
    (length,) = struct.unpack_from("<I", data, 12)
    header: dict[str, Any] = json.loads(data[20 : 20 + length])
    return header


def test_a_glb_stands_upright_and_has_linear_colours(tmp_path):
    """As the specification of glTF 2.0 demands: +y up, metres, colour factors in linear light."""
    header = glb(PLAIN.save(tmp_path / "a.glb")[0])
    colour = header["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"]
    assert colour[:3] == pytest.approx([0.6038273, 0.0732390, 0.0331048], abs=1e-6)
    (node,) = [node for node in header["nodes"] if "mesh" in node]
    turn = np.array(node["matrix"]).reshape(4, 4).T
    assert (turn @ [0, 0, 1, 1]).tolist() == [0, 1, 0, 1]
    assert glb(PAINTED.save(tmp_path / "b.glb")[0])["images"][0]["mimeType"] == "image/png"


def test_units_and_axes_can_be_told(tmp_path):
    path = PLAIN.save(tmp_path / "a.stl")[0]
    assert mesh_files.load(path, metres_per_unit=0.001).extent == pytest.approx([0.0002, 0.0004, 0.0003])
    assert mesh_files.load(path, up="y").extent == pytest.approx([0.2, 0.3, 0.4])
    assert mesh_files.load(path, up="x").extent == pytest.approx([0.4, 0.3, 0.2])
    assert mesh_files.load(PLAIN.save(tmp_path / "a.glb")[0], up="z").extent == pytest.approx([0.2, 0.3, 0.4])


def test_materials_of_a_file_become_one_texture(tmp_path):
    PAINTED.save(tmp_path / "painted.obj")
    (tmp_path / "two.mtl").write_text("newmtl red\nKd 1 0 0\nnewmtl surface\nKd 1 1 1\nmap_Kd painted.png\n")
    text = (tmp_path / "painted.obj").read_text().replace("mtllib painted.mtl", "mtllib two.mtl")
    text += "v 5 0 0\nv 6 0 0\nv 5 1 0\nusemtl red\nf 9 10 11\n"
    (tmp_path / "two.obj").write_text(text)
    read = mesh_files.load(tmp_path / "two.obj")
    assert len(read.faces) == 13
    middle = read.vertices[read.faces].mean(axis=1)
    far = int(np.argmax(middle[:, 0]))
    assert read.paint(np.array([far]), np.full((1, 3), 1 / 3))[0] == pytest.approx([1, 0, 0], abs=0.01)
    box = [number for number in range(13) if number != far]
    old = np.array(
        [int(np.argmin(np.abs(PAINTED.vertices[PAINTED.faces].mean(axis=1) - m).sum(1))) for m in middle[box]]
    )
    weight = np.full((12, 3), 1 / 3)
    assert np.abs(read.paint(np.array(box), weight) - PAINTED.paint(old, weight)).max() < 1e-6


def test_colours_of_vertices_are_baked(tmp_path):
    import trimesh

    shades = RNG.integers(0, 256, (8, 4), np.uint8)
    made = trimesh.Trimesh(PLAIN.vertices, PLAIN.faces, vertex_colors=shades, process=False)
    (tmp_path / "a.ply").write_bytes(made.export(file_type="ply"))
    read = mesh_files.load(tmp_path / "a.ply")
    corner = read.paint(np.arange(12), np.tile([1.0, 0, 0], (12, 1)))
    assert np.abs(corner - shades[PLAIN.faces[:, 0], :3] / 255).max() < 1e-6


def test_a_mirrored_node_keeps_its_outside(tmp_path):
    import trimesh

    scene = trimesh.Scene()
    scene.add_geometry(trimesh.Trimesh(PLAIN.vertices, PLAIN.faces, process=False), transform=np.diag([-1.0, 1, 1, 1]))
    (tmp_path / "a.glb").write_bytes(scene.export(file_type="glb"))
    assert volume(mesh_files.load(tmp_path / "a.glb")) == pytest.approx(volume(PLAIN))


def volume(mesh: Mesh) -> float:
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces].astype(np.float64), 1, 0)
    return float((np.cross(a, b) * c).sum() / 6)


STAGE = """#usda 1.0
(
    metersPerUnit = 0.01
    upAxis = "Y"
)
def Xform "Top" {
    double3 xformOp:translate = (0, 100, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    def Mesh "Table" {
        uniform token orientation = "%s"
        int[] faceVertexCounts = [4, 3]
        int[] faceVertexIndices = [0, 1, 2, 3, 0, 3, 4]
        point3f[] points = [(0, 0, 0), (100, 0, 0), (100, 0, -100), (0, 0, -100), (-50, 0, -50)]
        color3f[] primvars:displayColor = [(1, 0, 0), (0, 0, 1)] (
            interpolation = "%s"
        )
    }
    def Mesh "Guide" {
        uniform token purpose = "guide"
        int[] faceVertexCounts = [3]
        int[] faceVertexIndices = [0, 1, 2]
        point3f[] points = [(0, 0, 0), (900, 0, 0), (0, 900, 0)]
    }
}
"""


def test_a_stage_is_read_in_metres_with_z_up(tmp_path):
    (tmp_path / "a.usda").write_text(STAGE % ("rightHanded", "constant"))
    read = mesh_files.load(tmp_path / "a.usda")
    assert len(read.faces) == 3
    assert read.vertices[2].tolist() == [1, 1, 1]
    normals = np.cross(*(read.vertices[read.faces[:, k]] - read.vertices[read.faces[:, 0]] for k in (1, 2)))
    assert (normals[:, 2] > 0).all()
    assert read.colour == pytest.approx((1, 0, 0))


def test_a_left_handed_stage_is_turned(tmp_path):
    (tmp_path / "a.usda").write_text(STAGE % ("leftHanded", "constant"))
    read = mesh_files.load(tmp_path / "a.usda")
    normals = np.cross(*(read.vertices[read.faces[:, k]] - read.vertices[read.faces[:, 0]] for k in (1, 2)))
    assert (normals[:, 2] < 0).all()


def test_subsets_have_materials_of_their_own(tmp_path):
    from pxr import Sdf, Usd, UsdGeom, UsdShade, Vt

    (tmp_path / "a.usda").write_text(STAGE % ("rightHanded", "constant"))
    stage = Usd.Stage.Open(str(tmp_path / "a.usda"))
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/Top/Table"))
    from dextera_build.formats.mesh_usd import add_surface_material

    look = add_surface_material(stage, "/Top/Green", (0.0, 1.0, 0.0))
    subset = UsdGeom.Subset.CreateGeomSubset(mesh, "side", UsdGeom.Tokens.face, Vt.IntArray([1]), "materialBind")
    UsdShade.MaterialBindingAPI.Apply(subset.GetPrim()).Bind(UsdShade.Material.Get(stage, Sdf.Path(look)))
    stage.GetRootLayer().Save()
    read = mesh_files.load(tmp_path / "a.usda")
    shades = read.paint(np.arange(3), np.full((3, 3), 1 / 3)).round(2).tolist()
    assert sorted(shades) == [[0, 1, 0], [1, 0, 0], [1, 0, 0]]


def test_a_packed_stage_is_read(tmp_path):
    from pxr import UsdUtils

    PAINTED.save(tmp_path / "a.usda")
    assert UsdUtils.CreateNewUsdzPackage(str(tmp_path / "a.usda"), str(tmp_path / "a.usdz"))
    (tmp_path / "a.png").unlink()
    read = mesh_files.load(tmp_path / "a.usdz")
    assert read.texture is not None
    assert np.array_equal(read.texture.pixels, PICTURE.pixels)


def broken(folder: Path, name: str) -> Path:
    """One of the files that cannot be read."""
    path = folder / f"a{Path(name).suffix}"
    if name in ("half.glb", "half.stl", "half.ply"):
        whole = PLAIN.save(path)[0].read_bytes()
        path.write_bytes(whole[: len(whole) * 2 // 3])
    elif name == "bare.obj":
        PAINTED.save(path)
        path.with_suffix(".mtl").unlink()
    elif name in ("blank.obj", "blank.usda"):
        PAINTED.save(path)
        path.with_suffix(".png").unlink()
    elif name == "points.ply":
        path.write_bytes(
            b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
            b"end_header\n0 0 0\n"
        )
    elif name == "cut.usda":
        path.write_text((STAGE % ("rightHanded", "constant")).replace("[4, 3]", "[4, 4]"))
    elif name == "tilted.usda":
        path.write_text((STAGE % ("rightHanded", "constant")).replace('upAxis = "Y"', 'upAxis = "W"'))
    elif name == "words.usda":
        path.write_text((STAGE % ("rightHanded", "constant")).replace("point3f[] points", "words[] points"))
    elif name == "units.usdc":
        PLAIN.save(path)
        metre, single = b"\0\0\x80?\0\0\x09@", b"\0\0\x80?\0\0\x08@"  # 1 as a double, and as a float
        path.write_bytes(path.read_bytes().replace(metre, single))
    elif name != "absent.obj":
        path.write_bytes(b"nothing of the kind")
    return path


@pytest.mark.parametrize(
    ("name", "form", "why"),
    [
        ("absent.obj", "OBJ", "there is no such file"),
        ("half.glb", "GLB", ""),
        ("half.stl", "STL", ""),
        ("half.ply", "PLY", ""),
        ("noise.glb", "GLB", ""),
        ("noise.stl", "STL", ""),
        ("noise.ply", "PLY", ""),
        ("noise.usda", "USD", "is not a valid usda layer"),
        ("noise.obj", "OBJ", "it holds no triangles"),
        ("points.ply", "PLY", "it holds no triangles"),
        ("bare.obj", "OBJ", "`a.mtl`, which `a.obj` names, is missing"),
        ("blank.obj", "OBJ", "`a.png`, which `a.mtl` names, is missing"),
        ("cut.usda", "USD", "the faces of `/Top/Table` are not whole"),
        ("tilted.usda", "USD", "its up axis is `w`, neither `Y` nor `Z`"),
        ("words.usda", "USD", "an attribute of `/Top/Table` holds another type or count of values"),
        ("units.usdc", "USD", "does not match retrieved type float"),
        ("blank.usda", "USD", "the texture `./a.png` is missing"),
    ],
)
def test_what_cannot_be_read_is_named(tmp_path, name, form, why):
    path = broken(tmp_path, name)
    with pytest.raises(ArtifactError, match=f"`{path.name}` cannot be read as {form}") as caught:
        mesh_files.load(path)
    assert caught.value.code == "DXB-A402"
    assert why in caught.value.facts["why"]
    assert caught.value.facts["why"]


def test_other_formats_are_refused(tmp_path):
    with pytest.raises(ArtifactError, match=r"`a\.fbx` names no file format of a Mesh"):
        mesh_files.load(tmp_path / "a.fbx")
    with pytest.raises(ArtifactError, match=r"`a\.dae` names no file format of a Mesh"):
        PLAIN.save(tmp_path / "a.dae")
