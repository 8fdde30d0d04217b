"""What the learned bonds join, and what they leave apart."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.objects.object import Support
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.geometry import transforms
from rules.factorize.measured import Workspace
from rules.factorize.regions import bonds, grouping, heights, partition, patches, proposals, relations
from tests import factories
from tests.tabletops import FINE, Tabletop, bowl, box, tabletop


def at(x: float, y: float, z: float = 0.0) -> np.ndarray:
    return transforms.rigid(np.eye(3), np.array([x, y, z]))


def snowman() -> list[tuple[Mesh, np.ndarray]]:
    """Two spheres of one colour on one another that run into each other."""
    balls = []
    for radius, z in ((0.06, 0.055), (0.04, 0.11)):
        ball = trimesh.creation.icosphere(3, radius)
        mesh = Mesh(
            vertices=ball.vertices.astype(np.float32), faces=ball.faces.astype(np.int32), colour=(0.2, 0.5, 0.2)
        )
        balls.append((mesh, at(0.0, 0.0, z)))
    return balls


def workspace(shown: Tabletop) -> Workspace:
    support = Support(
        camera_pose=factories.placed(shown.world_from_camera, "camera"),
        polygon=np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]),
    )
    assert shown.capture.measured is not None
    return Workspace(shown.capture.photograph, shown.capture.measured.depth.depth, support)


def parts_of(shown: Tabletop) -> tuple[patches.Surfaces, np.ndarray]:
    seen = workspace(shown)
    relief = heights.relief(seen)
    crop = patches.surfaces(relief, relief.raised & relief.over, seen, proposals.colour_lab(seen.pixels))
    return crop, patches.patches(crop)


def test_a_body_of_two_round_parts_is_one_object() -> None:
    found = proposals.scenery(workspace(tabletop(*snowman(), lens=FINE)))
    assert len(found.objects) == 1


def test_boxes_side_by_side_stay_two() -> None:
    pair = [
        (box(0.08, 0.06, 0.1, (0.7, 0.2, 0.2)), at(-0.041, 0.0)),
        (box(0.08, 0.1, 0.07, (0.2, 0.3, 0.7)), at(0.041, 0.0)),
    ]
    assert len(proposals.scenery(workspace(tabletop(*pair))).objects) == 2


def test_a_box_on_a_box_stays_two() -> None:
    pair = [(box(0.2, 0.15, 0.05, (0.7, 0.6, 0.2)), at(0, 0)), (box(0.07, 0.07, 0.07, (0.2, 0.3, 0.7)), at(0, 0, 0.05))]
    assert len(proposals.scenery(workspace(tabletop(*pair))).objects) == 2


def test_without_bonds_the_round_parts_are_two(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(grouping, "join_bonded", lambda parts: None)
    found = proposals.scenery(workspace(tabletop(*snowman(), lens=FINE)))
    assert len(found.objects) == 2


def test_features_are_bounded_and_the_same_in_any_order() -> None:
    parts = partition.Grouping(*parts_of(tabletop(*snowman(), lens=FINE)))
    known = bonds.Bonds(parts.surfaces)
    assert parts.contacts
    for (a, b), contact in parts.contacts.items():
        one, other = parts.groups[a], parts.groups[b]
        features = known.features(one, other, contact)
        assert features.shape == (len(bonds.NAMES),)
        assert np.isfinite(features).all()
        assert np.abs(features).max() < 6
        assert (features == known.features(other, one, contact)).all()
        assert known.score(one, other, contact) == known.score(other, one, contact)


@pytest.mark.parametrize(
    ("contact", "gentle"),
    [
        (relations.Contact(pairs=100, meeting=80, convex=40, turn=-8.0), True),
        # Only a depth step lies between them.
        (relations.Contact(pairs=100, meeting=5, convex=5, turn=0.0), False),
        # One stands on the other.
        (relations.Contact(pairs=100, meeting=80, convex=0, turn=-100.0), False),
    ],
)
def test_bonds_must_be_surer_across_steps_and_sharp_creases(contact: relations.Contact, gentle: bool) -> None:
    parts = partition.Grouping(*parts_of(tabletop(*snowman(), lens=FINE)))
    assert parts.bonds.gentle(contact) == gentle


def test_an_inner_surface_in_pieces_joins_its_vessel() -> None:
    """What noise or a missing depth cuts the inside of a bowl into is one object with its outside."""
    crop, labels = parts_of(tabletop((bowl(), at(0.0, 0.0))))
    whole = grouping.Grouping(crop, labels.copy())
    (inside,) = [number for number, group in whole.groups.items() if group.bend < relations.CAVITY_RAD]
    rows = np.nonzero(labels == inside)[0]
    near = (labels == inside) & (np.arange(len(labels))[:, None] > np.quantile(rows, 0.4))
    cut = np.where(near, labels.max() + 1, labels)
    parts = grouping.Grouping(crop, cut)
    grouping.join_cavities(parts)
    assert len([group for group in parts.groups.values() if group.area_m2 > grouping.SLIVER_M2]) == 1


@pytest.mark.parametrize(("odds", "objects"), [(-1.0, 1), (-3.0, 2)])
def test_a_part_of_the_same_colour_is_attached_unless_the_network_doubts_it(
    monkeypatch: pytest.MonkeyPatch, odds: float, objects: int
) -> None:
    colour = (0.8, 0.8, 0.75)
    pair = [(box(0.1, 0.08, 0.12, colour), at(0.0, 0.0)), (box(0.03, 0.03, 0.03, colour), at(0.078, -0.03))]
    monkeypatch.setattr(bonds.Bonds, "score", lambda *pair: odds)
    monkeypatch.setattr(grouping, "DOUBTED_CONVEX", -np.inf)
    assert len(proposals.scenery(workspace(tabletop(*pair))).objects) == objects


@pytest.mark.parametrize(("odds", "objects"), [(-1.0, 1), (-2.0, 2)])
def test_what_meets_convexly_is_one_object_unless_the_network_doubts_it(
    monkeypatch: pytest.MonkeyPatch, odds: float, objects: int
) -> None:
    """A box of which a front and a top are seen: two patches."""
    monkeypatch.setattr(bonds.Bonds, "score", lambda *pair: odds)
    parts = partition.Grouping(*parts_of(tabletop((box(0.12, 0.1, 0.1, (0.7, 0.2, 0.2)), at(0.0, 0.0)))))
    grouping.join_convex(parts)
    assert len([group for group in parts.groups.values() if group.area_m2 > grouping.SLIVER_M2]) == objects


def split_box(gap: tuple[float, float, float] | None) -> Workspace:
    """A low box without depth in a band across its top; the band shows `gap`, or else the box."""
    seen = workspace(tabletop((box(0.2, 0.08, 0.03, (0.1, 0.1, 0.12)), at(0.0, 0.0)), lens=FINE))
    relief = heights.relief(seen)
    band = relief.raised & (np.abs(relief.points[..., 0]) < 0.014)
    depth, pixels = np.where(band, 0.0, seen.depth).astype(np.float32), seen.pixels.copy()
    if gap is not None:
        pixels[band] = np.round(255 * np.array(gap))
    photograph = seen.photograph.model_copy(update={"rgb": Image(pixels=pixels)})
    return Workspace(photograph, depth, seen.support)


@pytest.mark.parametrize(("gap", "odds", "objects"), [(None, 1.5, 1), (None, 0.0, 2), ((0.9, 0.9, 0.2), 1.5, 2)])
def test_a_hole_in_the_depth_parts_no_object_of_its_colour(
    monkeypatch: pytest.MonkeyPatch, gap: tuple[float, float, float] | None, odds: float, objects: int
) -> None:
    monkeypatch.setattr(bonds.Bonds, "score", lambda *pair: odds)
    monkeypatch.setattr(grouping, "join_occluded", lambda parts: None)
    assert len(proposals.scenery(split_box(gap)).objects) == objects


def test_a_border_knows_its_steps_of_depth_and_colour() -> None:
    """A red box before a higher blue one: along the upper border of the nearer one both change."""
    pair = [
        (box(0.1, 0.06, 0.06, (0.8, 0.1, 0.1)), at(0.0, -0.04)),
        (box(0.16, 0.06, 0.14, (0.1, 0.2, 0.8)), at(0.0, 0.05)),
    ]
    parts = partition.Grouping(*parts_of(tabletop(*pair, lens=FINE)))
    colours = {number: group.colour for number, group in parts.groups.items()}
    seen = [
        contact
        for (a, b), contact in parts.contacts.items()
        if np.linalg.norm(colours[a] - colours[b]) > 50 and contact.pairs > 100
    ]
    assert seen
    assert max(contact.outlined / contact.pairs for contact in seen) > 0.8
    assert min(contact.contrast / contact.pairs for contact in seen) > 30
