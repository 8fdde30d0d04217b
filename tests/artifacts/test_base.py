"""Artifacts: what they refuse, and that what is stored comes back."""

from __future__ import annotations

import json
from typing import Annotated, Any

import numpy as np
import pytest
from pydantic import AfterValidator

from dextera_build import digest
from dextera_build.artifacts.base import Artifact, Collection, File, Folder
from dextera_build.artifacts.cameras.camera import Camera, Capture, Measured, Photograph
from dextera_build.artifacts.cameras.image import DepthImage, Image
from dextera_build.artifacts.core.schema import schema_digest
from dextera_build.artifacts.objects.object import Body, Joint, Link, Shape
from dextera_build.artifacts.shapes.mesh import Hull, Mesh
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.errors import ArtifactError
from tests import factories

TETRA = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32)
FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]], np.int32)


class Memory(dict):
    """A store in memory."""

    def put(self, data: bytes) -> str:
        self[digest.of_bytes(data)] = data
        return digest.of_bytes(data)


def tetra(**more: object) -> Mesh:
    return Mesh(vertices=TETRA.copy(), faces=FACES.copy(), **more)


def shape() -> Shape:
    return Shape(
        mesh=tetra(),
        walls=(Hull(vertices=TETRA.copy()), Hull(vertices=TETRA + np.float32(1))),
        pose=factories.placed(np.eye(4)),
        hypothesis="box",
        hollow=False,
        residual_m=0.001,
        mask_iou=0.9,
        unseen_fraction=0.5,
        scores={"box": 1.0, "oval": 0.5},
    )


def body() -> Body:
    joint = Joint(
        name="hinge",
        type="revolute",
        parent="base",
        child="lid",
        origin=(0.0, 0.1, 0.0),
        axis=(1.0, 0.0, 0.0),
        lower=0.0,
        upper=2.0,
        position=1.9,
    )
    return Body(
        links={"base": Link(mesh=tetra()), "lid": Link(mesh=tetra())}, joints=(joint,), pose=factories.placed(np.eye(4))
    )


@pytest.mark.parametrize(
    "value",
    [
        tetra(),
        shape(),
        body(),
        Collection[Mesh](items={"a": tetra(), "b": tetra(colour=(1.0, 0.0, 0.0))}),
        File(data=b"x"),
        Folder(files={"a/b.txt": b"1", "c": b""}),
        Camera(width=4, height=3, fx=1.0, fy=1.0, cx=1.5, cy=1.0),
    ],
    ids=lambda value: value.name(),
)
def test_what_is_stored_comes_back(value: Artifact) -> None:
    memory = Memory()
    key = value.encode(memory.put)
    again = type(value).decode(key, memory.__getitem__)
    assert again.encode(Memory().put) == key


def test_equal_values_have_equal_digests_and_other_ones_have_not() -> None:
    keys = {shape().encode(Memory().put), shape().encode(Memory().put)}
    keys.add(shape().model_copy(update={"residual_m": 0.002}).encode(Memory().put))
    assert len(keys) == 2


def test_a_label_is_not_part_of_the_item() -> None:
    memory = Memory()
    first, second = (Collection[Mesh](items={label: tetra()}).encode(memory.put) for label in ("mug", "cup"))
    assert first != second
    items = [json.loads(memory[key])["fields"]["items"]["$map"] for key in (first, second)]
    assert list(items[0].values()) == list(items[1].values())


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: tetra().model_validate({"vertices": TETRA.astype(np.float64), "faces": FACES}), "dtype is float64"),
        (lambda: Mesh(vertices=TETRA[:, :2].copy(), faces=FACES), "axis 3 is 2, but the type says 3"),
        (lambda: Mesh(vertices=TETRA[0].copy(), faces=FACES), "shape is (3,)"),
        (lambda: Mesh(vertices=TETRA * np.float32(np.nan), faces=FACES), "12 of 12 numbers are not finite"),
        (lambda: Mesh(vertices=TETRA.copy(), faces=FACES + 1), "an index is out of range of the vertices"),
        (lambda: tetra(uv=np.zeros((4, 3, 2), np.float32)), "`uv` and `texture` go together"),
        (
            lambda: tetra(uv=np.zeros((3, 3, 2), np.float32), texture=Image(pixels=np.zeros((2, 2, 3), np.uint8))),
            "axis F is 3, but faces says 4",
        ),
        (lambda: Hull(vertices=TETRA.copy(), size=3), "Hull.size: Extra inputs are not permitted"),
        (lambda: Hull(), "Hull.vertices: Field required"),
        (lambda: Pose(parent="a", child="b", matrix=2 * np.eye(4)), "T_a_b is not a rigid motion"),
    ],
)
def test_what_does_not_fit_is_refused(make, message) -> None:
    with pytest.raises(ArtifactError) as caught:
        make()
    assert message in caught.value.message


def test_sizes_of_a_capture_must_agree() -> None:
    lens = Camera(width=4, height=3, fx=1.0, fy=1.0, cx=1.5, cy=1.0)
    photograph = Photograph(rgb=Image(pixels=np.zeros((3, 4, 3), np.uint8)), camera=lens)
    with pytest.raises(
        ArtifactError, match=r"Capture\.measured\.depth is 2 x 3 px, but the intrinsics are for 4 x 3 px"
    ):
        Capture(photograph=photograph, measured=Measured(depth=DepthImage(depth=np.zeros((3, 2), np.float32))))
    with pytest.raises(ArtifactError, match=r"Photograph\.rgb is 5 x 3 px, but the intrinsics are for 4 x 3 px"):
        Photograph(rgb=Image(pixels=np.zeros((3, 5, 3), np.uint8)), camera=lens)


def test_another_type_is_not_decoded() -> None:
    memory = Memory()
    with pytest.raises(ArtifactError, match="a Mesh is needed here, but a Hull came"):
        Mesh.decode(Hull(vertices=TETRA.copy()).encode(memory.put), memory.__getitem__)


def test_arrays_cannot_be_written_to() -> None:
    with pytest.raises(ValueError, match="read-only"):
        tetra().vertices[0] = 1.0


def test_a_closed_mesh_is_told_from_an_open_one() -> None:
    assert tetra().is_closed
    assert not Mesh(vertices=TETRA.copy(), faces=FACES[:3].copy()).is_closed
    turned = FACES.copy()
    turned[0] = turned[0, ::-1]
    assert not Mesh(vertices=TETRA.copy(), faces=turned).is_closed


def test_frames_must_meet() -> None:
    a_b, b_c = (Pose(parent=p, child=c, matrix=np.eye(4)) for p, c in (("a", "b"), ("b", "c")))
    assert ((a_b @ b_c).parent, (a_b @ b_c).child) == ("a", "c")
    assert a_b.inverse().parent == "b"
    with pytest.raises(ArtifactError, match="T_a_b cannot be followed by T_a_b"):
        a_b @ a_b


def test_a_schema_changes_with_its_fields() -> None:
    class Once(Artifact):
        size: float

    class Twice(Artifact):
        size: float
        more: int

    assert schema_digest(Once) == schema_digest(Once)
    assert schema_digest(Once) != schema_digest(Twice)
    assert schema_digest(Collection[Mesh]) != schema_digest(Collection[Hull])


def test_a_validator_in_a_type_leaves_no_address_in_its_digest():
    def checked() -> Any:
        return Annotated[int, AfterValidator(lambda value: value)] | None

    assert schema_digest(checked()) == schema_digest(checked()) == schema_digest(Annotated[int, ""] | None)
