"""demonstrate.lerobot in version 2.1: a file per episode, JSON Lines, and GR00T's `modality.json`."""

from __future__ import annotations

import io
import json
from itertools import pairwise
from typing import Any

import av
import numpy as np
import pyarrow.parquet as pq

from dextera_build.artifacts.base import Folder
from rules.demonstrate.lerobot_v21 import _parts
from tests import episodes
from tests.rules.demonstrate.test_lerobot import KEY, filmed, of_lengths, written

LENGTHS = [4, 7, 3]


def made(per_chunk: int = 2, *, film: bool = True) -> Folder:
    shown = of_lengths(LENGTHS)
    return written(shown, filmed(shown) if film else None, version="v2.1", files_per_chunk=per_chunk)


def document(folder: Folder, name: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(folder.files[f"meta/{name}"])
    return found


def lines(folder: Folder, name: str) -> list[dict[str, Any]]:
    return [json.loads(line) for line in folder.files[f"meta/{name}"].decode().splitlines()]


def test_every_episode_is_a_file_where_the_template_says() -> None:
    folder, shown = made(), of_lengths(LENGTHS)
    facts = document(folder, "info.json")
    assert facts["codebase_version"] == "v2.1"
    assert (facts["total_episodes"], facts["total_frames"], facts["total_videos"]) == (3, 14, 3)
    assert (facts["total_chunks"], facts["chunks_size"], facts["total_tasks"]) == (2, 2, 1)
    first = 0
    for number, (_, episode) in enumerate(shown.in_order()):
        place = {"episode_chunk": number // 2, "episode_index": number}
        table = pq.read_table(io.BytesIO(folder.files[facts["data_path"].format(**place)]))
        assert set(table.column_names) == set(facts["features"]) - {KEY}
        assert np.allclose(table["observation.state"].to_pylist(), episode.joints)
        assert np.allclose(table["action"].to_pylist(), episode.action)
        assert table["index"].to_pylist() == list(range(first, first + LENGTHS[number]))
        assert table["episode_index"].to_pylist() == [number] * LENGTHS[number]
        with av.open(io.BytesIO(folder.files[facts["video_path"].format(video_key=KEY, **place)])) as video:
            pictures = [frame.to_ndarray(format="rgb24") for frame in video.decode(video=0)]
        assert len(pictures) == LENGTHS[number]
        # The film's brightness says which episode and which step a frame shows; the video has losses.
        shown_light = [round(float(np.mean(picture))) for picture in pictures]
        assert np.abs(np.array(shown_light) - (20 + 16 * number + np.arange(LENGTHS[number]))).max() <= 3
        first += LENGTHS[number]
    assert not [name for name in folder.files if name.startswith(("meta/episodes/", "meta/tasks.parquet"))]


def test_episodes_tasks_and_statistics_are_json_lines() -> None:
    folder, shown = made(), of_lengths(LENGTHS)
    assert lines(folder, "tasks.jsonl") == [{"task_index": 0, "task": "lift box"}]
    rows = lines(folder, "episodes.jsonl")
    assert [(row["episode_index"], row["length"], row["tasks"]) for row in rows] == [
        (number, length, ["lift box"]) for number, length in enumerate(LENGTHS)
    ]
    for row, (_, episode) in zip(lines(folder, "episodes_stats.jsonl"), shown.in_order(), strict=True):
        stats = row["stats"]
        assert set(stats["action"]) == {"min", "max", "mean", "std", "count"}
        assert np.allclose(stats["action"]["mean"], episode.action.astype(float).mean(axis=0))
        assert stats["action"]["count"] == [len(episode.action)]
        assert np.array(stats[KEY]["max"]).shape == (3, 1, 1)


def test_statistics_of_the_whole_set_have_quantiles() -> None:
    stats, shown = document(made(), "stats.json"), of_lengths(LENGTHS)
    actions = np.concatenate([episode.action for _, episode in shown.in_order()]).astype(float)
    assert KEY not in stats
    for name, part in (("q01", 0.01), ("q10", 0.1), ("q50", 0.5), ("q90", 0.9), ("q99", 0.99)):
        assert np.allclose(stats["action"][name], np.quantile(actions, part, axis=0))
    assert np.allclose(stats["action"]["std"], actions.std(axis=0))
    assert stats["action"]["count"] == [sum(LENGTHS)]


def test_modality_divides_state_and_action_into_named_parts() -> None:
    folder, bundle = made(), episodes.bundle()
    features, parts = document(folder, "info.json")["features"], document(folder, "modality.json")
    assert parts["video"] == {"workspace": {"original_key": KEY}}
    assert parts["annotation"] == {"human.task_description": {"original_key": "task_index"}}
    for kind, feature in (("state", "observation.state"), ("action", "action")):
        own = [part for part in parts[kind].values() if part["original_key"] == feature]
        ends = [(part["start"], part["end"]) for part in own]
        assert ends[0][0] == 0
        assert ends[-1][1] == features[feature]["shape"][0] == len(bundle.robot.joints)
        assert all(one[1] == other[0] for one, other in pairwise(ends))
    assert all(part["end"] <= features[part["original_key"]]["shape"][0] for part in parts["state"].values())
    assert "video_path" not in [name for name, value in document(made(film=False), "info.json").items() if value]


def test_joints_of_a_part_that_do_not_lie_together_are_parts_of_their_own() -> None:
    found = _parts(["left_arm", "left_arm", "left_hand", "left_arm"], "action")
    assert {name: (part["start"], part["end"]) for name, part in found.items()} == {
        "left_arm": (0, 2),
        "left_hand": (2, 3),
        "left_arm_2": (3, 4),
    }
