"""Videos: any frame by its number, without decoding or holding the others."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dextera_build.artifacts.base import File
from dextera_build.artifacts.cameras import video as videos
from dextera_build.artifacts.cameras.video import Video
from dextera_build.errors import ArtifactError
from dextera_build.formats import video as video_files
from dextera_build.formats.h264 import yuv420

av = pytest.importorskip("av")
COUNT = 47


def pixels(number: int) -> np.ndarray:
    """A frame that tells its number: a bright column moves over a grey slope."""
    frame = np.empty((32, 64, 3), np.uint8)
    frame[:] = np.linspace(40, 120, 64, dtype=np.uint8)[None, :, None]
    frame[:, number : number + 4] = (230, 200, 60)
    return frame


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Video:
    path = tmp_path_factory.mktemp("video") / "a.mp4"
    return video_files.write(path, map(pixels, range(COUNT)), video_files.encoder(64, 32, 30.0, qp=16))


def shown(frame: np.ndarray) -> int:
    """The number of a frame, from its picture."""
    return int(np.argmax(np.convolve(frame[..., 0].mean(axis=0), np.ones(4), "valid")))


@pytest.mark.medium
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(numbers=st.lists(st.integers(0, COUNT - 1), max_size=8))
def test_frames_come_in_the_order_asked_for(video: Video, numbers: list[int]) -> None:
    found = video.frames(numbers)
    assert found.shape == (len(numbers), 32, 64, 3)
    assert [shown(frame) for frame in found] == numbers


def test_every_frame_comes_in_order(video: Video) -> None:
    assert [shown(frame) for frame in video.every()] == list(range(COUNT))
    assert np.abs(video.frames([5])[0].astype(int) - pixels(5)).mean() < 3


def test_the_index_has_every_frame_with_its_time(video: Video) -> None:
    assert np.allclose(video.stamps, np.arange(COUNT) / 30)
    assert np.diff(np.flatnonzero(video.is_key)).max() <= 10
    assert list(video.facts())[:3] == ["64 x 32 px", "47 frames", "1.53 s"]
    assert video.picture().startswith(b"\x89PNG")
    assert [key for _, key in video.packets()] == video.is_key.tolist()


def test_no_more_is_decoded_than_from_the_key_frame_on(video: Video, monkeypatch: pytest.MonkeyPatch) -> None:
    decoded = []
    opened = videos._opened

    class Container:
        """A container that counts what it decodes."""

        def __init__(self, inner: object) -> None:
            self.inner = inner

        def seek(self, *args: object, **options: object) -> None:
            self.inner.seek(*args, **options)  # type: ignore[attr-defined]

        def decode(self, stream: object) -> object:
            for frame in self.inner.decode(stream):  # type: ignore[attr-defined]
                decoded.append(frame.pts)
                yield frame

    class Opened:
        """`_opened` with such a container."""

        def __init__(self, file: File, name: str) -> None:
            self.whole = opened(file, name)

        def __enter__(self) -> tuple[Container, object]:
            container, stream = self.whole.__enter__()
            return Container(container), stream

        def __exit__(self, *error: object) -> object:
            return self.whole.__exit__(*error)  # type: ignore[arg-type]

    monkeypatch.setattr(videos, "_opened", Opened)
    video.frames([12, 44])
    keys = np.flatnonzero(video.is_key)
    assert len(decoded) == sum(number - keys[keys <= number].max() + 1 for number in (12, 44)) <= 20


def test_bytes_are_the_same_each_time(tmp_path: Path, video: Video) -> None:
    again = video_files.write(tmp_path / "b.mp4", map(pixels, range(COUNT)), video_files.encoder(64, 32, 30.0, qp=16))
    assert again.file == video.file
    assert b" rc=cqp mbtree=0 qp=16 ip_ratio=1.40 aq=0" in video.file.data  # no block is quantised by its surroundings
    assert video.save(tmp_path / "c.mp4") == [tmp_path / "c.mp4"]
    assert Video.load(tmp_path / "c.mp4").frames([7]).tolist() == video.frames([7]).tolist()


@pytest.mark.parametrize("suffix", [".mp4", ".mov", ".mkv"])
@pytest.mark.parametrize(
    ("codec", "options"),
    [
        ("libx264", {"bf": "3", "g": "12", "crf": "10"}),
        ("libx265", {"g": "12", "crf": "10", "x265-params": "bframes=3:log-level=none"}),
        ("mpeg4", {"bf": "2", "g": "12"}),
    ],
)
def test_other_encoders_with_reordered_frames_are_read(
    tmp_path: Path, codec: str, options: dict[str, str], suffix: str
) -> None:
    """With B-frames the order of decoding is not that of showing."""
    path = tmp_path / f"b{suffix}"
    with av.open(str(path), "w") as out:
        stream = out.add_stream(codec, rate=25)
        stream.width, stream.height, stream.pix_fmt, stream.bit_rate = 64, 32, "yuv420p", 4_000_000
        stream.options = options
        for number in range(COUNT):
            out.mux(stream.encode(av.VideoFrame.from_ndarray(pixels(number), format="rgb24")))
        out.mux(stream.encode(None))
    found = Video.load(path)
    assert [shown(frame) for frame in found.frames([46, 3, 30, 29])] == [46, 3, 30, 29]
    assert [shown(frame) for frame in found.every()] == list(range(COUNT))


def test_opening_decodes_no_frame(video: Video) -> None:
    with videos._opened(video.file, "a.mp4") as (container, stream):
        assert stream.codec_context.pix_fmt is None  # which FFmpeg learns by decoding
        assert next(container.decode(stream)).format.name == "yuv420p"


def test_errors_name_what_is_wrong(tmp_path: Path, video: Video) -> None:
    with pytest.raises(ArtifactError, match="has no frame 47") as caught:
        video.frames([3, 47])
    assert (caught.value.code, caught.value.facts) == ("DXB-A522", {"frames": "0 to 46"})
    (tmp_path / "a.mp4").write_bytes(b"no video")
    with pytest.raises(ArtifactError, match=r"`a.mp4` cannot be read as a video"):
        Video.load(tmp_path / "a.mp4")
    fields = {name: getattr(video, name) for name in Video.model_fields}
    with pytest.raises(ArtifactError, match="does not begin with a key frame") as caught:
        Video(**fields | {"is_key": ~video.is_key})
    assert caught.value.code == "DXB-A521"
    longer = Video(**fields | {"stamps": np.arange(60) / 30, "is_key": np.append(video.is_key, np.zeros(13, bool))})
    with pytest.raises(ArtifactError, match="cannot be read as a video") as caught:
        longer.frames([58])
    assert caught.value.facts["why"] == "frame 58 of its index is missing"


def test_the_conversion_is_that_of_bt_601() -> None:
    random = np.random.default_rng(0).integers(0, 256, (2, 4, 6, 3), dtype=np.uint8)
    r, g, b = np.moveaxis(random.astype(np.int64), -1, 0)
    luma = (66 * r + 129 * g + 25 * b + 128) // 256 + 16
    assert (yuv420(random)[:, :4] == luma).all()
    quads = random.astype(np.int64).reshape(2, 2, 2, 3, 2, 3).sum(axis=(2, 4))
    red = (quads @ [112, -94, -18] + 512) // 1024 + 128
    assert (yuv420(random)[:, 4:].reshape(2, 12)[:, 6:] == red.reshape(2, 6)).all()
