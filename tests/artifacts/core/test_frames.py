"""Fields that hold a pose take it between their declared frames only."""

from __future__ import annotations

import json

import numpy as np
import pytest

from dextera_build import digest
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.core.frames import Frames
from dextera_build.artifacts.core.schema import schema_digest
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.artifacts.tasks.task import View
from dextera_build.errors import ArtifactError
from tests import factories
from tests.artifacts import generated

POSES = [
    (kind, name)
    for kind in generated.kinds()
    for name, info in kind.model_fields.items()
    if isinstance(info.annotation, type) and issubclass(info.annotation, Pose)
]


def view(pose: Pose) -> View:
    lens = Camera(width=8, height=6, fx=9.0, fy=9.0, cx=3.5, cy=2.5)
    return View(camera=lens, camera_pose=pose)


@pytest.mark.parametrize(("kind", "name"), POSES, ids=lambda value: getattr(value, "__name__", value))
def test_every_pose_in_an_artifact_declares_its_frames(kind, name) -> None:
    assert any(isinstance(mark, Frames) for mark in kind.model_fields[name].metadata)


def test_no_artifact_holds_a_motion_without_frames() -> None:
    bare = [
        f"{kind.__name__}.{name}"
        for kind in generated.kinds()
        for name, info in kind.model_fields.items()
        if any(getattr(mark, "shape", "") == "4 4" for mark in info.metadata)
    ]
    assert bare == ["Pose.matrix", "Similarity.matrix"]


def test_a_pose_between_other_frames_is_refused() -> None:
    pose = factories.placed(factories.look_at((0.0, -1.0, 0.5)), "camera")
    assert view(pose).camera_pose is pose
    with pytest.raises(ArtifactError, match="`camera_pose` is T_camera_world, but T_world_camera") as caught:
        view(pose.inverse())
    assert caught.value.code == "DXB-A207"
    with pytest.raises(ArtifactError, match="is T_reference_camera, but T_world_camera"):
        view(pose.model_copy(update={"parent": "reference"}))


def test_what_is_no_pose_is_refused() -> None:
    with pytest.raises(ArtifactError, match=r"View\.camera_pose"):
        view(np.eye(4))  # type: ignore[arg-type]


def test_a_stored_pose_between_other_frames_is_refused() -> None:
    store: dict[str, bytes] = {}

    def put(data: bytes) -> str:
        store[digest.of_bytes(data)] = data
        return digest.of_bytes(data)

    pose = factories.placed(factories.look_at((0.0, -1.0, 0.5)), "camera")
    header = json.loads(store[view(pose).encode(put)])
    assert View.decode(put(digest.canonical(header)), store.__getitem__).camera_pose.child == "camera"
    header["fields"]["camera_pose"]["$ref"] = pose.inverse().encode(put)
    with pytest.raises(ArtifactError, match="T_camera_world"):
        View.decode(put(digest.canonical(header)), store.__getitem__)


def test_frames_are_part_of_a_types_structure(monkeypatch: pytest.MonkeyPatch) -> None:
    before = schema_digest(View)
    schema_digest.cache_clear()
    monkeypatch.setattr(Frames, "describe", lambda self: f"T_{self.child}_{self.parent}")
    assert schema_digest(View) != before
    schema_digest.cache_clear()
