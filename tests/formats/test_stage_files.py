"""Stages of USD: layers and textures lie in the input, and few lines do not become billions of prims."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from dextera_build.errors import ArtifactError
from dextera_build.formats import bounds
from dextera_build.formats import mesh as mesh_files

HEAD = '#usda 1.0\n(\n    defaultPrim = "W"\n    metersPerUnit = 1\n    upAxis = "Z"\n%s)\n'
TRIANGLE = """def Mesh "%s"
{
    point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
    int[] faceVertexCounts = [3]
    int[] faceVertexIndices = [0, 1, 2]
}
"""


def prim(name: str, inside: str, about: str = "") -> str:
    return f'def Xform "{name}" {f"({about})" if about else ""}\n{{\n{inside}\n}}\n'


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """An input beside a layer that is none of its own."""
    (tmp_path / "in" / "sub").mkdir(parents=True)
    (tmp_path / "out").mkdir()
    for place in ("out", "in/sub"):
        (tmp_path / place / "x.usda").write_text(HEAD % "" + prim("W", TRIANGLE % "Other"))
    (tmp_path / "in" / "link.usda").symlink_to(tmp_path / "out" / "x.usda")
    (tmp_path / "in" / "deep.usda").write_text(HEAD % "subLayers = [@../out/x.usda@]\n")
    return tmp_path / "in"


def stage(folder: Path, name: str, arc: str) -> Path:
    """A stage with one triangle that also names a layer, as a `sublayer`, a `reference` or in a `variant`."""
    head, about, more = "", "", ""
    if arc == "sublayer":
        head = f"subLayers = [@{name}@]\n"
    elif arc == "variant":
        about = 'variants = { string v = "a" }\nprepend variantSets = "v"'
        more = f'variantSet "v" = {{\n"a" (\nreferences = @{name}@\n) {{\n}}\n}}\n'
    else:
        about = f"{arc} = @{name}@"
    path = folder / "m.usda"
    path.write_text(HEAD % head + prim("W", TRIANGLE % "Own" + more, about))
    return path


def refused(path: Path) -> ArtifactError:
    with pytest.raises(ArtifactError) as caught:
        mesh_files.load(path)
    return caught.value


@pytest.mark.parametrize("arc", ["sublayer", "references", "payload", "variant"])
def test_a_layer_within_the_input_is_read(folder, arc):
    assert len(mesh_files.load(stage(folder, "sub/x.usda", arc)).faces) == 2


@pytest.mark.parametrize("arc", ["sublayer", "references", "payload", "variant"])
@pytest.mark.parametrize(
    "name",
    ["../out/x.usda", "{out}/x.usda", "./sub/../../out/x.usda", "link.usda", "deep.usda"],
)
def test_a_layer_outside_of_the_input_is_refused(folder, arc, name):
    named = name.format(out=folder.parent / "out")
    why = refused(stage(folder, named, arc)).facts["why"]
    assert why.endswith("lies outside of the input")
    assert (named if name != "deep.usda" else "../out/x.usda") in why


@pytest.mark.parametrize(
    "name", ["x.usda", "file:{out}/x.usda", "file://{out}/x.usda", "http://127.0.0.1/x.usda", '`"${{F}}"`']
)
def test_a_layer_that_is_no_file_of_the_input_is_missing(folder, name, monkeypatch):
    """A bare name is searched in the working folder by USD, but not here."""
    monkeypatch.chdir(folder.parent / "out")
    assert "is missing" in refused(stage(folder, name.format(out=folder.parent / "out"), "references")).facts["why"]


def test_a_layer_of_the_folder_above_is_read_if_the_input_holds_it(folder):
    (folder / "sub" / "m.usda").write_text(HEAD % "subLayers = [@../y.usda@]\n")
    (folder / "y.usda").write_text(HEAD % "" + prim("W", TRIANGLE % "Own"))
    assert len(mesh_files.load(folder / "sub" / "m.usda", within=folder).faces) == 1
    assert "lies outside" in refused(folder / "sub" / "m.usda").facts["why"]


PAINTED = """def Material "Look"
{
    token outputs:surface.connect = </W/Look/S.outputs:surface>
    def Shader "S"
    {
        uniform token info:id = "UsdPreviewSurface"
        color3f inputs:diffuseColor.connect = </W/Look/T.outputs:rgb>
        token outputs:surface
    }
    def Shader "T"
    {
        uniform token info:id = "UsdUVTexture"
        asset inputs:file = @%s@
        float3 outputs:rgb
    }
}
"""


@pytest.mark.parametrize("name", ["../out/a.png", "./sub/../../out/a.png", "{out}/a.png"])
def test_a_texture_outside_of_the_input_is_refused(folder, name, monkeypatch):
    (folder.parent / "out" / "a.png").write_bytes(b"")
    bound = TRIANGLE.replace('%s"\n', '%s" (\nprepend apiSchemas = ["MaterialBindingAPI"]\n)\n') % "Own"
    bound = bound.replace("{\n", "{\n    rel material:binding = </W/Look>\n", 1)
    path = folder / "m.usda"
    path.write_text(HEAD % "" + prim("W", PAINTED % name.format(out=folder.parent / "out") + bound))
    assert "lies outside of the input" in refused(path).facts["why"]


def tenfold(folder: Path, depth: int, about: str = "") -> Path:
    """Ten prims that each refer to one with ten prims, and so on."""
    levels = [prim("L0", TRIANGLE % "M")]
    for level in range(1, depth + 1):
        levels.append(
            prim(f"L{level}", "".join(prim(f"c{n}", "", f"{about}references = </L{level - 1}>") for n in range(10)))
        )
    path = folder / "m.usda"
    path.write_text(
        HEAD % ""
        + "".join(levels).replace('def Xform "L', 'class Xform "L')
        + prim("W", "", f"references = </L{depth}>")
    )
    return path


@pytest.mark.parametrize("about", ["", "instanceable = true\n"], ids=["references", "instances"])
def test_few_lines_do_not_become_billions_of_prims(folder, about, monkeypatch):
    assert len(mesh_files.load(tenfold(folder, 1, about)).faces) == 10
    monkeypatch.setattr(bounds, "MOST_PARTS", 500)
    error = refused(tenfold(folder, 9, about))
    assert error.code == "DXB-A407"
    assert error.message == "`m.usda` holds too many prims"
    assert error.facts["most"] == "500"
    assert error.hint


def test_references_to_one_prim_do_not_double_for_ever(folder):
    levels = [prim("X0", TRIANGLE % "M"), prim("Y0", TRIANGLE % "M")]
    for level in range(1, 30):
        both = f"references = [</X{level - 1}>, </Y{level - 1}>]"
        levels += [prim(f"X{level}", "", both), prim(f"Y{level}", "", both)]
    path = folder / "m.usda"
    path.write_text(
        HEAD % "" + "".join(levels).replace('def Xform "', 'class Xform "') + prim("W", "", "references = </X9>")
    )
    assert refused(path).message == "`m.usda` holds too many references to one prim"


def test_a_circle_of_layers_has_an_end(folder):
    (folder / "a.usda").write_text(HEAD % "subLayers = [@b.usda@]\n" + prim("W", TRIANGLE % "Own"))
    (folder / "b.usda").write_text(HEAD % "" + prim("W", "", "references = @a.usda@"))
    assert len(mesh_files.load(folder / "a.usda").faces) == 1


def test_value_clips_are_refused(folder):
    clips = "clips = { dictionary default = { asset templateAssetPath = @c.#.usd@\n double templateEndTime = 1e9 } }"
    (folder / "m.usda").write_text(HEAD % "" + prim("W", TRIANGLE % "Own", clips))
    assert "value clips" in refused(folder / "m.usda").facts["why"]


def test_links_of_the_folder_itself_count_as_inside(folder, tmp_path):
    os.symlink(folder, tmp_path / "again")
    assert len(mesh_files.load(tmp_path / "again" / stage(folder, "sub/x.usda", "references").name).faces) == 2
