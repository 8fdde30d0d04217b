"""demonstrate.robomimic: what the file holds is what was recorded, scaled as its attributes say."""

from __future__ import annotations

import io
import json
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.tasks.episode import Episodes, Film
from dextera_build.errors import RuleError
from dextera_build.sim.render.filming import Replica
from dextera_build.testing import RuleRunner
from rules.demonstrate import split
from tests import episodes
from tests.rules.demonstrate.test_lerobot import filmed, of_lengths

LENGTHS = [4, 7, 3, 5]
ONE = episodes.small(1, 2)


def written(made: Episodes, film: Film | None = None, profile: str = "cpu", **options: object) -> Folder:
    inputs: dict[str, Any] = {"episodes": made}
    if film is not None:
        inputs |= {"film": film, "view": episodes.view(film.width, film.height)}
    with tempfile.TemporaryDirectory() as scratch:
        folder: Folder = RuleRunner(scratch).run(
            "demonstrate.robomimic", profile=profile, options=options, bundle=episodes.bundle(), **inputs
        )
    return folder


def of_seeds(seeds: Sequence[int]) -> Episodes:
    """Episodes that differ in the seeds of their starts alone."""
    one = ONE.items["0"]
    items = {
        str(number): one.model_copy(update={"start": one.start.model_copy(update={"seed": seed})})
        for number, seed in enumerate(seeds)
    }
    return ONE.model_copy(update={"items": items})


@contextmanager
def opened(folder: Folder) -> Iterator[Any]:
    with h5py.File(io.BytesIO(folder.files["demo.hdf5"])) as file:
        yield file


def test_every_episode_is_a_demonstration_with_its_numbers() -> None:
    made = of_lengths(LENGTHS)
    replica = Replica(episodes.bundle(), made)
    with opened(written(made)) as file:
        data = file["data"]
        assert data.attrs["total"] == sum(LENGTHS)
        assert set(data) == {f"demo_{number}" for number in range(len(LENGTHS))}
        for number, (label, episode) in enumerate(made.in_order()):
            demo, steps = data[f"demo_{number}"], LENGTHS[number]
            assert (demo.attrs["num_samples"], demo.attrs["label"]) == (steps, label)
            assert json.loads(demo.attrs["ep_meta"]) == {"lang": "lift box"}
            assert demo.attrs["start_seed"] == episode.start.seed
            np.testing.assert_array_equal(demo.attrs["start_qpos"], episode.start.qpos)
            np.testing.assert_array_equal(demo["obs/state"], episode.joints)
            seen = np.concatenate([episode.objects.reshape(steps, -1), episode.displacement], axis=1)
            np.testing.assert_array_equal(demo["obs/object"], seen)
            np.testing.assert_array_equal(demo["obs/goal"], np.tile(episode.goal, (steps, 1)))
            np.testing.assert_array_equal(demo["executed"], episode.executed)
            np.testing.assert_array_equal(demo["states"], replica.positions(episode))
            assert demo["dones"][:].tolist() == [0] * (steps - 1) + [1]
            assert demo["rewards"][:].tolist() == [0.0] * (steps - 1) + [1.0]
            assert "privileged" not in "".join(demo["obs"])


def test_actions_are_scaled_and_the_file_says_how() -> None:
    made = of_lengths(LENGTHS)
    joints = episodes.robot().joints
    with opened(written(made)) as file:
        attributes = file["data"].attrs
        assert list(attributes["action_names"]) == [joint.name for joint in joints]
        lower, upper = attributes["action_lower"], attributes["action_upper"]
        np.testing.assert_array_equal(lower, [joint.lower for joint in joints])
        np.testing.assert_array_equal(upper, [joint.upper for joint in joints])
        for number, (_, episode) in enumerate(made.in_order()):
            scaled = file[f"data/demo_{number}/actions"][:]
            assert np.abs(scaled).max() <= 1.0
            back = lower + (scaled.astype(float) + 1.0) / 2.0 * (upper - lower)
            np.testing.assert_allclose(back, episode.action, atol=1e-6)


