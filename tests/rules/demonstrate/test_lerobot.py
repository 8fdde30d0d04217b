"""demonstrate.lerobot: indices, statistics and videos agree with the episodes, however the files are cut."""

from __future__ import annotations

import io
import json
import tempfile
from pathlib import Path
from typing import Any

import av
import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.tasks.episode import Episodes, Film
from dextera_build.artifacts.tasks.task import ActionKind
from dextera_build.errors import RuleError
from dextera_build.formats import h264
from dextera_build.policy import actions
from dextera_build.sim.control.action_map import ActionMap
from dextera_build.testing import RuleRunner
from rules.demonstrate import lerobot_stats, rolling
from tests import episodes

KEY = "observation.images.workspace"
LENGTHS = st.lists(st.integers(1, 9), min_size=1, max_size=12)


def of_lengths(lengths: list[int], rate_hz: float = 20.0) -> Episodes:
    """Episodes of these lengths; there are more than nine, so that their spelling is not their order."""
    items = {str(number): episodes.episode(steps, seed=number) for number, steps in enumerate(lengths)}
    return episodes.small(1).model_copy(update={"items": items, "rate_hz": rate_hz})


def filmed(made: Episodes, size: int = 16) -> Film:
    """A film in which every frame has one brightness, which says its episode and step."""
    frames = {}
    for number, (label, episode) in enumerate(made.in_order()):
        light = 20 + 16 * number + np.arange(len(episode.joints))
        frames[label] = Film.packed(np.tile(light[:, None, None, None], (1, size, size, 3)).astype(np.uint8))
    return Film(frames=frames, width=size, height=size)


def written(made: Episodes, film: Film | None = None, **options: object) -> Folder:
    view = episodes.view(film.width, film.height) if film else episodes.view()
    inputs: dict[str, Any] = {"episodes": made, "view": view} | ({"film": film} if film else {})
    with tempfile.TemporaryDirectory() as scratch:
        folder: Folder = RuleRunner(scratch).run(
            "demonstrate.lerobot", options=options, bundle=episodes.bundle(), **inputs
        )
    return folder


def rows(folder: Folder) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = pq.read_table(
        io.BytesIO(folder.files["meta/episodes/chunk-000/file-000.parquet"])
    ).to_pylist()
    return found


def steps(folder: Folder, name: str) -> dict[str, np.ndarray]:
    """Columns of one data file."""
    table = pq.read_table(io.BytesIO(folder.files[name]))
    return {column: np.array(table[column].to_pylist()) for column in table.column_names}


def info(folder: Folder) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(folder.files["meta/info.json"])
    return found


@pytest.mark.slow
@settings(max_examples=30, deadline=None)
@given(lengths=LENGTHS, kilobytes=st.sampled_from([0.1, 1.0, 2.5, 1000.0]), per_chunk=st.integers(1, 3))
def test_indices_run_on_over_all_files(lengths: list[int], kilobytes: float, per_chunk: int) -> None:
    made = of_lengths(lengths)
    folder = written(made, data_file_mb=kilobytes / 1024, files_per_chunk=per_chunk)
    names = sorted(name for name in folder.files if name.startswith("data/"))
    parts = [steps(folder, name) for name in names]
    whole = {column: np.concatenate([part[column] for part in parts]) for column in parts[0]}
    np.testing.assert_array_equal(whole["index"], np.arange(sum(lengths)))
    np.testing.assert_array_equal(whole["episode_index"], np.repeat(np.arange(len(lengths)), lengths))
    np.testing.assert_array_equal(whole["frame_index"], np.concatenate([np.arange(n) for n in lengths]))
    np.testing.assert_array_equal(whole["timestamp"], (whole["frame_index"] / 20).astype(np.float32))
    np.testing.assert_array_equal(np.flatnonzero(whole["next.done"]), np.cumsum(lengths) - 1)
    np.testing.assert_array_equal(whole["next.done"], whole["next.success"])
    facts = info(folder)
    assert (facts["total_episodes"], facts["total_frames"]) == (len(lengths), sum(lengths))
    if kilobytes == 0.1:
        assert len(names) == len(lengths)
        assert (
            names[-1]
            == f"data/chunk-{(len(names) - 1) // per_chunk:03d}/file-{(len(names) - 1) % per_chunk:03d}.parquet"
        )


