"""simulate.usd: its post-condition and its backends."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import pytest
from pxr import Sdf

from dextera_build.artifacts.base import Collection, Folder
from dextera_build.artifacts.object import Asset
from dextera_build.errors import RuleError
from dextera_build.rule import Context, Options
from rules.simulate import usd_openusd, usd_stub
from rules.simulate.usd import usd
from tests import factories


def build(backend: object, path: Path) -> tuple[Folder, Context]:
    assets = Collection[Asset](items={"box": factories.box_asset(), "laptop": factories.laptop_asset()})
    context = Context(backend=backend, scratch=path)
    return usd(context, assets, factories.background(), factories.support(), factories.camera()), context


@pytest.mark.parametrize("backend", [usd_openusd, usd_stub])
def test_every_backend_writes_a_stage_with_its_objects(backend: ModuleType, tmp_path: Path) -> None:
    folder, context = build(backend, tmp_path)
    layer = Sdf.Layer.CreateAnonymous(".usda")
    assert layer.ImportFromString(folder.files["scene.usda"].decode())
    assert layer.defaultPrim == "World"
    assert layer.GetPrimAtPath("/World/laptop")
    assert context.outcome.line.startswith("2 objects, 1 joints, valid")


def test_an_invalid_stage_is_not_published(tmp_path: Path) -> None:
    class Broken:
        write = staticmethod(usd_stub.write)

        @staticmethod
        def problems(ctx: Context, folder: Folder, options: Options) -> list[str]:
            return ["Rule: something is wrong (/World)"]

    with pytest.raises(RuleError, match="the USD is not valid: Rule: something is wrong"):
        build(Broken, tmp_path)
