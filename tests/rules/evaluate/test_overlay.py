"""evaluate.overlay: the twin must cover the photograph's objects, pixel by pixel."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.objects.object import Asset
from dextera_build.artifacts.objects.view import InstanceMap
from dextera_build.artifacts.scenes.scene import Scene
from dextera_build.errors import RuleError
from dextera_build.geometry import metrics, raycast
from dextera_build.rule import Context, Options
from dextera_build.sim.model import model as models
from dextera_build.sim.model.fixed_bodies import hold
from dextera_build.sim.render import framing, rendering
from rules.background import static_planes
from rules.background.static import StaticOptions, static
from rules.evaluate import overlay_mujoco, overlay_stub, panels
from rules.evaluate.overlay import OverlayOptions, overlay
from rules.evaluate.panels import outlined
from rules.simulate.scene.scene import scene
from tests import factories

LENS, TABLE = factories.camera(), factories.support()


@pytest.fixture
def twin(tmp_path: Path) -> Scene:
    assets = {
        "box": factories.box_asset(factories.pose(-0.15)),
        "laptop": factories.laptop_asset(factories.pose(0.2, 0.1)),
    }
    return scene(
        Context(scratch=tmp_path), Collection[Asset](items=assets), factories.background(size=(240, 320)), TABLE, LENS
    )


def test_objects_are_where_ray_casting_says(twin: Scene) -> None:
    _, owner, _ = overlay_mujoco.render(Context(scratch=Path()), twin, Options())
    box = factories.box_asset(factories.pose(-0.15))
    surface = raycast.posed(
        box.body.links["base"].mesh.vertices, box.body.links["base"].mesh.faces, factories.pose(-0.15)
    )
    seen = raycast.render([surface], LENS.matrix(), TABLE.camera_pose.matrix, LENS.height, LENS.width).index >= 0
    found = owner == 0
    assert (found & seen).sum() / (found | seen).sum() > 0.97
    assert (owner == 1).sum() > 1000, "the lid belongs to the laptop"


@pytest.mark.medium
def test_a_scene_in_which_everything_is_held_is_seen_from_the_same_sides(twin: Scene, tmp_path: Path) -> None:
    held = twin.model_copy(
        update={"model": hold(twin.model, twin.bodies), "bodies": (), "held": twin.bodies},
    )
    (_, _, free), (_, _, fixed) = (
        overlay_mujoco.render(Context(scratch=tmp_path), each, Options()) for each in (twin, held)
    )
    for side, pixels in free.items():
        assert np.abs(pixels.astype(int) - fixed[side]).mean() < 2.0, side


@pytest.mark.medium
def test_default_flags_show_the_photograph(tmp_path: Path) -> None:
    """Nothing of the photograph's light is added a second time."""
    capture = factories.capture(LENS, TABLE)
    rows, columns = np.indices((240, 320))
    waves = 40 * np.sin(columns / 9.0) + 30 * np.sin(rows / 7.0)
    pixels = np.clip(capture.photograph.rgb.pixels + waves[..., None], 0, 255).astype(np.uint8)
    seen = factories.rgbd(pixels, capture.measured.depth.depth, LENS)
    nothing = InstanceMap(labels=np.zeros((240, 320), np.int32), fixed=np.zeros((240, 320), bool))
    context = Context(static_planes, static_planes.PlanesOptions(), scratch=tmp_path)
    empty = static(context, seen.photograph, TABLE, nothing, seen.measured, options=StaticOptions())
    away = factories.box_asset(factories.pose(0.0, -0.5))
    twin = scene(Context(scratch=tmp_path), Collection[Asset](items={"box": away}), empty, TABLE, LENS)
    drawn, owner, _ = overlay_mujoco.render(Context(scratch=tmp_path), twin, Options())
    table = (seen.measured.depth.depth > 0) & (seen.measured.depth.depth < 1.4) & (owner < 0)
    assert table.mean() > 0.3
    assert metrics.psnr(drawn, pixels, table) > 30.0


