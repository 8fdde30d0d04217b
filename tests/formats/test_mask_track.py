"""Masks over time: their archive, what is refused, and what they say."""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from PIL import Image as Pillow

from dextera_build.artifacts.base import File
from dextera_build.artifacts.cameras.mask_track import MaskTrack, palette
from dextera_build.errors import ArtifactError
from tests.artifacts.generated import values
from tests.artifacts.test_base import Memory

STAMPS = np.arange(5) / 10


def maps() -> np.ndarray:
    """A square that moves right, and another one that is gone after two frames."""
    labels = np.zeros((5, 24, 40), np.uint8)
    for number in range(5):
        labels[number, 4:12, 4 + 3 * number : 12 + 3 * number] = 1
    labels[:2, 14:20, 20:30] = 2
    return labels


def track(scores: Any = None) -> MaskTrack:
    sure = [None] * 5 if scores is None else scores
    return MaskTrack.of(("mug", "pen"), STAMPS, zip(maps(), sure, strict=True))


def same(first: MaskTrack, second: MaskTrack) -> bool:
    return first.encode(Memory().put) == second.encode(Memory().put)


@given(values(MaskTrack))
@settings(deadline=None, max_examples=30)
def test_a_file_gives_back_what_was_saved(tmp_path_factory, made):
    (path,) = made.save(tmp_path_factory.mktemp("zip") / "a.zip")
    assert same(MaskTrack.load(path), made)


def test_any_frame_is_read_by_its_number():
    made = track()
    assert np.array_equal(np.stack(list(made.every())), maps())
    assert np.array_equal(made.labels(3), maps()[3])
    with pytest.raises(ArtifactError, match="cannot be read as ZIP of a mask track"):
        made.labels(5)


def test_areas_tell_who_is_seen():
    made = track([[1.0, 0.5]] * 5)
    assert made.areas.tolist() == [[64, 60]] * 2 + [[64, 0]] * 3
    assert made.seen.sum(axis=0).tolist() == [5, 2]
    assert repr(made) == "MaskTrack(40 x 24 px, 5 frames, 0.40 s, mug in 5, pen in 2)"
    shown = np.asarray(Pillow.open(io.BytesIO(made.picture())))
    assert shown.shape == (24, 120, 3)
    assert {tuple(colour) for colour in shown.reshape(-1, 3).tolist()} == {(0, 0, 0), (128, 0, 0), (0, 128, 0)}


def test_the_archive_is_that_of_davis(tmp_path: Path):
    (path,) = track().save(tmp_path / "a.zip")
    with zipfile.ZipFile(path) as archive:
        assert archive.namelist() == [*(f"{number:05d}.png" for number in range(5)), "meta.json"]
        assert json.loads(archive.read("meta.json")) == {
            "names": ["mug", "pen"],
            "stamps_s": STAMPS.tolist(),
            "first": None,
        }
        for number, labels in enumerate(maps()):
            picture = Pillow.open(io.BytesIO(archive.read(f"{number:05d}.png")))
            assert picture.mode == "P"
            assert np.array_equal(np.array(picture), labels)
            assert np.array_equal(np.array(picture.convert("RGB")), palette()[labels])
    assert palette()[[0, 1, 2, 3, 255]].tolist() == [
        [0, 0, 0],
        [128, 0, 0],
        [0, 128, 0],
        [128, 128, 0],
        [224, 224, 192],
    ]


@pytest.mark.medium
def test_it_is_small():
    """300 frames of 640 x 480 px take 2 % of the bytes of their label maps at most."""
    labels = np.zeros((480, 640), np.uint8)
    rows, columns = np.indices(labels.shape)
    labels[(rows - 200) ** 2 + (columns - 300) ** 2 < 120**2] = 1
    labels[300:400, 100:250] = 2
    frames = ((np.roll(labels, number, axis=1), None) for number in range(300))
    made = MaskTrack.of(("a", "b"), np.arange(300) / 30, frames)
    assert len(made.file.data) < 0.02 * 300 * labels.size


def archive_of(path: Path, members: dict[str, bytes]) -> Path:
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return path


def png_of(labels: np.ndarray, mode: str = "L") -> bytes:
    written = io.BytesIO()
    Pillow.fromarray(labels).convert(mode).save(written, format="PNG")
    return written.getvalue()


def test_the_archive_of_another_program_is_read_with_times(tmp_path: Path):
    members = {f"Annotations/walk/{number}.png": png_of(labels) for number, labels in enumerate(maps())}
    path = archive_of(tmp_path / "a.zip", dict(reversed(members.items())))
    found = MaskTrack.load(path, stamps=STAMPS)
    assert found.names == ("1", "2")
    assert np.array_equal(np.stack(list(found.every())), maps())
    with pytest.raises(ArtifactError) as caught:
        MaskTrack.load(path)
    assert caught.value.facts["why"] == "it has no `meta.json`, so the times of its frames must be given"
    with pytest.raises(ArtifactError) as caught:
        MaskTrack.load(path, stamps=STAMPS[:3])
    assert caught.value.facts["why"] == "it holds 5 frames, and 3 times"


def test_another_or_a_damaged_archive_is_refused(tmp_path: Path):
    whole = track().save(tmp_path / "a.zip")[0].read_bytes()
    for data in (b"", b"no archive", whole[:-40], whole[:200] + b"?" * 60 + whole[260:]):
        (tmp_path / "b.zip").write_bytes(data)
        with pytest.raises(ArtifactError, match="cannot be read as ZIP of a mask track"):
            MaskTrack.load(tmp_path / "b.zip")
    for members in ({"a.txt": b""}, {"a.png": b"?"}, {"a.png": png_of(maps()[0], "RGB")}):
        with pytest.raises(ArtifactError, match="cannot be read as ZIP of a mask track"):
            MaskTrack.load(archive_of(tmp_path / "c.zip", members), stamps=STAMPS[:1])
    damaged = track().model_copy(update={"file": File(data=whole[:-40])})
    with pytest.raises(ArtifactError, match="cannot be read as ZIP of a mask track"):
        damaged.labels(0)


def test_frames_that_do_not_fit_are_refused():
    for frame in (np.zeros((3, 4), np.int32), np.full((3, 4), 2, np.uint8), np.zeros((4, 4), np.uint8)):
        frames = [(np.zeros((3, 4), np.uint8), None), (frame, None)]
        with pytest.raises(ArtifactError, match="frame 1 of a MaskTrack does not fit"):
            MaskTrack.of(("a",), STAMPS[:2], frames)


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"stamps": STAMPS[:4]}, "axis N is 5, but stamps says 4"),
        ({"names": ("mug",)}, r"`areas` is \(5, 2\) for 5 frames and 1 names"),
        ({"names": ("mug", "mug")}, "two objects have one name"),
        ({"stamps": STAMPS[::-1].copy()}, "its times do not increase"),
        ({"areas": np.full((5, 2), 500, np.int32)}, "larger than the frame"),
        ({"scores": np.full((5, 2), 1.5, np.float32)}, "a score is not within 0 and 1"),
    ],
)
def test_fields_that_contradict_one_another_are_refused(changed, why):
    made = track()
    fields = {name: getattr(made, name) for name in MaskTrack.model_fields}
    with pytest.raises(ArtifactError, match=why):
        MaskTrack(**fields | changed)


def test_a_video_without_frames_has_no_masks():
    with pytest.raises(ArtifactError, match="at least one of each is needed"):
        MaskTrack.of(("a",), np.zeros(0), [])
