"""simulate.usd: its post-condition and its backends."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from pxr import Ar, Gf, Sdf, Usd, UsdGeom, UsdLux, UsdPhysics, UsdShade

from dextera_build.artifacts.base import Collection, Folder
from dextera_build.artifacts.objects.object import Asset
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.errors import RuleError
from dextera_build.rule import Context
from dextera_build.sim.usd import packing
from rules.simulate.scene import steady_mujoco, usd_openusd, usd_stub
from rules.simulate.scene.scene import scene
from rules.simulate.scene.steady import SteadyOptions, steady
from rules.simulate.scene.usd import UsdOptions, usd
from tests import factories, task_bundles

AS_WRITTEN = UsdOptions()
TEXTURE = "/World/box/Looks/base/Texture"


def build(backend: object, path: Path, options: UsdOptions = AS_WRITTEN) -> tuple[Folder, Context]:
    assets = Collection[Asset](items={"box": factories.box_asset(), "laptop": factories.laptop_asset()})
    context = Context(backend=backend, scratch=path)
    given = (assets, factories.background(), factories.support(), factories.camera())
    return usd(context, *given, options=options), context


@pytest.mark.parametrize("backend", [usd_openusd, usd_stub])
def test_every_backend_writes_a_stage_with_its_objects(backend: ModuleType, tmp_path: Path) -> None:
    folder, context = build(backend, tmp_path)
    layer = Sdf.Layer.CreateAnonymous(".usda")
    assert layer.ImportFromString(folder.files["scene.usda"].decode())
    assert layer.defaultPrim == "World"
    assert layer.GetPrimAtPath("/World/laptop")
    assert context.outcome.line.startswith("2 objects, 1 joint, valid")


@pytest.mark.parametrize(("form", "files"), [("usdc", {"scene.usdc", "textures/box.png"}), ("usdz", {"scene.usdz"})])
def test_the_binary_forms_hold_the_same_stage(form: packing.Form, files: set[str], tmp_path: Path) -> None:
    """The rule has validated it and compared it with MuJoCo's model by then."""
    places = [tmp_path / name for name in ("text", "binary", "again")]
    for place in places:
        place.mkdir()
    text, _ = build(usd_openusd, places[0])
    binary, context = build(usd_openusd, places[1], UsdOptions(form=form))
    assert "valid" in context.outcome.line
    assert files <= set(binary.files)
    binary.export(tmp_path / "out", "scene")
    stage = Usd.Stage.Open(str(tmp_path / "out" / packing.main(binary)))
    layer = Sdf.Layer.CreateAnonymous(".usda")
    layer.ImportFromString(text.files["scene.usda"].decode())
    assert stage.GetRootLayer().ExportToString() == layer.ExportToString()
    texture = UsdShade.Shader(stage.GetPrimAtPath(TEXTURE)).GetInput("file").Get().resolvedPath
    assert bytes(Ar.GetResolver().OpenAsset(Ar.ResolvedPath(texture)).GetBuffer()) == text.files["textures/box.png"]
    assert build(usd_openusd, places[2], UsdOptions(form=form))[0].files == binary.files


@pytest.mark.parametrize("white", [1500.0, 1.0])
def test_a_white_level_surface_has_the_luminance_that_is_asked_for(white: float, tmp_path: Path) -> None:
    folder, _ = build(usd_openusd, tmp_path, UsdOptions(white_nits=white))
    layer = Sdf.Layer.CreateAnonymous(".usda")
    layer.ImportFromString(folder.files["scene.usda"].decode())
    stage = Usd.Stage.Open(layer)
    found = np.zeros(3)
    for prim in stage.Traverse():
        if prim.HasAPI(UsdLux.LightAPI):
            light = UsdLux.LightAPI(prim)
            shown = light.GetIntensityAttr().Get() * np.array(light.GetColorAttr().Get())
            excluded = light.GetShadowLinkCollectionAPI().GetExcludesRel().GetTargets()
            assert excluded == ["/World/background"], "the room would keep the light out"
            if prim.IsA(UsdLux.DistantLight):
                assert light.GetNormalizeAttr().Get()
                turn = UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(0)
                shown *= -turn.TransformDir(Gf.Vec3d(0, 0, -1))[2] / np.pi
            found += shown
    np.testing.assert_allclose(found, white, rtol=1e-5)


