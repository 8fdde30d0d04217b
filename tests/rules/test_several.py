"""Several photographs of one scene: poses, objects, shapes and what is behind the objects, with a known truth."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.cameras.further import Further, FurtherPhotographs
from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.objects.view import Seen
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.errors import RuleError
from dextera_build.geometry import transforms
from dextera_build.geometry.solids import Solid
from dextera_build.testing import RuleRunner
from rules.factorize.shapes.paint import paint
from tests import factories, tabletops
from tests.installed import needs
from tests.tabletops import Tabletop

pytest.importorskip("cv2")
needs("open3d", "pycolmap", "manifold3d")

RED, BLUE = (0.75, 0.1, 0.1), (0.1, 0.3, 0.8)
BOX = (0.1, 0.06, 0.14)
THINGS = (
    (tabletops.box(*BOX, RED), factories.pose(-0.1, 0.05, yaw=0.2)),
    (tabletops.cylinder(0.04, 0.11, BLUE), factories.pose(0.12, 0.0)),
)


def eye(degrees: float) -> np.ndarray:
    angle = np.radians(degrees)
    return factories.look_at((0.6 * np.sin(angle), -0.6 * np.cos(angle), 0.5))


def taken(degrees: float, things: Sequence = THINGS, **more: object) -> Tabletop:
    lens = more.pop("lens", tabletops.FINE)
    return tabletops.tabletop(*things, eye=eye(degrees), lens=lens, pattern=True, seed=int(degrees) % 360, **more)


@pytest.fixture(scope="module")
def shots() -> list[Tabletop]:
    return [taken(degrees) for degrees in (0, 35, -110)]


@pytest.fixture
def runner(tmp_path: Path) -> RuleRunner:
    return RuleRunner(tmp_path)


def motion(first: Tabletop, other: Tabletop) -> np.ndarray:
    """T_camera_further (4, 4)."""
    return transforms.invert(first.world_from_camera) @ other.world_from_camera


def listed(*shots: Tabletop, poses: Sequence[np.ndarray | None] = ()) -> FurtherPhotographs:
    stated = [*poses, *[None] * (len(shots) - len(poses))]
    return FurtherPhotographs(
        items=tuple(
            Further(
                file=f"{number}.png",
                capture=shot.capture,
                pose=None if pose is None else Pose(parent="camera", child="further", matrix=pose),
            )
            for number, (shot, pose) in enumerate(zip(shots, stated, strict=True), start=1)
        )
    )


def place(runner: RuleRunner, first: Tabletop, further: FurtherPhotographs) -> FurtherPhotographs:
    return runner.run("align.photographs", photo=first.capture, further=further)


@pytest.fixture(scope="module")
def twin(shots, tmp_path_factory) -> dict:
    """Support and objects of the first photograph, and the others with their true poses."""
    run = RuleRunner(tmp_path_factory.mktemp("twin")).run
    shot = factories.shot(shots[0].capture)
    support = run("align.support", **shot)
    elements = run("factorize.parse", **shot, support=support)
    objects = run("factorize.segment", **shot, support=support, elements=elements)
    posed = listed(*shots[1:], poses=[motion(shots[0], other) for other in shots[1:]])
    found = run(
        "factorize.further",
        photograph=shot["photograph"],
        objects=objects,
        support=support,
        photographs=posed,
    )
    return {"shot": shot, "support": support, "objects": objects, "posed": posed, "found": found}


@pytest.mark.medium
def test_a_photograph_is_placed_by_what_it_shares_with_the_first(runner, shots):
    (one,) = place(runner, shots[0], listed(shots[1])).items
    apart = transforms.invert(motion(shots[0], shots[1])) @ one.pose.matrix
    assert 1000 * np.linalg.norm(apart[:3, 3]) < 4.0
    assert np.degrees(transforms.angle(apart[:3, :3])) < 0.3
    assert runner.outcome.metrics["1.png: residual"][0] < 3.0


@pytest.mark.medium
def test_a_photograph_of_another_scene_is_refused(runner, shots):
    other = tabletops.tabletop((tabletops.bowl(), factories.pose(0, 0)), eye=eye(10), lens=tabletops.FINE)
    with pytest.raises(RuleError, match=r"`1\.png` cannot be placed: it shares no view") as caught:
        place(runner, shots[0], listed(other))
    assert "T_first_camera" in caught.value.hint


@pytest.mark.medium
def test_a_photograph_with_another_focal_length_is_refused(runner, shots):
    zoomed = tabletops.FINE.model_copy(update={"fx": 1.3 * tabletops.FINE.fx, "fy": 1.3 * tabletops.FINE.fy})
    shot = taken(20, lens=zoomed)
    photograph = shot.capture.photograph.model_copy(update={"camera": tabletops.FINE})
    wrong = Tabletop(shot.capture.model_copy(update={"photograph": photograph}), shot.labels, shot.world_from_camera)
    with pytest.raises(RuleError, match=r"`1\.png`") as caught:
        place(runner, shots[0], listed(wrong))
    assert caught.value.hint


@pytest.mark.slow
def test_a_stated_pose_is_kept_and_a_wrong_one_refused(runner, shots):
    true = motion(shots[0], shots[2])
    (one,) = place(runner, shots[0], listed(shots[2], poses=[true])).items
    assert np.array_equal(one.pose.matrix, true)
    near = motion(shots[0], shots[1])
    lower = near.copy()
    lower[:3, 3] += 0.08
    for wrong in (lower, transforms.invert(near)):
        with pytest.raises(RuleError, match=r"`1\.png` contradicts the other photographs: its stated pose") as caught:
            place(runner, shots[0], listed(shots[1], poses=[wrong]))
        assert "leave it out" in caught.value.hint


def test_without_depth_none_is_placed(runner, shots):
    bare = shots[0].capture.model_copy(update={"measured": None})
    with pytest.raises(RuleError, match="the first photograph has no depth"):
        runner.run("align.photographs", photo=bare, further=listed(shots[1]))
    assert runner.run("align.photographs", photo=bare, further=FurtherPhotographs()).items == ()


@pytest.mark.slow
def test_objects_are_found_from_behind(twin, shots):
    """From behind, the first photograph has seen little of them but their tops."""
    # A cylinder of 80 x 110 mm has the size of a can of 580 ml.
    true = {name: label for label, name in enumerate(("red_box", "blue_can"), start=1)}
    assert set(twin["found"].items) == set(true)
    for name, one in twin["found"].items.items():
        assert np.array_equal(one.view.mask, twin["objects"].items[name].view.mask)
        for further, shot in zip(one.further.items, shots[1:], strict=True):
            camera, lens = further.view.camera, shot.capture.photograph.camera
            left, top = round(lens.cx - camera.cx), round(lens.cy - camera.cy)
            box = np.s_[top : top + camera.height, left : left + camera.width]
            known = ~further.view.occluder
            assert tabletops.iou(further.view.mask & known, (shot.labels.labels[box] == true[name]) & known) > 0.93


@pytest.mark.slow
def test_what_only_a_further_photograph_shows_is_no_object(runner, twin, shots):
    hidden = (tabletops.box(0.05, 0.04, 0.05, (0.1, 0.6, 0.2)), factories.pose(-0.1, 0.25))
    more = listed(taken(-110, (*THINGS, hidden)), poses=[motion(shots[0], shots[2])])
    first = {"photograph": twin["shot"]["photograph"], "objects": twin["objects"], "support": twin["support"]}
    found = runner.run("factorize.further", **first, photographs=more)
    assert set(found.items) == set(twin["objects"].items)
    assert any("that the first photograph does not" in warning for warning in runner.outcome.warnings)


@pytest.fixture(scope="module")
def box(twin, tmp_path_factory) -> dict:
    """The red box from the first photograph alone, and from all."""
    runner = RuleRunner(tmp_path_factory.mktemp("box"))
    one = twin["found"].items["red_box"]
    given = {"view": one.view, "measured": one.measured, "support": twin["support"]}
    alone = runner.run("factorize.mesh", **given)
    both = runner.run("factorize.mesh", **given, further=one.further)
    return {"alone": alone, "both": both, "line": runner.outcome.line}


@pytest.mark.slow
def test_a_side_that_nobody_saw_is_measured(box):
    """The depth of the box; from the front, only its top shows it."""
    alone, both = box["alone"], box["both"]
    assert "2.png shows" in box["line"]
    assert both.unseen_fraction < alone.unseen_fraction - 0.2
    assert sum(both.further_seen) == pytest.approx(alone.unseen_fraction - both.unseen_fraction, abs=0.05)
    off = [np.abs(np.sort(made.mesh.extent) - np.sort(BOX)).max() for made in (alone, both)]
    assert off[1] < 0.0015
    assert off[1] < off[0] + 0.0003
    assert both.hypothesis == "box"


@pytest.mark.slow
def test_a_wall_has_the_colours_of_the_photograph_that_shows_it(twin, box):
    """The further photographs are all green: so are the walls that only they show, and no other."""
    one, shape = twin["found"].items["red_box"], box["both"]
    green = np.array([0, 180, 0], np.uint8)
    others = []
    for further in one.further.items:
        pixels = np.broadcast_to(green, further.view.rgb.pixels.shape).copy()
        view = further.view.model_copy(update={"rgb": Image(pixels=pixels)})
        others.append(Seen(view, further.measured))
    body = Solid(shape.mesh.vertices.astype(np.float64), shape.mesh.faces.astype(np.int64))
    shares = []
    for more in ((), tuple(others)):
        painted = paint(body, shape.pose.matrix, Seen(one.view, one.measured, more), 256)
        pixels = painted.pixels.astype(int)
        shares.append(float((pixels[..., 1] > 1.2 * pixels[..., 0]).mean()))
    assert shares[0] < 0.02
    assert shares[1] > 0.4 * sum(shape.further_seen)


@pytest.mark.slow
def test_what_is_behind_an_object_is_what_another_photograph_shows(runner, twin, shots):
    given = {**twin["shot"], "support": twin["support"], "instances": twin["objects"].map}
    alone = runner.run("background.static", **given)
    both = runner.run("background.static", **given, further=twin["posed"])
    assert "of what was hidden seen by others" in runner.outcome.line
    assert runner.outcome.metrics["hidden pixels seen by 1.png"][0] > 20.0
    empty = tabletops.tabletop(eye=shots[0].world_from_camera, lens=tabletops.FINE, noise=0.0, pattern=True)
    hidden = twin["objects"].map.labels > 0
    off = [
        float(np.square(made.image.pixels.astype(float) - empty.capture.photograph.rgb.pixels)[hidden].mean())
        for made in (alone, both)
    ]
    assert off[1] < 0.75 * off[0]
    outside = ~hidden & (np.abs(alone.image.pixels.astype(int) - both.image.pixels) < 30).all(axis=-1)
    assert outside.sum() > 0.97 * (~hidden).sum()
