"""Policies on depth and on points: what they see, what they learn from it, and what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from dextera_build.artifacts.tasks.episode import Episode, Episodes, Film
from dextera_build.artifacts.tasks.policy import Channel, Checkpoint
from dextera_build.errors import RuleError
from dextera_build.geometry import cameras
from dextera_build.learning.augmentation import ranged
from dextera_build.learning.demonstrations import Selection, prepare
from dextera_build.learning.eye import Cloud
from dextera_build.learning.options import ImitationOptions
from dextera_build.learning.parts import parts_of
from dextera_build.policy import features
from dextera_build.policy.cameras import PICTURE
from dextera_build.policy.observation import DeployableObservation, Frame, Measurement, deployable
from dextera_build.policy.running import PolicyFault
from dextera_build.serving.served import Served
from dextera_build.testing import RuleRunner
from tests import episodes
from tests.policy.policies import load, runner
from tests.rules.learn.trainings import BUNDLE, FEW, MIDDLE, Trainings, changed, square

VIEW = episodes.view(48, 32)
RAYS = cameras.rays(32, 48, VIEW.camera.matrix())
FAR_M, NEAR_M = 1.0, 0.8
"""Distance of the table, and of the box."""
RULES = (
    Trainings("learn.act", {"width": 16, "heads": 2, "chunk": 5}),
    Trainings("learn.bc_rnn", {"hidden": 16, "layers": 1, "horizon": 5, "rate": 1e-2}),
    Trainings("learn.diffusion", {"width": 8, "levels": 1, "horizon": 4, "every": 2}),
)
COMMON = {"batch": 16, "held_out": 0.25, "warm_up": 5}


def depth_of(place: np.ndarray) -> np.ndarray:
    """Distances (32, 48) [m] of a table with a box at `place` (2,) [m]; one row was not measured."""
    depth = np.full((32, 48), FAR_M, np.float32)
    depth[square(*depth.shape, place)] = NEAR_M
    depth[0] = 0.0
    return depth


def filmed(data: Episodes) -> Film:
    """A film whose pictures are black, and whose depth shows the box."""
    frames, depth = {}, {}
    for name, one in data.items.items():
        found = np.stack([depth_of(place) for place in one.objects[:, 0, :2]])
        frames[name] = Film.packed(np.zeros((*found.shape, 3), np.uint8))
        depth[name] = Film.packed(features.counts(found))
    return Film(frames=frames, width=48, height=32, depth=depth, camera=VIEW.camera)


def trained(tmp_path: Path, trainings: Trainings, inputs: tuple[str, ...], **more: Any) -> Checkpoint:
    data = episodes.small(6)
    return trainings.learn(tmp_path, data, film=filmed(data), inputs=inputs, **(COMMON | more))


def frame(depth: np.ndarray) -> Frame:
    return Frame(np.zeros((*depth.shape, 3), np.uint8), depth, (depth[..., None] * RAYS).astype(np.float32))


def act(made: Checkpoint, seen: Frame) -> np.ndarray:
    """The first targets of a policy, without a pose of any object."""
    return load(made, BUNDLE, VIEW).act(observed(episodes.episode(), seen))


def observed(one: Episode, seen: Frame) -> DeployableObservation:
    """The first observation of an episode, without a pose of any object."""
    measured = Measurement(one.joints[0], np.full((2, 7), np.nan), np.full(1, np.nan), {PICTURE: seen})
    return deployable(measured, one.start.ctrl, one.goal)


@pytest.mark.parametrize("name", ["depth", "cloud"])
def test_what_is_learned_from_is_what_is_seen_at_run_time(name: str) -> None:
    data = episodes.small(2, 6)
    prepared = prepare(BUNDLE, parts_of(data, filmed(data)), Selection(("joints", name)), algorithm="act", settings={})
    channel = prepared.contract.inputs[1]
    assert channel.shape == {"depth": (32, 48), "cloud": (32, 48, 3)}[name]
    shown = prepared.sight[PICTURE].at(channel, np.array([8]))
    seen = frame(depth_of(data.items["1"].objects[2, 0, :2]))
    given = features.measured(channel, np.asarray(getattr(seen, name))[None])
    np.testing.assert_allclose(shown, given, atol=1e-6)
    if name == "depth":
        assert (shown[0, 0] == 0).all(), "what was not measured"
        assert (shown[0, 1:, :, -1] == 1).all()
    else:
        assert shown.shape == (1, 16, 24, 4), "points of every second row and column"


def test_distances_are_rounded_to_millimetres_and_points_stay_on_their_rays() -> None:
    channel = Channel(name="cloud", shape=(1, 2, 3), encoding="cloud", mean=(0.0, 0.0, 0.0), scale=(1.0, 1.0, 1.0))
    points = np.array([[[[0.5, -0.25, 1.00049], [0.0, 0.0, 70.0]]]])
    found = features.measured(channel, points)
    np.testing.assert_allclose(found[0, 0, 0, :3], points[0, 0, 0] / 1.00049, rtol=1e-6)
    assert not found[0, 0, 1].any(), "too far for a count"
    near = features.measured(channel.model_copy(update={"reach_m": 1.0}), points)
    assert not near.any(), "out of reach"
    assert features.counts(np.array([0.0, np.nan, np.inf, -1.0, 0.0004, 0.0006, 65.535])).tolist() == [0] * 5 + [1, 0]


@pytest.mark.slow
@pytest.mark.parametrize("trainings", RULES[:2], ids=lambda each: each.rule)
@pytest.mark.parametrize("name", ["depth", "cloud"])
def test_a_policy_does_what_the_depth_says(tmp_path: Path, trainings: Trainings, name: str) -> None:
    """Joint 1 goes to 0.5 or -0.5 rad; only the depth tells on which side the box is, and with it which."""
    sides = np.tile([1.0, -1.0], 6)[:, None] * np.ones(8)
    data = changed(12, 8, 0.5 * sides, MIDDLE[0] + 0.05 * sides)
    steps = 450 if trainings.rule == "learn.bc_rnn" else 150  # a mixture's means leave the middle late
    more = COMMON | {"steps": steps, "rate": 3e-3, "jitter": 0.02, "holes": 0.2, "held_out": 0.0}
    made = trainings.learn(tmp_path, data, film=filmed(data), inputs=("joints", name), **more)
    y = data.items["0"].objects[0, 0, 1]
    left, right = (act(made, frame(depth_of(np.array([MIDDLE[0] + 0.05 * side, y]))))[0] for side in (1.0, -1.0))
    assert left > 0.25
    assert right < -0.25


@pytest.mark.medium
@pytest.mark.parametrize("trainings", [RULES[0], RULES[2]], ids=lambda each: each.rule)
def test_pictures_and_points_make_one_policy(tmp_path: Path, trainings: Trainings) -> None:
    made = trained(tmp_path, trainings, ("joints", "rgb", "cloud"), jitter=0.02, holes=0.3, **FEW)
    assert [channel.encoding for channel in made.contract.inputs] == ["plain", "picture", "cloud"]
    assert np.isfinite(act(made, frame(depth_of(MIDDLE)))).all()


@pytest.mark.slow
def test_a_training_on_depth_that_was_killed_ends_with_the_same_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tests.rules.learn.trainings.filmed", filmed)
    more = Trainings("learn.act", RULES[0].small | COMMON | {"steps": 14})
    more.assert_resumes(tmp_path, monkeypatch, inputs=("rgb", "depth"), jitter=0.1, holes=0.2)


def test_data_without_depth_are_refused(tmp_path: Path) -> None:
    data = episodes.small(3)
    plain = filmed(data).model_copy(update={"depth": {}, "camera": None})
    with pytest.raises(RuleError, match="the film has no depth, from which `cloud` is made") as refused:
        RULES[0].learn(tmp_path, data, film=plain, inputs=("joints", "cloud"), **FEW)
    assert refused.value.hint == "film with `depth: true` in `demonstrate.film`"
    with pytest.raises(RuleError, match="there is no channel `depth`") as refused:
        RULES[0].learn(tmp_path, data, inputs=("joints", "depth"), **FEW)
    assert "depth: true" in str(refused.value.hint)


def test_a_camera_without_depth_is_a_fault_of_the_step(tmp_path: Path) -> None:
    made = trained(tmp_path, RULES[0], ("joints", "depth"), **FEW)
    with pytest.raises(PolicyFault, match=r"given no depth picture at step 0, it needs \(32, 48\)"):
        act(made, Frame(np.zeros((32, 48, 3), np.uint8)))
    with pytest.raises(RuleError, match="a view of another size"):
        load(made, BUNDLE, episodes.view(64, 48))


def test_a_served_policy_takes_depth_in_metres(tmp_path: Path) -> None:
    made = trained(tmp_path, RULES[0], ("joints", "depth"), **FEW)
    promise = Served(runner(), made, "0" * 64, BUNDLE).promise
    (depth,) = (each for each in promise.inputs if each.name == "depth")
    assert (depth.shape, depth.dtype, depth.unit.partition(";")[0]) == ((32, 48), "float32", "m")
    assert depth.channel().encoding == "depth"


def test_holes_and_noise_touch_only_what_was_measured() -> None:
    frames = torch.zeros(2, 2, 8, 8)
    frames[:, :, 4:] = 1.0
    options = ImitationOptions(jitter=0.5, holes=1.0)
    made = ranged(frames, 1, options, torch.Generator().manual_seed(0))
    assert not made[:, :, :4].any()
    assert not made[:, 0][made[:, 1] == 0].any()
    assert 0 < int(made[:, 1, 4:].sum()) < 64
    assert float(made[:, 0, 4:].std()) > 0.2
    assert torch.equal(made, ranged(frames, 1, options, torch.Generator().manual_seed(0)))


def test_a_cloud_without_a_point_is_no_number_of_its_own() -> None:
    eye = Cloud(8)
    nothing = eye(torch.zeros(1, 6, 6, 4))
    assert torch.isfinite(nothing).all()
    nothing.sum().backward()
    assert all(torch.isfinite(each.grad).all() for each in eye.parameters() if each.grad is not None)


def test_a_film_keeps_its_depth(tmp_path: Path) -> None:
    data = episodes.small(2, 5)
    film = RuleRunner(tmp_path).run(
        "demonstrate.film", options={"depth": True}, bundle=BUNDLE, episodes=data, view=VIEW
    )
    assert RuleRunner(tmp_path).run("demonstrate.film", bundle=BUNDLE, episodes=data, view=VIEW).depth == {}
    counts = film.counts("1")
    assert counts.shape == (5, 32, 48)
    assert 200 < counts[counts > 0].min() < counts.max() < 5000, "a table within metres"
    decoded = RuleRunner(tmp_path).run("demonstrate.unpack", film=film)
    np.testing.assert_array_equal(decoded.depth["1"], counts)
    assert decoded.camera == film.camera == VIEW.camera
