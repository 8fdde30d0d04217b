"""Policies that look through several cameras: what they learn from, what they see at run time, and what is refused."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.tasks.episode import Episodes, Film
from dextera_build.artifacts.tasks.mixture import Mixture
from dextera_build.artifacts.tasks.pixels import Pixels
from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.errors import RuleError
from dextera_build.learning.demonstrations import Selection, prepare
from dextera_build.learning.parts import parts_of
from dextera_build.policy.cameras import PICTURE
from dextera_build.policy.observation import Frame, Measurement, deployable
from dextera_build.policy.running import PolicyFault
from dextera_build.serving.served import Served, observations
from dextera_build.testing import RuleRunner
from tests import episodes
from tests.policy.policies import load, runner
from tests.rules.learn import test_depth
from tests.rules.learn.test_mixture import elsewhere, mixed
from tests.rules.learn.trainings import BUNDLE, FEW, MIDDLE, Trainings, changed, filmed, square

VIEWS = {"front": episodes.view(48, 32), "side": episodes.view(40, 40)}
ACT, BC_RNN, DIFFUSION = RULES = test_depth.RULES
COMMON = test_depth.COMMON


def films(data: Episodes) -> Collection[Film | Pixels]:
    """Two films; that of the side is square."""
    return Collection[Film | Pixels](items={"front": filmed(data), "side": filmed(data, 40, 40)})


def trained(tmp_path: Path, trainings: Trainings, inputs: tuple[str, ...] = ("joints", "rgb")) -> Checkpoint:
    data = episodes.small(6)
    return trainings.learn(tmp_path, data, films=films(data), inputs=inputs, **(COMMON | FEW))


def picture(height: int, width: int, side: float = 0.0) -> np.ndarray:
    """A black picture with the box at `side` [m] of its middle."""
    shown = np.zeros((height, width, 3), np.uint8)
    if side:
        shown[square(height, width, MIDDLE + np.array([side, 0.0]))] = 255
    return shown


def act(made: Checkpoint, seen: Mapping[str, np.ndarray]) -> np.ndarray:
    """The first targets of a policy, without a pose of any object."""
    policy, one = load(made, BUNDLE, views=VIEWS), episodes.episode()
    frames = {name: Frame(each) for name, each in seen.items()}
    measured = Measurement(one.joints[0], np.full((2, 7), np.nan), np.full(1, np.nan), frames)
    return policy.act(deployable(measured, one.start.ctrl, one.goal))


def refusal(tmp_path: Path, data: Episodes | Mixture, **more: Any) -> RuleError:
    with pytest.raises(RuleError) as caught:
        ACT.learn(tmp_path, data, backend="stub", **more)
    return caught.value


@pytest.mark.medium
@pytest.mark.parametrize("trainings", RULES, ids=lambda each: each.rule)
def test_pictures_of_all_cameras_are_inputs_each_by_its_name(tmp_path: Path, trainings: Trainings) -> None:
    made = trained(tmp_path, trainings)
    shapes = {channel.name: channel.shape for channel in made.contract.inputs}
    assert shapes == {"joints": (3,), "rgb/front": (32, 48, 3), "rgb/side": (40, 40, 3)}
    one, other = picture(32, 48), picture(40, 40, 0.04)
    assert np.isfinite(act(made, {"front": one, "side": other})).all()
    swapped = act(made, {"side": other, "front": one})
    assert swapped == pytest.approx(act(made, {"front": one, "side": other})), "by name, not in the order of frames"


@pytest.mark.parametrize(("trainings", "encoders"), [(ACT, 1), (BC_RNN, 2), (DIFFUSION, 2)], ids=lambda each: str(each))
def test_cameras_share_an_encoder_or_have_one_each_as_in_the_papers(
    tmp_path: Path, trainings: Trainings, encoders: int
) -> None:
    made = trained(tmp_path, trainings)
    network = runner(made.contract.algorithm).network.of_contract(made.contract)
    assert len(network.eyes.eyes) == encoders
    assert (network.eyes.apart is not None) == (encoders == 1)


def test_each_channel_shows_its_own_camera(tmp_path: Path) -> None:
    data = episodes.small(3, 6)
    both = films(data)
    prepared = prepare(BUNDLE, parts_of(data, films=both), Selection(("joints", "rgb")), algorithm="act", settings={})
    for channel in prepared.contract.seen:
        camera = channel.name.removeprefix("rgb/")
        shown = prepared.sight[camera].at(channel, np.array([8]))
        np.testing.assert_array_equal(shown[0], both.items[camera].pixels("1")[2])


def test_one_camera_of_two_and_the_depth_of_the_other(tmp_path: Path) -> None:
    data = episodes.small(3)
    seen = Collection[Film | Pixels](items={"front": filmed(data), "side": test_depth.filmed(data)})
    made = ACT.learn(tmp_path, data, films=seen, inputs=("rgb/front", "cloud/side"), **(COMMON | FEW))
    assert [channel.name for channel in made.contract.inputs] == ["rgb/front", "cloud/side"]
    assert made.contract.inputs[1].scale, "normalised by its own points"


def test_decoded_films_train_the_same_policy(tmp_path: Path) -> None:
    data = episodes.small(4)
    packed = films(data)
    decoded = {name: RuleRunner(tmp_path).run("demonstrate.unpack", film=film) for name, film in packed.items.items()}
    options = COMMON | FEW | {"inputs": ("joints", "rgb")}
    one = ACT.learn(tmp_path, data, films=packed, **options)
    other = ACT.learn(tmp_path, data, films=Collection[Film | Pixels](items=decoded), **options)
    assert one.weights == other.weights


def test_a_contract_states_the_cameras_of_its_films(tmp_path: Path) -> None:
    data, view = episodes.small(3, 6), episodes.view(48, 32)
    runner = RuleRunner(tmp_path)
    film = runner.run("demonstrate.film", bundle=BUNDLE, episodes=data, view=view)
    decoded = RuleRunner(tmp_path).run("demonstrate.unpack", film=film)
    parts = parts_of(data, films=Collection[Film | Pixels](items={"front": decoded, "side": filmed(data, 40, 40)}))
    made = prepare(BUNDLE, parts, Selection(("joints", "rgb")), algorithm="act", settings={}).contract
    assert made.views.keys() == {"front"}, "the other film does not state its camera"
    stated = made.views["front"]
    assert (stated.size_px, stated.focal_px) == ((48, 32), (view.camera.fx, view.camera.fy))
    np.testing.assert_allclose(stated.position_m, view.camera_pose.matrix[:3, 3])


def test_a_mixture_has_films_by_label_and_camera(tmp_path: Path) -> None:
    data = episodes.small(3)
    mixture = mixed(tmp_path, {}, twin=data, reference=elsewhere(data))
    seen = films(data).items
    every = {f"{label}.{name}": film for label in mixture.parts for name, film in seen.items()}
    options = COMMON | FEW | {"inputs": ("joints", "rgb", "world")}
    made = ACT.learn(tmp_path, mixture, films=Collection[Film | Pixels](items=every), **options)
    assert [channel.name for channel in made.contract.inputs] == ["joints", "world", "rgb/front", "rgb/side"]
    del every["reference.side"]
    error = refusal(tmp_path, mixture, films=Collection[Film | Pixels](items=every), **options)
    assert error.message == "only one of the parts `reference` and `twin` has a film of `side`"


@pytest.mark.slow
@pytest.mark.parametrize("trainings", RULES, ids=lambda each: each.rule)
def test_a_policy_does_what_the_second_camera_says(tmp_path: Path, trainings: Trainings) -> None:
    """Joint 1 goes to 0.5 or -0.5 rad; the first camera sees nothing, only the second tells which."""
    sides = np.tile([1.0, -1.0], 6)[:, None] * np.ones(8)
    data = changed(12, 8, 0.5 * sides, MIDDLE[0] + 0.05 * sides)
    blind = {name: Film.packed(np.zeros((8, 32, 48, 3), np.uint8)) for name in data.items}
    front = Film(frames=blind, width=48, height=32)
    seen = Collection[Film | Pixels](items={"front": front, "side": filmed(data, 40, 40)})
    longer = {"learn.bc_rnn": {"steps": 450}, "learn.diffusion": {"steps": 400, "width": 32}}
    more = COMMON | {"steps": 150, "rate": 3e-3, "held_out": 0.0} | longer.get(trainings.rule, {})
    made = trainings.learn(tmp_path, data, films=seen, inputs=("joints", "rgb"), **more)
    left, right = (act(made, {"front": picture(32, 48), "side": picture(40, 40, side)})[0] for side in (0.05, -0.05))
    assert left > 0.25
    assert right < -0.25


def test_a_camera_that_is_missing_or_differs_is_refused(tmp_path: Path) -> None:
    made = trained(tmp_path, ACT)
    front = {"front": VIEWS["front"]}
    for views, facts in (
        (
            {**front, "top": VIEWS["side"]},
            {"no camera `side`": "the policy looks at 40 x 40 px, the bundle's cameras are front, top"},
        ),
        (
            {PICTURE: VIEWS["front"]},
            {
                "no camera `front`": "the policy looks at 48 x 32 px, the bundle's only camera has no name",
                "no camera `side`": "the policy looks at 40 x 40 px, the bundle's only camera has no name",
            },
        ),
        (
            {**front, "side": VIEWS["front"]},
            {"camera `side` of another size": "the policy has 40 x 40 px, the bundle has 48 x 32 px"},
        ),
    ):
        with pytest.raises(RuleError) as caught:
            load(made, BUNDLE, views=views)
        assert caught.value.code == "DXB-B502"
        assert caught.value.facts == facts
    alone = ACT.learn(tmp_path, episodes.small(3), film=filmed(episodes.small(3)), inputs=("rgb",), **FEW)
    with pytest.raises(RuleError) as caught:
        load(alone, BUNDLE, views=VIEWS)
    assert caught.value.facts == {"no view": "the policy looks at 48 x 32 px, the bundle's cameras are front, side"}


def test_a_frame_that_does_not_come_is_a_fault_of_the_step(tmp_path: Path) -> None:
    made = trained(tmp_path, ACT)
    with pytest.raises(PolicyFault, match="given no picture of camera `side` at step 0"):
        act(made, {"front": picture(32, 48)})


def test_films_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    data = episodes.small(3)
    both, inputs = films(data), ("joints", "rgb")
    error = refusal(tmp_path, data, film=filmed(data), films=both, inputs=inputs)
    assert error.message == "`film` is for one camera, `films` for several"
    error = refusal(tmp_path, data, films=both, inputs=("joints", "rgb/front"))
    assert error.message.startswith("a film of camera `side` is given, but none of")
    error = refusal(tmp_path, data, films=both, inputs=("joints", "rgb", "rgb/top"))
    assert error.message == "there is no channel `rgb/top` to learn from"
    assert error.hint == "there is no film of camera `top`: give it in `films`, or leave `rgb/top` out of `inputs`"
    error = refusal(tmp_path, data, films=both, inputs=("rgb/front", "depth/side"))
    assert error.message == "the film of camera `side` has no depth, from which `depth` is made"
    fewer = replace_film(both, "side", filmed(episodes.small(2)))
    error = refusal(tmp_path, data, films=fewer, inputs=inputs)
    assert error.message == "the film of camera `side` lacks 1 of 3 episodes"
    named = Collection[Film | Pixels](items={"Front": filmed(data)})
    assert refusal(tmp_path, data, films=named, inputs=inputs).message == "`Front` cannot name a camera"


def replace_film(given: Collection[Film | Pixels], camera: str, film: Film) -> Collection[Film | Pixels]:
    return Collection[Film | Pixels](items={**given.items, camera: film})


def test_a_served_policy_takes_each_picture_by_its_name(tmp_path: Path) -> None:
    made = trained(tmp_path, ACT)
    served = Served(runner(), made, "0" * 64, BUNDLE)
    stated = {each.name: (each.shape, each.dtype) for each in served.promise.inputs}
    assert stated == {
        "joints": ((3,), "float32"),
        "rgb/front": ((32, 48, 3), "uint8"),
        "rgb/side": ((40, 40, 3), "uint8"),
    }
    request = {"joints": np.zeros(3, np.float32), "rgb/front": picture(32, 48), "rgb/side": picture(40, 40, 0.04)}
    (seen,) = observations(made.contract.inputs, request)
    assert {name: np.shape(frame.rgb) for name, frame in seen.frames.items()} == {
        "front": (32, 48, 3),
        "side": (40, 40, 3),
    }
    assert np.isfinite(served.policy().chunk(seen)).all()
    del request["rgb/side"]
    with pytest.raises(RuleError, match=r"a request lacks rgb/side"):
        observations(made.contract.inputs, request)
