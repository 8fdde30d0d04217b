"""What differs between two stored artifacts: nothing between equal ones, something between others, and how much."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from dextera_build import digest
from dextera_build.artifacts.base import Array, Artifact, Collection, File, Value
from dextera_build.artifacts.comparison.difference import by_field, differences
from dextera_build.artifacts.spatial.pose import Pose, Similarity
from dextera_build.artifacts.table import Column, Table
from dextera_build.geometry import transforms


class Inner(Value):
    """Plain."""

    count: int = 0
    names: tuple[str, ...] = ()


class Points(Artifact):
    """Points."""

    points: Annotated[np.ndarray, Array("N 3", "float32", finite=False)]
    size: float = 0.0
    inner: Inner = Inner()


class Codes(Artifact):
    """Whole numbers."""

    codes: Annotated[np.ndarray, Array("N", "int64")]


@pytest.fixture
def compare():
    blobs = {}

    def put(data):
        blobs[digest.of_bytes(data)] = data
        return digest.of_bytes(data)

    return lambda one, two: differences(one.encode(put), two.encode(put), blobs.__getitem__)


def points(*rows, **fields):
    return Points(points=np.array(rows, np.float32).reshape(-1, 3), **fields)


FLOATS = arrays.arrays(np.float32, st.tuples(st.integers(0, 3), st.just(3)), elements=st.floats(width=32))
ARTIFACTS = st.builds(
    Points,
    points=FLOATS,
    size=st.sampled_from([0.0, -0.0, 1.0]),
    inner=st.builds(Inner, count=st.integers(0, 1), names=st.lists(st.sampled_from("ab"), max_size=2).map(tuple)),
)


PARTS = st.dictionaries(st.sampled_from("xy"), ARTIFACTS, max_size=2)


@pytest.mark.medium
@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(PARTS, PARTS)
def test_there_is_a_difference_exactly_where_the_digests_differ(one, two):
    blobs = {}

    def put(data):
        blobs[digest.of_bytes(data)] = data
        return digest.of_bytes(data)

    sides = [Collection[Points](items=side).encode(put) for side in (one, two)]
    assert (differences(*sides, blobs.__getitem__) != []) == (sides[0] != sides[1])


def test_an_array_says_how_many_numbers_differ_and_by_how_much(compare):
    (found,) = compare(points([0, 0, 0], [1, 1, 1]), points([0, 0, 0.5], [1, 1.25, 1]))
    assert (found.path, found.kind, found.largest, found.changed, found.total) == ("points", "array", 0.5, 2, 6)
    assert str(found) == "float32 (2, 3): 2 of 6 differ, by 0.5 at most"


def test_an_array_of_another_form_says_both_and_its_bounds(compare):
    (found,) = compare(points([0, 0, 0], [1, 2, 3]), points([0, 0, 0]))
    assert found.largest is None
    assert (
        str(found) == "float32 (2, 3) within (0, 0, 0) and (1, 2, 3) -> float32 (1, 3) within (0, 0, 0) and (0, 0, 0)"
    )


def test_a_number_that_is_not_finite_is_infinitely_far_from_others_and_equal_to_itself(compare):
    (found,) = compare(points([math.nan, 0, math.inf]), points([0, 0, math.inf]))
    assert (found.largest, found.changed) == (math.inf, 1)
    assert compare(points([math.nan, 0, math.inf]), points([math.nan, 0, math.inf])) == []


def test_long_whole_numbers_are_told_apart(compare):
    big = 2**60
    (found,) = compare(Codes(codes=np.array([big, 1])), Codes(codes=np.array([big + 1, 1])))
    assert found.changed == 1
    assert found.largest > 0


def test_labels_and_values_are_in_the_path_and_not_in_the_field(compare):
    one = Collection[Points](items={"mug": points([0, 0, 0], size=1.0), "cup": points()})
    two = Collection[Points](items={"mug": points([0, 0, 2], size=1.5, inner=Inner(names=("a",)))})
    found = compare(one, two)
    assert [(d.path, d.kind) for d in found] == [
        ("items[cup]", "removed"),
        ("items[mug].inner.names[0]", "added"),
        ("items[mug].points", "array"),
        ("items[mug].size", "number"),
    ]
    assert [d.field for d in found] == ["items", "items.inner.names", "items.points", "items.size"]
    assert by_field(found) == {"items.points": 2.0, "items.size": 0.5, "items.inner.names": None, "items": None}


def test_types_and_bytes_are_named(compare):
    (found,) = compare(points(), File(data=b""))
    assert str(found) == "tests.Points -> File"
    (found,) = compare(File(data=b"a"), File(data=b"bc"))
    assert found.kind == "bytes"
    assert str(found).startswith("1 bytes ca978112 -> 2 bytes ")


def table(*rows):
    return Table(title="t", columns=(Column(name="part"), Column(name="height", unit="m")), rows=rows)


def test_a_table_is_compared_row_by_row(compare):
    found = compare(table(("mug", 0.1), ("cup", 0.2)), table(("new", 0.3), ("mug", 0.15)))
    assert [(d.path, str(d)) for d in found] == [
        ("rows[mug].height", "0.1 -> 0.15, by 0.05"),
        ("rows[cup]", '["cup", 0.2]'),
        ("rows[new]", '["new", 0.3]'),
    ]


def test_rows_of_one_name_are_compared_by_their_place(compare):
    found = compare(table(("mug", 1.0), ("mug", 2.0)), table(("mug", 1.0), ("mug", 3.0)))
    assert [d.path for d in found] == ["rows[1].height"]


def test_a_pose_that_moved_is_told_by_distance_and_angle_with_their_intervals(compare):
    turn = np.radians(1.0)
    moved = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    spread = np.diag([1e-6, 4e-6, 9e-6, 1e-8, 1e-8, 4e-8])
    old = Pose(parent="base", child="camera", matrix=np.eye(4), covariance=spread)
    new = old.model_copy(update={"matrix": transforms.rigid(moved, np.array([0.02, 0.0, 0.0]))})
    (found,) = compare(old, new)
    assert (found.kind, found.path, found.largest) == ("pose", "", pytest.approx(0.02))
    motion = found.motion
    assert motion.frames == "T_base_camera"
    assert motion.angle_deg == pytest.approx(1.0)
    # Both values vary by 1 mm along x and by 2e-4 rad about z.
    assert motion.distance_interval_m == pytest.approx((0.02 - 1.96 * 2**0.5 * 1e-3, 0.02 + 1.96 * 2**0.5 * 1e-3))
    assert np.subtract(*motion.angle_interval_deg[::-1]) == pytest.approx(2 * 1.96 * 2**0.5 * np.degrees(2e-4))
    assert str(found) == "T_base_camera moved by 20 mm [17.2, 22.8] and 1 deg [0.968, 1.03]"


def test_what_else_changed_of_a_pose_that_moved_is_told_too_and_so_are_its_numbers(compare, store):
    old = Similarity(parent="world", child="scene", matrix=np.eye(4), scale=2.0)
    far = transforms.rigid(np.eye(3), np.array([0.0, 0.0, 0.5]))
    new = old.model_copy(update={"matrix": far, "scale": 2.5})
    assert [(each.kind, each.path) for each in compare(old, new)] == [("pose", ""), ("number", "scale")]
    digests = [each.encode(store.writer) for each in (old, new)]
    assert by_field(differences(*digests, store.blobs.get, motions=False)) == {"matrix": 0.5, "scale": 0.5}


def test_poses_that_did_not_move_or_changed_their_frames_are_compared_field_by_field(compare):
    still = Pose(parent="base", child="camera", matrix=np.eye(4), stamp=1.0)
    assert [each.path for each in compare(still, still.model_copy(update={"stamp": 2.0}))] == ["stamp"]
    assert [each.path for each in compare(still, still.model_copy(update={"parent": "world"}))] == ["parent"]
    far = transforms.rigid(np.eye(3), np.array([0.0, 0.0, 0.5]))
    (found,) = compare(still, still.model_copy(update={"matrix": far}))
    assert str(found) == "T_base_camera moved by 500 mm and 0 deg"