@pytest.mark.slow
@settings(max_examples=20, deadline=None)
@given(lengths=LENGTHS, kilobytes=st.sampled_from([0.1, 1.0, 2.5]), per_chunk=st.integers(1, 3))
def test_an_episode_lies_where_its_row_says(lengths: list[int], kilobytes: float, per_chunk: int) -> None:
    made = of_lengths(lengths)
    folder = written(made, data_file_mb=kilobytes / 1024, files_per_chunk=per_chunk)
    template = info(folder)["data_path"]
    found = rows(folder)
    assert [row["episode_index"] for row in found] == list(range(len(lengths)))
    for row, (label, episode) in zip(found, made.in_order(), strict=True):
        name = template.format(chunk_index=row["data/chunk_index"], file_index=row["data/file_index"])
        part = steps(folder, name)
        own = part["episode_index"] == row["episode_index"]
        span = np.arange(row["dataset_from_index"], row["dataset_to_index"])
        np.testing.assert_array_equal(part["index"][own], span)
        np.testing.assert_array_equal(part["action"][own], episode.action)
        np.testing.assert_array_equal(part["observation.state"][own], episode.joints)
        world = part["observation.environment_state"][own]
        np.testing.assert_array_equal(world[:, 7:14], episode.objects[:, 1])
        np.testing.assert_array_equal(world[:, 14:], episode.displacement)
        assert row["label"] == label
        assert row["length"] == len(span) == len(episode.joints)


@pytest.mark.slow
@settings(max_examples=15, deadline=None)
@given(lengths=LENGTHS, kilobytes=st.sampled_from([0.5, 2.0, 1000.0]), every=st.integers(1, 6))
def test_a_video_has_the_episodes_frames_where_their_rows_say(lengths: list[int], kilobytes: float, every: int) -> None:
    made = of_lengths(lengths)
    folder = written(made, filmed(made), video_file_mb=kilobytes / 1024, keyframe_every=every, files_per_chunk=2)
    template = info(folder)["video_path"]
    shown = {name: decoded(data) for name, data in folder.files.items() if name.endswith(".mp4")}
    assert sum(len(times) for times, _ in shown.values()) == sum(lengths)
    for row in rows(folder):
        place = {part: row[f"videos/{KEY}/{part}"] for part in ("chunk_index", "file_index")}
        times, light = shown[template.format(video_key=KEY, **place)]
        first, last = row[f"videos/{KEY}/from_timestamp"], row[f"videos/{KEY}/to_timestamp"]
        own = (times > first - 0.01) & (times < last - 0.01)
        np.testing.assert_allclose(times[own], first + np.arange(row["length"]) / 20, atol=1e-9)
        expected = 20 + 16 * row["episode_index"] + np.arange(row["length"])
        np.testing.assert_allclose(light[own], expected, atol=2.0)


