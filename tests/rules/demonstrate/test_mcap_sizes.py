"""demonstrate.mcap: what makes recordings small."""

from __future__ import annotations

from pathlib import Path

import av
import numpy as np
import pytest

from dextera_build.artifacts.tasks.episode import Episodes, Film
from dextera_build.testing import RuleRunner
from tests import episodes
from tests.rules.demonstrate.test_mcap import BOXES, STEPS, read


@pytest.fixture(scope="module")
def made() -> Episodes:
    return episodes.small(2, STEPS)


def test_pictures_can_be_a_video_of_h264(made: Episodes, tmp_path: Path) -> None:
    """Each message decodes after those since its key frame, as players of live streams expect it."""
    folder = RuleRunner(tmp_path).run(
        "demonstrate.mcap",
        bundle=episodes.bundle(),
        episodes=made,
        film=smooth(made),
        view=episodes.view(),
        options={"picture": "h264", "keyframe_every": 3},
    )
    assert b"/workspace/color/video" in folder.files["README.md"]
    rows = read(folder.files["episode-000001.mcap"])["/workspace/color/video"]
    shown = list(smooth(made).each("1"))
    for begin in (0, 3):
        decoder = av.CodecContext.create("h264", "r")
        found = [frame for _, message in rows[begin:] for frame in decoder.decode(av.Packet(bytes(message.data)))]
        found += decoder.decode(None)
        assert len(found) == STEPS - begin
        for frame, wanted in zip(found, shown[begin:], strict=True):
            assert np.abs(frame.to_ndarray(format="rgb24").astype(int) - wanted).mean() < 4.0
    message = rows[1][1]
    assert (message.format, message.frame_id) == ("h264", "workspace_color_optical_frame")
    assert (message.timestamp.sec, message.timestamp.nanosec) == (0, 50_000_000)


def smooth(made: Episodes) -> Film:
    """A film of a moving gradient, which a codec can follow."""
    x, y = np.meshgrid(np.arange(64), np.arange(48))
    frames = np.stack([np.stack([3 * x + 5 * t, 4 * y, 0 * x + 90], axis=-1) for t in range(STEPS)])
    packed = Film.packed(frames.clip(0, 255).astype(np.uint8))
    return Film(frames=dict.fromkeys(made.items, packed), width=64, height=48)


def test_shapes_can_be_in_one_file_beside_the_recordings(made: Episodes, tmp_path: Path) -> None:
    runner = RuleRunner(tmp_path)
    first, scaled = made.items["0"], made.items["1"]
    scaled = scaled.model_copy(update={"start": scaled.start.model_copy(update={"size_scale": {"box": 1.2}})})
    mixed = made.model_copy(update={"items": {"0": first, "1": scaled}})
    whole = runner.run("demonstrate.mcap", bundle=episodes.bundle(), episodes=made)
    beside = runner.run("demonstrate.mcap", bundle=episodes.bundle(), episodes=mixed, options={"shapes": "beside"})
    shapes = {"/robot_description", "/scene/objects", "/scene/static", *BOXES}
    each = read(whole.files["episode-000000.mcap"])
    scene = read(beside.files["scene.mcap"])
    assert set(scene) == shapes
    assert [repr(scene[topic]) for topic in sorted(shapes)] == [repr(each[topic]) for topic in sorted(shapes)]
    assert not shapes & set(read(beside.files["episode-000000.mcap"]))
    own = read(beside.files["episode-000001.mcap"])
    assert shapes & set(own) == {"/scene/objects", "/scene/box/robot_description"}
    ((_, objects),), ((_, all_objects),) = own["/scene/objects"], scene["/scene/objects"]
    (box,) = objects.markers
    (same,) = (each for each in all_objects.markers if each.header.frame_id == "box")
    corners = [np.array([(at.x, at.y, at.z) for at in marker.points]) for marker in (box, same)]
    np.testing.assert_allclose(corners[0], 1.2 * corners[1], rtol=1e-6)  # a start with other sizes has its own shapes
