"""demonstrate.film: frames of recorded states."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dextera_build.artifacts.tasks.episode import Film
from dextera_build.building import one_file
from dextera_build.errors import RuleError
from dextera_build.sim.model import model as models
from dextera_build.sim.render import rendering
from dextera_build.testing import RuleRunner
from tests import episodes


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Film:
    runner = RuleRunner(tmp_path_factory.mktemp("film"))
    made: Film = runner.run(
        "demonstrate.film", bundle=episodes.bundle(), episodes=episodes.small(2, 12), view=episodes.view()
    )
    assert runner.outcome.line.startswith("2 episodes, 24 frames of 64 x 48 px")
    assert len(runner.outcome.previews) == 1
    return made


def test_a_frame_is_what_the_model_looks_like_in_that_state(film: Film) -> None:
    bundle, view = episodes.bundle(), episodes.view()
    model = models.compile_folder(bundle.model)
    data = mujoco.MjData(model)
    for index, episode in episodes.small(2, 12).items.items():
        # The first step was recorded at the start itself, which says everything in the model's own words.
        data.qpos[:] = episode.start.qpos
        mujoco.mj_forward(model, data)
        with rendering.through(model, view) as eye:
            expected = eye.rgb(data)
        difference = np.abs(film.pixels(index)[0].astype(int) - expected)
        assert difference.max() <= 2  # recorded poses are single precision


def test_the_box_rises_and_the_arm_moves(film: Film) -> None:
    pixels = film.pixels("0").astype(int)
    red = (pixels[..., 0] > 2 * pixels[..., 2] + 40) & (pixels[..., 1] < 60)
    rows = [np.nonzero(frame)[0].mean() for frame in red]
    assert rows[0] - rows[-1] > 2
    assert rows[0] == pytest.approx(rows[3], abs=0.5)
    assert np.abs(pixels[4] - pixels[0]).max() > 50


def test_every_episode_has_as_many_frames_as_steps(film: Film) -> None:
    assert {index: film.pixels(index).shape for index in film.frames} == dict.fromkeys(("0", "1"), (12, 48, 64, 3))


def test_the_same_episodes_give_the_same_bytes(film: Film, tmp_path: Path) -> None:
    again = RuleRunner(tmp_path).run(
        "demonstrate.film", bundle=episodes.bundle(), episodes=episodes.small(2, 12), view=episodes.view()
    )
    assert again.frames == film.frames


def test_a_stub_film_has_the_same_shape(film: Film, tmp_path: Path) -> None:
    stub = RuleRunner(tmp_path).run(
        "demonstrate.film",
        profile="stub",
        bundle=episodes.bundle(),
        episodes=episodes.small(2, 12),
        view=episodes.view(),
    )
    assert stub.pixels("1").shape == film.pixels("1").shape


def test_episodes_of_another_model_are_refused(tmp_path: Path) -> None:
    inputs = {"bundle": episodes.bundle(), "view": episodes.view()}
    ours = episodes.small(1)
    longer = ours.items["0"].start.model_copy(update={"qpos": np.zeros(30)})
    other = ours.model_copy(update={"items": {"0": ours.items["0"].model_copy(update={"start": longer})}})
    with pytest.raises(RuleError, match="not made in this task's model") as refused:
        RuleRunner(tmp_path).run("demonstrate.film", episodes=other, **inputs)
    assert refused.value.facts == {"positions of the start": "30", "of the model": "18"}
    unknown = ours.model_copy(update={"object_names": ("box", "teapot")})
    with pytest.raises(RuleError, match="no joint `teapot`") as refused:
        RuleRunner(tmp_path).run("demonstrate.film", episodes=unknown, **inputs)
    assert "case_lid_hinge" in refused.value.facts["joints"]


@pytest.mark.medium
@given(st.integers(1, 6), st.integers(1, 9), st.integers(1, 9), st.integers(0, 1000))
def test_packed_frames_come_back(steps: int, height: int, width: int, seed: int) -> None:
    pixels = np.random.default_rng(seed).integers(0, 256, (steps, height, width, 3), np.uint8)
    film = Film(frames={"a": Film.packed(pixels)}, width=width, height=height)
    np.testing.assert_array_equal(film.pixels("a"), pixels)


def test_it_exports_one_moving_picture_per_episode(film: Film, tmp_path: Path) -> None:
    from PIL import Image

    written = film.export(tmp_path, "film")
    assert [path.name for path in written] == ["0.png", "1.png"]
    with Image.open(written[1]) as picture:
        assert picture.n_frames == 12
        picture.seek(11)
        np.testing.assert_array_equal(np.asarray(picture.convert("RGB")), film.pixels("1")[11])


@pytest.mark.medium
def test_it_is_one_mp4_with_all_episodes_one_after_the_other(tmp_path: Path) -> None:
    av = pytest.importorskip("av")
    made = np.full((2, 5, 33, 49, 3), 40, np.uint8)
    for episode, step in np.ndindex(2, 5):  # a bright square, farther right in each frame
        made[episode, step, 8:24, 4 * (5 * episode + step) :][:, :8] = (230, 200, 60)
    film = Film(frames={name: Film.packed(made[row]) for row, name in enumerate("ab")}, width=49, height=33)
    (path,) = one_file.write(film, tmp_path / "film.mp4")  # as `dxb get -o film.mp4` does
    with av.open(path) as container:
        (stream,) = container.streams.video
        assert (stream.codec_context.name, float(stream.average_rate)) == ("h264", 20.0)
        frames = np.array([frame.to_ndarray(format="rgb24") for frame in container.decode(stream)])
    assert frames.shape == (10, 32, 48, 3)  # H.264 takes even sizes
    wanted = made.reshape(10, 33, 49, 3)[:, :32, :48]
    assert np.abs(frames.astype(int) - wanted).mean() < 6
    left = (frames[:, 8:24, :, 0].mean(axis=1) > 135).argmax(axis=1)
    assert np.abs(left - 4 * np.arange(10)).max() <= 1


def test_a_film_for_people_is_larger_and_shows_the_first_episodes(film: Film, tmp_path: Path) -> None:
    large = RuleRunner(tmp_path).run(
        "demonstrate.film",
        options={"first": 1, "width_px": 128},
        bundle=episodes.bundle(),
        episodes=episodes.small(2, 12),
        view=episodes.view(),
    )
    assert (list(large.frames), large.width, large.height) == (["0"], 128, 96)
    # Both look the same way: the large one, made small, is the small one but for its edges.
    small = large.pixels("0").reshape(12, 48, 2, 64, 2, 3).mean(axis=(2, 4))
    assert np.median(np.abs(small - film.pixels("0"))) < 3