def decoded(data: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Times [s] and mean brightness of all frames."""
    with av.open(io.BytesIO(data)) as container:
        frames = [(frame.time, frame.to_ndarray(format="rgb24").mean()) for frame in container.decode(video=0)]
    times, light = zip(*frames, strict=True)
    return np.array(times), np.array(light)


def test_statistics_are_numpys() -> None:
    made = of_lengths([5, 9, 2])
    film = filmed(made)
    folder = written(made, film, data_file_mb=0.001)
    stats = json.loads(folder.files["meta/stats.json"])
    parts = [steps(folder, name) for name in sorted(folder.files) if name.startswith("data/")]
    for feature in parts[0]:
        values = np.concatenate([part[feature] for part in parts]).reshape(16, -1).astype(float)
        _agree(stats[feature], values, (values.shape[1],))
        first = rows(folder)[1]
        own = {name: first[f"stats/{feature}/{name}"] for name in stats[feature]}
        _agree(own, values[5:14], (values.shape[1],))
    pixels = np.concatenate([film.pixels(label).reshape(-1, 3) for label, _ in made.in_order()]) / 255
    _agree(stats[KEY], pixels, (3, 1, 1), count=16)


def _agree(stats: dict[str, Any], values: np.ndarray, shape: tuple[int, ...], count: int | None = None) -> None:
    expected = {"min": values.min(0), "max": values.max(0), "mean": values.mean(0), "std": values.std(0)}
    expected |= {f"q{round(100 * q):02d}": np.quantile(values, q, axis=0) for q in (0.01, 0.1, 0.5, 0.9, 0.99)}
    assert stats.keys() == expected.keys() | {"count"}
    assert stats["count"] == [len(values) if count is None else count]
    for name, value in expected.items():
        np.testing.assert_allclose(np.array(stats[name]), value.reshape(shape), atol=1e-9, err_msg=name)


@given(st.lists(st.integers(0, 255), min_size=1, max_size=40))
def test_quantiles_of_a_histogram_are_those_of_the_pixels(levels: list[int]) -> None:
    pixels = np.repeat(np.array(levels, np.uint8), 3).reshape(1, 1, -1, 3)
    _agree(
        lerobot_stats.plain({"x": lerobot_stats.of_pictures(lerobot_stats.histogram(pixels), 1)})["x"],
        pixels.reshape(-1, 3) / 255,
        (3, 1, 1),
        count=1,
    )


def test_every_episode_can_be_begun_again() -> None:
    made = episodes.small(3, 6, seed=4)
    folder = written(made)
    for row, (_, episode) in zip(rows(folder), made.in_order(), strict=True):
        assert row["start/seed"] == episode.start.seed
        np.testing.assert_array_equal(row["start/qpos"], episode.start.qpos)
        np.testing.assert_array_equal(row["start/ctrl"], episode.start.ctrl)
        dynamics = json.loads(row["start/dynamics"])
        assert dynamics["friction"] == episode.start.friction
        assert dynamics["mass_scale"] == episode.start.mass_scale
        assert dynamics["gain_scale"] == episode.start.gain_scale
        assert dynamics["base_error"] == list(episode.start.base_error)
        assert row["origin"] == "operator"
        assert [segment["name"] for segment in json.loads(row["segments"])] == ["approach", "lift"]
    about = json.loads(folder.files["meta/dextera.json"])
    assert about["failures"] == {"3": "box: not lifted"}
    assert about["attempts"] == 4
    assert about["task"]["goal"]["height_m"] == 0.1
    camera = json.loads(folder.files["meta/cameras.json"])["workspace"]
    assert camera["fx"] == episodes.view().camera.fx
    world = episodes.WORLD_FROM_BASE @ np.array(camera["base_from_camera"])
    np.testing.assert_allclose(world, episodes.view().camera_pose.matrix, atol=1e-12)


def test_a_data_file_has_a_row_group_per_episode_and_the_declared_features() -> None:
    folder = written(of_lengths([3, 4, 5]))
    file = pq.ParquetFile(io.BytesIO(folder.files["data/chunk-000/file-000.parquet"]))
    assert [file.metadata.row_group(group).num_rows for group in range(file.num_row_groups)] == [3, 4, 5]
    declared = info(folder)["features"]
    assert set(file.schema_arrow.names) == set(declared)
    assert declared["action"] == {"dtype": "float32", "shape": [3], "names": ["joint_1", "joint_2", "joint_3"]}
    assert declared["observation.goal"]["names"] == ["rise"]
    assert declared["observation.environment_state"]["names"][7:9] == ["case.x", "case.y"]


def test_policies_are_offered_nothing_privileged() -> None:
    offered = [
        name for name in info(written(of_lengths([3])))["features"] if name.startswith(("observation", "action"))
    ]
    assert offered == ["observation.state", "observation.environment_state", "observation.goal", "action"]


@pytest.mark.parametrize(
    ("name", "words"), [("CloseLaptop", "close laptop"), ("PushT", "push t"), ("lift_it", "lift_it")]
)
def test_the_instruction_is_the_tasks_name_in_words(name: str, words: str, tmp_path: Path) -> None:
    bundle = episodes.bundle()
    bundle = bundle.model_copy(update={"task": bundle.task.model_copy(update={"name": name})})
    folder = RuleRunner(tmp_path).run("demonstrate.lerobot", bundle=bundle, episodes=of_lengths([2]))
    tasks = pq.read_table(io.BytesIO(folder.files["meta/tasks.parquet"]))
    assert tasks.to_pylist() == [{"task_index": 0, "task": words}]
    said = written(of_lengths([2]), instruction="Lift the box.")
    assert rows(said)[0]["tasks"] == ["Lift the box."]


def test_the_same_episodes_give_the_same_bytes() -> None:
    made = of_lengths([4, 6])
    assert written(made, filmed(made)).files == written(made, filmed(made)).files


def test_a_video_ends_before_single_precision_does() -> None:
    made = of_lengths([3, 3, 3], rate_hz=0.006)  # 500 s each
    folder = written(made, filmed(made))
    assert sum(name.endswith(".mp4") for name in folder.files) == 2


@given(st.lists(st.floats(0.01, 5.0), min_size=1, max_size=20), st.floats(0.1, 8.0), st.integers(1, 4))
def test_files_are_filled_in_order_and_not_beyond_their_limit(sizes: list[float], limit: float, per: int) -> None:
    roll = rolling.Roll(limit, per)
    where = [roll.place(size) for size in sizes]
    numbers = [place.chunk * per + place.file for place in where]
    assert all(0 <= place.file < per for place in where)
    assert sorted(set(numbers)) == list(range(numbers[-1] + 1))
    assert numbers == sorted(numbers)
    for place in set(where):
        members = [size for size, own in zip(sizes, where, strict=True) if own == place]
        assert len(members) == 1 or sum(members) <= limit + 1e-9


@pytest.mark.parametrize("colour", [(255, 0, 0), (0, 255, 0), (0, 0, 255), (250, 250, 250), (0, 0, 0), (90, 120, 30)])
def test_colours_come_back(colour: tuple[int, int, int]) -> None:
    pixels = np.tile(np.array(colour, np.uint8), (1, 8, 12, 1))
    frame = av.VideoFrame.from_ndarray(h264.yuv420(pixels)[0], format="yuv420p")
    np.testing.assert_allclose(frame.to_ndarray(format="rgb24"), pixels[0], atol=4)


def test_what_cannot_be_written_is_refused(tmp_path: Path) -> None:
    made = of_lengths([2, 3])
    with pytest.raises(RuleError, match="no episode counts") as refused:
        written(made.model_copy(update={"items": {}}))
    assert refused.value.facts == {"failures": "1"}
    with pytest.raises(RuleError, match="the film does not show every episode") as refused:
        written(made, filmed(of_lengths([2])))
    assert refused.value.facts == {"missing": "1 of 2", "first": "1"}
    with pytest.raises(RuleError, match="videos need an even width and height"):
        written(made, filmed(made, 15))


def test_the_stub_states_the_same_facts(tmp_path: Path) -> None:
    made = of_lengths([2, 3])
    stub = RuleRunner(tmp_path).run("demonstrate.lerobot", profile="stub", bundle=episodes.bundle(), episodes=made)
    assert info(stub) == info(written(made))


def test_features_without_components_are_left_out() -> None:
    made = of_lengths([3, 2])
    bare = {
        label: episodes.observed(episode, displacement=episode.displacement[:, :0], contact=episode.contact[:, :0])
        for label, episode in made.items.items()
    }
    made = made.model_copy(update={"items": bare, "displacement_names": (), "tip_names": ()})
    folder = written(made)
    declared = info(folder)["features"]
    assert "privileged.contact" not in declared
    assert declared["observation.environment_state"]["shape"] == [14]
    assert steps(folder, "data/chunk-000/file-000.parquet")["observation.environment_state"].shape == (5, 14)


@pytest.mark.parametrize("kind", ["delta", "end_effector"])
def test_actions_have_the_kind_of_the_task_and_ask_for_the_recorded_targets(kind: ActionKind, tmp_path: Path) -> None:
    made, bundle = episodes.small(1), episodes.bundle()
    bundle = bundle.model_copy(update={"task": bundle.task.model_copy(update={"action": kind})})
    folder = RuleRunner(tmp_path).run("demonstrate.lerobot", bundle=bundle, episodes=made)
    spec = actions.of_task(bundle.task, bundle.robot)
    feature = info(folder)["features"]["action"]
    assert (feature["names"], feature["shape"]) == (list(spec.names), [len(spec.names)])
    about = json.loads(folder.files["meta/dextera.json"])["action"]
    assert (about["kind"], about["rate_hz"], len(about["lower"])) == (kind, 20.0, len(spec.names))
    found = steps(folder, "data/chunk-000/file-000.parquet")["action"]
    episode = made.items["0"]
    sent = np.concatenate([episode.start.ctrl[None], episode.executed])[: len(found)].astype(np.float64)
    back = ActionMap(bundle.task, bundle.robot)
    expected = [
        back.actions(target, last) for target, last in zip(episode.action.astype(np.float64), sent, strict=True)
    ]
    np.testing.assert_allclose(found, expected, atol=1e-6)
    if kind == "delta":
        np.testing.assert_allclose(sent + found, episode.action, atol=1e-6)