@pytest.mark.medium
def test_all_objects_are_whole_from_every_side(twin: Scene) -> None:
    model = models.compile_folder(twin.model)
    data = models.at_home(model)
    eye, names, aspect = twin.camera_pose.matrix[:3, 3], twin.bodies, LENS.width / LENS.height
    for turn, tilt in ((-0.9, None), (0.9, None), (3.1, None), (0.0, 1.3)):
        camera = framing.around(model, data, names, eye, turn, tilt, aspect)
        _, geoms = rendering.stock(model, data, [camera], LENS.height, LENS.width)
        owner = rendering.owners_of(model, geoms, names)
        edge = np.concatenate([owner[:3].ravel(), owner[-3:].ravel(), owner[:, :3].ravel(), owner[:, -3:].ravel()])
        assert {0, 1} <= set(np.unique(owner)), (turn, "both are seen")
        assert (edge < 0).all(), (turn, "none is cut")
        assert (owner >= 0).mean() > 0.03, (turn, "and they are not small")


@pytest.mark.parametrize("backend", [overlay_mujoco, overlay_stub])
def test_the_board_holds_eight_pictures(backend: ModuleType, twin: Scene, tmp_path: Path) -> None:
    context = Context(backend=backend, scratch=tmp_path)
    board = overlay(context, factories.capture(LENS, TABLE).photograph, twin, options=OverlayOptions())
    height, width = board.pixels.shape[:2]
    assert height > 4 * LENS.height
    assert width > 2 * LENS.width
    shown = 2 if backend is overlay_mujoco else 0
    assert context.outcome.line.startswith(f"{shown} of 2 objects in view, ")
    assert "PSNR" in context.outcome.metrics
    assert context.outcome.previews


def test_outlines_say_which_objects_are_held(twin: Scene, tmp_path: Path) -> None:
    owner = np.full((240, 320), -1, np.int32)
    owner[60:120, 20:120], owner[60:120, 180:300] = 0, 1
    grey, _, sides = overlay_stub.render(Context(scratch=tmp_path), twin, Options())

    class Seen:
        @staticmethod
        def render(
            ctx: Context, scene: Scene, options: Options
        ) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
            return grey, owner, sides

    held = twin.model_copy(update={"bodies": ("box",), "held": {"laptop": "it leans on box"}})
    photograph = factories.capture(LENS, TABLE).photograph
    context = Context(backend=Seen, scratch=tmp_path)
    found = overlay(context, photograph, held, options=OverlayOptions(blend=0.5)).pixels
    named, bare = (
        panels.board(photograph.rgb.pixels, grey, owner, names, 0.5, sides)
        for names in (("box", "laptop (held)"), ("box", "laptop"))
    )
    assert np.array_equal(found, named)
    assert not np.array_equal(found, bare)
    assert context.outcome.line.startswith("2 of 2 objects in view")


def test_outlines_follow_the_mask_and_leave_the_rest() -> None:
    photo = np.full((60, 80, 3), 100, np.uint8)
    owner = np.full((60, 80), -1, np.int32)
    owner[40:55, 20:60] = 0
    drawn = (outlined(photo, owner, ("a",)) != photo).any(axis=-1)
    assert drawn[40, 25:55].all()
    assert not drawn[43:52, 24:56].any()
    assert not drawn[57:, :].any()


@pytest.mark.parametrize("width", [320, 640, 1280, 1920])
def test_captions_are_read_where_a_report_shows_the_whole_board(width: int) -> None:
    size = panels.lettering(2 * width)
    assert size >= panels.SMALLEST_PX
    assert size * min(1.0, 760 / (2 * width)) >= 12  # pixels of the page
    titled = panels.titled(np.zeros((90, width, 3), np.uint8), "outlines of the twin on the photograph", size)
    inked = (titled[: titled.shape[0] - 90] < 128).any(axis=-1)
    rows, columns = np.nonzero(inked)
    assert rows.max() < inked.shape[0] - 1  # nothing is cut below ...
    if width >= 640:
        assert columns.max() < width - 1  # ... or at the side


def test_a_photograph_of_another_camera_is_refused(twin: Scene, tmp_path: Path) -> None:
    other = factories.capture(factories.camera(160, 120), TABLE).photograph
    with pytest.raises(RuleError, match="not the photograph's") as caught:
        overlay(Context(backend=overlay_stub, scratch=tmp_path), other, twin, options=OverlayOptions())
    assert caught.value.facts == {"photograph": "160 x 120 px", "scene": "320 x 240 px"}