def test_an_action_beyond_its_limit_widens_the_scale() -> None:
    made = of_lengths([3, 3])
    items = {
        label: episode.model_copy(update={"action": episode.action + np.float32(4.0 * (label == "1"))})
        for label, episode in made.items.items()
    }
    with opened(written(made.model_copy(update={"items": items}))) as file:
        attributes = file["data"].attrs
        assert attributes["action_upper"][0] == pytest.approx(items["1"].action[:, 0].max())
        lower, upper = attributes["action_lower"], attributes["action_upper"]
        back = lower + (file["data/demo_1/actions"][:].astype(float) + 1.0) / 2.0 * (upper - lower)
        np.testing.assert_allclose(back, items["1"].action, atol=1e-6)


def test_pictures_and_those_of_the_step_after() -> None:
    made = of_lengths(LENGTHS)
    film = filmed(made)
    with opened(written(made, film, camera="side")) as file:
        assert json.loads(file["data"].attrs["cameras"])["side"]["width"] == 16
        for number, (label, _) in enumerate(made.in_order()):
            demo, pixels = file[f"data/demo_{number}"], film.pixels(label)
            np.testing.assert_array_equal(demo["obs/side_image"], pixels)
            np.testing.assert_array_equal(demo["next_obs/side_image"], np.concatenate([pixels[1:], pixels[-1:]]))
            joints = demo["obs/state"][:]
            np.testing.assert_array_equal(demo["next_obs/state"], np.concatenate([joints[1:], joints[-1:]]))


def test_masks_divide_the_demonstrations() -> None:
    made = of_lengths([2] * 20)
    with opened(written(made, valid_share=0.3)) as file:
        sides = [{name.decode() for name in file[f"mask/{side}"]} for side in ("train", "valid")]
        assert sides[0] | sides[1] == set(file["data"])
        assert not sides[0] & sides[1]
        assert all(sides)
    with opened(written(made, valid_share=0.0)) as file:
        assert set(file["mask"]) == {"train"}


@given(seeds=st.lists(st.integers(0, 30), min_size=1, max_size=25), share=st.floats(0.0, 0.99))
def test_the_start_decides_who_validates(seeds: list[int], share: float) -> None:
    made = of_seeds(seeds)
    valid = split.validation(made, share)
    sides = [{seeds[int(label)] for label in made.items if (label in valid) == side} for side in (True, False)]
    assert not sides[0] & sides[1]
    assert bool(sides[0]) == (share > 0 and len(set(seeds)) > 1)
    assert sides[1]


def test_an_episode_stays_on_its_side_when_others_are_added() -> None:
    many = split.validation(of_seeds(range(200)), 0.2)
    few = split.validation(of_seeds(range(100)), 0.2)
    assert few == {label for label in many if int(label) < 100}
    assert 20 <= len(many) <= 60


def test_the_same_episodes_give_the_same_bytes() -> None:
    made = of_lengths([4, 6])
    assert written(made, filmed(made)).files == written(made, filmed(made)).files


def test_the_environment_is_that_of_gymnasium() -> None:
    with opened(written(of_lengths([2]))) as file:
        made = json.loads(file["data"].attrs["env_args"])
        about = json.loads(file["data"].attrs["dextera"])
    assert made == {"env_name": "dxb/LiftBox-unknown-v0", "type": 2, "env_kwargs": {"action": "joint"}}
    assert about["failures"] == {"1": "box: not lifted"}


def test_what_cannot_be_written_is_refused() -> None:
    made = of_lengths([2, 3])
    with pytest.raises(RuleError, match="no episode counts"):
        written(made.model_copy(update={"items": {}}))
    with pytest.raises(RuleError, match="the film does not show every episode"):
        written(made, filmed(of_lengths([2])))


def test_the_stub_is_a_file_of_the_same_name() -> None:
    made = of_lengths([2])
    assert written(made, profile="stub").files.keys() == written(made).files.keys()