def test_a_stage_may_leave_the_lights_to_its_viewer(tmp_path: Path) -> None:
    folder, _ = build(usd_openusd, tmp_path, UsdOptions(white_nits=0.0))
    assert b"Light" not in folder.files["scene.usda"]


def test_an_invalid_stage_is_not_published(tmp_path: Path) -> None:
    class Broken:
        write = staticmethod(usd_stub.write)

        @staticmethod
        def problems(*given: object) -> list[str]:
            return ["Rule: something is wrong (/World)"]

    with pytest.raises(RuleError, match="the USD is not valid: Rule: something is wrong"):
        build(Broken, tmp_path)


def test_what_the_scene_holds_is_not_free_in_the_stage(tmp_path: Path) -> None:
    items = {
        "a": factories.box_asset(),
        "b": factories.box_asset(factories.pose(0.03)),
        "far": factories.laptop_asset(factories.pose(0.9)),
    }
    assets, room = Collection[Asset](items=items), factories.background()
    twin = scene(Context(scratch=tmp_path), assets, room, factories.support(), factories.camera())
    steadied = steady(Context(backend=steady_mujoco, scratch=tmp_path), twin, options=SteadyOptions(seconds=1.0))
    assert set(steadied.held) > {"far"}, "a box inside another one, and a laptop beside the table"
    given = (assets, room, factories.support(), factories.camera())
    made = usd(Context(backend=usd_openusd, scratch=tmp_path), *given, steadied, options=AS_WRITTEN)
    free = usd(Context(backend=usd_openusd, scratch=tmp_path), *given, options=AS_WRITTEN)
    rigid, fixed = moving(made)
    assert fixed == {"/World/far"}
    assert {path.split("/")[2] for path in rigid} - {"far"} == set(steadied.bodies)
    assert moving(free)[1] == set()
    assert {path.split("/")[2] for path in moving(free)[0]} == {"a", "b", "far"}


def test_a_robot_stands_in_the_stage(tmp_path: Path) -> None:
    assets = Collection[Asset](items={"box": factories.box_asset()})
    given = (assets, factories.background(), factories.support(), factories.camera())
    robot = task_bundles.robot()
    base = Pose(parent="world", child="base", matrix=factories.pose(0.4, -0.3, 0.0, yaw=0.8))
    context = Context(backend=usd_openusd, scratch=tmp_path)
    made = usd(context, *given, robot=robot, base=base, options=AS_WRITTEN)
    assert "a robot of 5 joints" in context.outcome.line
    layer = Sdf.Layer.CreateAnonymous(".usda")
    layer.ImportFromString(made.files["scene.usda"].decode())
    assert layer.GetPrimAtPath("/World/robot/palm").GetInfo("displayName") == "robot/palm"
    with pytest.raises(RuleError, match="the robot has no place in the scene"):
        usd(context, *given, robot=robot, options=AS_WRITTEN)


def moving(folder: Folder) -> tuple[set[str], set[str]]:
    """Prims that are rigid bodies, and objects whose root is fixed to the world."""
    layer = Sdf.Layer.CreateAnonymous(".usda")
    layer.ImportFromString(folder.files["scene.usda"].decode())
    stage = Usd.Stage.Open(layer)
    rigid = {str(prim.GetPath()) for prim in stage.Traverse() if prim.HasAPI(UsdPhysics.RigidBodyAPI)}
    joints = [UsdPhysics.FixedJoint(prim) for prim in stage.Traverse() if prim.IsA(UsdPhysics.FixedJoint)]
    for joint in joints:
        assert not joint.GetBody0Rel().GetTargets()
        assert joint.GetPrim().HasAPI(UsdPhysics.ArticulationRootAPI)
        body = UsdGeom.Xformable(stage.GetPrimAtPath(joint.GetBody1Rel().GetTargets()[0]))
        place = body.ComputeLocalToWorldTransform(Usd.TimeCode.Default()).ExtractTranslation()
        assert Gf.IsClose(place, Gf.Vec3d(joint.GetLocalPos0Attr().Get()), 1e-6)
    return rigid, {str(joint.GetPath()).removesuffix("/Joints/held") for joint in joints}
