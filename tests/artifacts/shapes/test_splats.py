"""Gaussians as files: the columns of the authors' PLY, USD, and what is refused."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from PIL import Image as Pillow

from dextera_build.artifacts.shapes.splats import Splats
from dextera_build.artifacts.spatial.pose import Similarity
from dextera_build.errors import ArtifactError
from dextera_build.formats import registry, splats_ply, splats_usd
from dextera_build.geometry import ply
from tests import factories
from tests.artifacts.generated import values

FIELDS = ("means", "rotations", "scales", "opacities", "harmonics")


def same(first: Splats, second: Splats, tolerance: float) -> bool:
    arrays = [(getattr(first, name), getattr(second, name)) for name in FIELDS]
    return all(a.shape == b.shape and np.allclose(a, b, rtol=tolerance, atol=1e-7) for a, b in arrays)


@pytest.mark.slow
@given(values(Splats))
@settings(deadline=None, max_examples=30)
def test_a_file_gives_back_what_was_saved(tmp_path_factory, made):
    folder = tmp_path_factory.mktemp("splats")
    for suffix in (each for each in registry.suffixes(Splats) if each not in (".splat", ".spz")):  # rounded
        load = Splats.load if suffix == ".ply" else splats_usd.load
        (path,) = made.save(folder / f"a{suffix}")
        made.save(path)  # over what is there
        again = load(path)
        assert same(again, made, 5e-6)
        assert again.frame == made.frame
        assert load(path, frame="other").frame == "other"


def test_the_ply_has_the_columns_of_the_authors():
    made = factories.splats(3)
    table, _ = ply.read(splats_ply.ply(made))
    rest = [f"f_rest_{i}" for i in range(45)]
    order = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", *rest, "opacity"]
    order += ["scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
    assert list(table.dtype.names or ()) == order
    assert {table.dtype[name].str for name in order} == {"<f4"}
    assert np.allclose(1 / (1 + np.exp(-table["opacity"].astype(float))), made.opacities, atol=1e-7)
    assert np.allclose(np.exp(table["scale_1"].astype(float)), made.scales[:, 1])
    assert np.array_equal(table["rot_0"], made.rotations[:, 0])
    # As gsplat reads it: all of red, then green, then blue.
    by_channel = np.stack([table[name] for name in rest], axis=1).reshape(3, 3, 15).swapaxes(1, 2)
    assert np.array_equal(by_channel, made.harmonics[:, 1:])
    assert np.array_equal(table["f_dc_2"], made.harmonics[:, 0, 2])


def test_quaternions_of_any_length_are_read(tmp_path):
    made = factories.splats(3, coefficients=1)
    table, _ = ply.read(splats_ply.ply(made))
    for name in ("rot_0", "rot_1", "rot_2", "rot_3"):
        table[name] *= 7
    (tmp_path / "a.ply").write_bytes(ply.written(table))
    assert same(Splats.load(tmp_path / "a.ply"), made, 5e-6)


def test_clear_and_opaque_ones_stay_so(tmp_path):
    made = factories.splats(2).model_copy(update={"opacities": np.array([0.0, 1.0], np.float32)})
    (path,) = made.save(tmp_path / "a.ply")
    assert np.isfinite(ply.read(path.read_bytes())[0]["opacity"]).all()
    assert Splats.load(path).opacities == pytest.approx([0.0, 1.0], abs=1e-30)


def changed(drop: tuple[str, ...] = (), **more: float) -> bytes:
    table, _ = ply.read(splats_ply.ply(factories.splats(2, coefficients=4)))
    names = [name for name in table.dtype.names or () if name not in drop]
    names += [name for name in more if name not in names]
    made = np.zeros(len(table), [(name, "f4") for name in names])
    for name in names:
        made[name] = more[name] if name in more else table[name]
    return ply.written(made)


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (b"ply", "does not begin with a PLY header"),
        (changed(("scale_2",)), "it has no property `scale_2`"),
        (changed(("f_rest_3",)), "it has no property `f_rest_3`"),
        (changed(("f_rest_8",)), "8 properties `f_rest_...` are no degree"),
        (changed(filter_3d=1.0), "property `filter_3d` would be lost"),
        (changed(rot_0=0.0, rot_1=0.0, rot_2=0.0, rot_3=0.0), "2 quaternions are zero"),
    ],
)
def test_a_ply_of_something_else_is_refused(tmp_path, data, why):
    (tmp_path / "a.ply").write_bytes(data)
    with pytest.raises(ArtifactError, match=r"`a\.ply` cannot be read as a PLY of 3D Gaussians") as caught:
        Splats.load(tmp_path / "a.ply")
    assert why in caught.value.facts["why"]


def test_a_file_that_is_not_there_is_named(tmp_path):
    for load, name in ((Splats.load, "a.ply"), (splats_usd.load, "a.usda")):
        with pytest.raises(ArtifactError, match=f"`{name}` cannot be read as"):
            load(tmp_path / name)


def test_scales_that_overflow_are_refused(tmp_path):
    (tmp_path / "a.ply").write_bytes(changed(scale_0=1e4))
    with pytest.raises(ArtifactError, match=r"Splats\.scales: 2 of 6 numbers are not finite"):
        Splats.load(tmp_path / "a.ply")


@pytest.mark.parametrize(
    ("fields", "code", "message"),
    [
        ({"rotations": np.zeros((2, 4), np.float32)}, "DXB-A405", "Splats.rotations: 2 of 2 are of another length"),
        ({"scales": np.full((2, 3), -4, np.float32)}, "DXB-A405", "Splats.scales: 2 of 2 are not above 0"),
        ({"opacities": np.array([0.5, 2.2], np.float32)}, "DXB-A405", "Splats.opacities: 1 of 2 are outside 0..1"),
        ({"harmonics": np.zeros((2, 5, 3), np.float32)}, "DXB-A406", "5 coefficients are no degree"),
    ],
)
def test_what_does_not_fit_is_refused(fields, code, message):
    good = {name: getattr(factories.splats(2), name) for name in FIELDS}
    with pytest.raises(ArtifactError) as caught:
        Splats(**good | fields)
    assert caught.value.code == code
    assert message in caught.value.message


def test_moved_splats_move_back():
    made = factories.splats(20)
    matrix = factories.look_at((1.0, 2.0, 3.0))
    motion = Similarity(parent="world", child="object", matrix=matrix, scale=3.0)
    moved = made.moved(motion)
    assert moved.frame == "world"
    assert np.ptp(moved.means) > 2 * np.ptp(made.means)
    assert same(moved.moved(motion.inverse()), made, 1e-4)
    with pytest.raises(ArtifactError, match="a Splats in frame `object` cannot be moved by T_object_world"):
        made.moved(motion.inverse())


def test_a_camera_sees_them_in_their_frame():
    made, lens = factories.splats(50), factories.camera()
    pose = factories.placed(factories.look_at((1.0, -2.0, 1.0)), "camera", "object")
    seen = made.seen(lens, pose)
    assert seen.pixels.shape == (lens.height, lens.width, 3)
    assert seen.pixels.max() > 80
    with pytest.raises(ArtifactError, match="in frame `object` cannot be moved by T_camera_world"):
        made.seen(lens, factories.placed(pose.matrix, "camera"))


def test_its_picture_and_line():
    made = factories.splats(50, coefficients=9)
    pixels = np.asarray(Pillow.open(io.BytesIO(made.picture())))
    assert pixels.shape == (240, 320, 3)
    assert 0.02 < (pixels != 255).any(axis=2).mean() < 0.98
    assert repr(made).startswith("Splats(50 Gaussians, ")
    assert repr(made).endswith(" mm, degree 2, frame object)")


def stage(path: Any, edit: Any) -> Any:
    from pxr import Usd

    factories.splats(3, coefficients=4).save(path)
    made = Usd.Stage.Open(str(path))
    edit(made, made.GetDefaultPrim())
    made.GetRootLayer().Save()
    return path


def test_a_stage_is_valid_and_says_its_units(tmp_path):
    from pxr import Usd, UsdGeom, UsdVol

    (path,) = factories.splats(3).save(tmp_path / "a.usda")
    made = Usd.Stage.Open(str(path))
    assert UsdGeom.GetStageUpAxis(made) == "Z"
    assert UsdGeom.GetStageMetersPerUnit(made) == 1
    field = UsdVol.ParticleField3DGaussianSplat(made.GetDefaultPrim())
    assert field.GetRadianceSphericalHarmonicsDegreeAttr().Get() == 3
    assert len(field.GetRadianceSphericalHarmonicsCoefficientsAttr().Get()) == 3 * 16
    first = field.GetOrientationsAttr().Get()[0]
    assert np.allclose([first.real, *first.imaginary], factories.splats(3).rotations[0])


def test_units_axes_and_placement_of_a_stage_are_applied(tmp_path):
    from pxr import Gf, UsdGeom

    def edit(made: Any, prim: Any) -> None:
        UsdGeom.SetStageMetersPerUnit(made, 0.01)
        UsdGeom.SetStageUpAxis(made, "Y")
        UsdGeom.Xformable(prim).AddTranslateOp().Set(Gf.Vec3d(0, 200, 0))
        UsdGeom.Xformable(prim).AddScaleOp().Set(Gf.Vec3f(2, 2, 2))

    before, after = factories.splats(3, coefficients=4), splats_usd.load(stage(tmp_path / "a.usda", edit))
    x, y, z = (0.02 * before.means.astype(float)).T
    assert np.allclose(after.means, np.stack([x, -z, y + 2], axis=1), atol=1e-6)
    assert np.allclose(after.scales, 0.02 * before.scales)


@pytest.mark.parametrize(
    ("edit", "why"),
    [
        (lambda made, prim: made.RemovePrim(prim.GetPath()), "it holds 0 prims `ParticleField3DGaussianSplat`"),
        (lambda made, prim: prim.RemoveProperty("scales"), "`scales` is not authored"),
        (lambda made, prim: prim.GetAttribute("opacities").Set([1.0]), "its arrays are of different lengths: [1"),
        (lambda made, prim: prim.GetAttribute("radiance:sphericalHarmonicsDegree").Set(4), "of degree 4; 0 to 3"),
        (lambda made, prim: scaled(prim), "its transform mirrors, shears or scales unevenly"),
    ],
)
def test_a_stage_of_something_else_is_refused(tmp_path, edit, why):
    with pytest.raises(ArtifactError, match="cannot be read as USD of 3D Gaussians") as caught:
        splats_usd.load(stage(tmp_path / "a.usda", edit))
    assert why in caught.value.facts["why"]


def scaled(prim: Any) -> None:
    from pxr import Gf, UsdGeom

    UsdGeom.Xformable(prim).AddScaleOp().Set(Gf.Vec3f(1, 2, 1))


def test_what_is_no_usd_is_refused(tmp_path):
    (tmp_path / "a.usda").write_text("no stage")
    with pytest.raises(ArtifactError, match=r"`a\.usda` cannot be read as USD"):
        splats_usd.load(tmp_path / "a.usda")
