"""learn.ppo: that it learns, that it is exact, that an interruption loses nothing, and what its policies may see."""

from __future__ import annotations

import errno
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.tasks.episode import Start
from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.artifacts.tasks.task import Reset, TaskBundle
from dextera_build.errors import RuleError
from dextera_build.learning import weights
from dextera_build.rule import Context
from dextera_build.sim.runtime import starts
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.runtime.seeds import seed_of
from dextera_build.sim.training.practice import Practices
from dextera_build.sim.training.teaching import Teacher
from dextera_build.testing import RuleRunner
from tests import episodes, task_bundles
from tests.policy.policies import load, runner
from tests.rules.learn.trainings import Killed

WIDE = Reset(position_m=0.01, joint_rad=0.1, robot_rad=0.005)
BUNDLE = task_bundles.close(reset=WIDE)
SMALL = {"steps": 96, "worlds": 2, "rollout": 16, "batch": 16, "epochs": 2, "width": 16}


def learn(tmp_path: Path, backend: str = "sb3", bundle: TaskBundle = BUNDLE, **more: Any) -> Checkpoint:
    made = RuleRunner(tmp_path).run("learn.ppo", backend=backend, bundle=bundle, options=SMALL | more)
    assert isinstance(made, Checkpoint)
    return made


def interrupted(
    folder: Path, stop: int | None, monkeypatch: pytest.MonkeyPatch, passing: float | None = None, **more: Any
) -> tuple[Checkpoint | None, list[str]]:
    """A training that is killed after `stop` decisions; its checkpoint, if it got that far, and its logged lines.

    `passing` may be out of bounds: 0 passes every step of a curriculum.
    """
    found = RuleRunner(folder).find("learn.ppo")
    module = found.backends["sb3"].module
    monkeypatch.setattr(f"{module.Watch.__module__}.SAVE_EVERY_S", 0.0, raising=True)
    lines: list[str] = []

    def emit(kind: str, event: Mapping[str, object]) -> None:
        if kind == "log":
            lines.append(str(event["text"]))
        elif event["done"] == stop:
            raise Killed

    ctx = Context(module, scratch=folder / "scratch", emit=emit, keep=folder / "keep")
    options = found.rule.options.model_validate(SMALL | more)
    if passing is not None:
        options = options.model_copy(update={"passing": passing})
        monkeypatch.setattr(f"{module.Watch.__module__}.LEAST", 1, raising=True)
    try:
        return found.rule(ctx, BUNDLE, options=options), lines
    except Killed:
        return None, lines


def same(one: Checkpoint, other: Checkpoint) -> bool:
    return one.weights == other.weights and one.curve.tobytes() == other.curve.tobytes()


def successes(made: Checkpoint, count: int = 20) -> int:
    """How many of `count` starts end well under a policy that does not explore."""
    policy, environment = load(made, BUNDLE), Environment(BUNDLE)
    done = 0
    for seed in range(count):
        seen = environment.reset(seed)
        policy.reset()
        outcome = environment.step(policy.act(seen))
        while not outcome.over:
            outcome = environment.step(policy.act(environment.observe()))
        done += outcome.success
    return done


@pytest.mark.slow
def test_it_learns_to_close_a_lid(tmp_path: Path) -> None:
    """A minute of practice from nothing; it would go on to learn."""
    options = {"worlds": 8, "rollout": 32, "batch": 128, "epochs": 10, "width": 64}
    assert successes(learn(tmp_path, steps=256, **options)) == 0
    made = learn(tmp_path, steps=12_000, **options)
    assert made.curve[-1] > made.curve[0] + 3
    assert successes(made) >= 5


@pytest.mark.medium
def test_the_same_bundle_gives_the_same_bytes(tmp_path: Path) -> None:
    np.random.seed(5)
    first = learn(tmp_path)
    np.random.seed(6)
    assert same(learn(tmp_path), first)
    assert not same(learn(tmp_path, seed=1), first)


@pytest.mark.medium
def test_a_start_that_cannot_be_drawn_is_replaced_alike_after_an_interruption(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lost, draw = {seed_of(0, 1, 0), seed_of(0, 1, 0) + 1, seed_of(0, 0, 1)}, starts.draw

    def drawn(bundle: TaskBundle, model: Any, data: Any, changed: Any, seed: int, *more: Any, **named: Any) -> Start:
        if seed in lost:
            raise RuleError("no start without collisions was found", code="DXB-B211")
        return draw(bundle, model, data, changed, seed, *more, **named)

    monkeypatch.setattr(starts, "draw", drawn)
    whole, lines = interrupted(tmp_path / "whole", None, monkeypatch)
    assert whole
    assert [line.split(":")[0] for line in lines] == ["world 1, episode 0", "world 0, episode 1"]
    nothing, _ = interrupted(tmp_path / "cut", 90, monkeypatch)
    assert nothing is None
    rest, _ = interrupted(tmp_path / "cut", None, monkeypatch)
    assert rest
    assert same(rest, whole)


def test_a_training_leaves_global_generators_as_they_were(tmp_path: Path) -> None:
    import torch

    np.random.seed(5)
    torch.manual_seed(5)
    before = np.random.get_state()[1].tolist(), torch.get_rng_state().tolist()
    learn(tmp_path, steps=32)
    assert (np.random.get_state()[1].tolist(), torch.get_rng_state().tolist()) == before


@pytest.mark.medium
def test_a_training_leaves_no_temporary_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(folder))
    learn(tmp_path)
    assert not list(folder.iterdir())


@pytest.mark.medium
def test_a_training_that_was_killed_ends_with_the_same_bytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Killed within rollouts and within episodes; what was practised since the last state is practised again."""
    whole, _ = interrupted(tmp_path / "whole", None, monkeypatch)
    assert whole
    for stop in (20, 44, 90):
        nothing, _ = interrupted(tmp_path / "cut", stop, monkeypatch)
        assert nothing is None
    rest, lines = interrupted(tmp_path / "cut", None, monkeypatch)
    assert lines[0] == "resumes after decision 64"
    assert rest
    assert same(rest, whole)
    assert rest.steps.tolist() == whole.steps.tolist()


@pytest.mark.slow
def test_a_curriculum_widens_the_starts_and_survives_a_kill(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    easy: dict[str, Any] = {"curriculum": 3, "passing": 0.0, "steps": 128}
    whole, lines = interrupted(tmp_path / "whole", None, monkeypatch, **easy)
    assert whole
    assert lines == [
        "starts within 67 % of the ranges from decision 64",
        "starts within 100 % of the ranges from decision 96",
    ]
    for stop in (70, 120):
        interrupted(tmp_path / "cut", stop, monkeypatch, **easy)
    rest, lines = interrupted(tmp_path / "cut", None, monkeypatch, **easy)
    assert lines[0] == "resumes after decision 96"
    assert rest
    assert same(rest, whole)
    plain, _ = interrupted(tmp_path / "plain", None, monkeypatch, steps=128)
    assert plain
    assert not same(plain, whole)


def test_a_curriculum_that_is_not_passed_stays_near_the_photograph(tmp_path: Path) -> None:
    runner = RuleRunner(tmp_path)
    runner.run("learn.ppo", backend="sb3", bundle=BUNDLE, options=SMALL | {"steps": 32, "curriculum": 4})
    assert runner.outcome.line.endswith("success while exploring within 25 % of the ranges of starts")


@pytest.mark.medium
def test_threads_do_not_change_the_bytes(tmp_path: Path) -> None:
    options = {"worlds": 3, "steps": 48}
    assert same(learn(tmp_path / "1", **options), learn(tmp_path / "2", threads=3, **options))


@pytest.mark.medium
def test_the_state_of_another_training_is_not_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    interrupted(tmp_path, 44, monkeypatch)
    _, lines = interrupted(tmp_path, None, monkeypatch, seed=1)
    assert not lines


@pytest.mark.slow
def test_a_damaged_state_begins_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole, _ = interrupted(tmp_path / "whole", None, monkeypatch)
    interrupted(tmp_path / "cut", 44, monkeypatch)
    (file,) = (tmp_path / "cut" / "keep").iterdir()
    file.write_bytes(file.read_bytes()[:-10])
    rest, lines = interrupted(tmp_path / "cut", None, monkeypatch)
    assert not lines
    assert rest
    assert whole
    assert same(rest, whole)


@pytest.mark.medium
def test_a_full_disk_does_not_end_a_training(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*arguments: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("pathlib.Path.write_bytes", full)
    made, lines = interrupted(tmp_path, None, monkeypatch)
    assert "the state of the training could not be kept: No space left on device" in lines
    assert made


def test_a_training_that_diverges_is_one_clear_error(tmp_path: Path) -> None:
    with pytest.raises(RuleError, match="the training diverged before decision") as caught:
        learn(tmp_path, rate=1e30)
    assert caught.value.hint == "rate: 3e+29"


def practised(made: Checkpoint) -> tuple[Start, np.ndarray]:
    """A start, and the last targets (6, A) after each of the decisions that a policy takes from there in practice."""
    import torch

    practice, ppo = Practices(BUNDLE, made.contract), runner("ppo").network
    network = ppo.of_contract(made.contract)
    weights.fill(network, weights.from_bytes(made.weights))
    seen, found = practice.reset(), []
    for _ in range(6):
        with torch.inference_mode():
            decision = ppo.decide(network, seen[:, : practice.public])
        seen = practice.step([decision]).numbers
        found.append(practice.seen["deployable/previous_action"][0])
    return practice.worlds.environments[0].start, np.array(found)


@pytest.mark.medium
def test_a_policy_acts_as_it_practised(tmp_path: Path) -> None:
    """The targets that a loaded policy sends are those that its decisions led to in training, bit for bit."""
    made = learn(tmp_path)
    start, targets = practised(made)
    environment, policy = Environment(BUNDLE), load(made, BUNDLE)
    environment.begin(start)
    acted = []
    for _ in range(6 * 4):
        environment.step(policy.act(environment.observe()))
        acted.append(environment.observe()["previous_action"])
    assert np.array_equal(acted[3::4], targets)


@pytest.mark.medium
def test_a_teacher_acts_as_it_practised(tmp_path: Path) -> None:
    """One decision for four control periods, bit for bit; where a student acts, each period has a decision anew."""
    made = learn(tmp_path, privileged=True)
    start, targets = practised(made)
    environment = Environment(BUNDLE)
    teacher = Teacher(runner("ppo"), made, environment)
    environment.begin(start)
    acted = []
    for _ in range(6 * 4):
        environment.step(teacher.targets(acted=True))
        acted.append(environment.observe()["previous_action"])
    assert np.array_equal(acted[3::4], targets)
    environment.begin(start)
    first = teacher.targets(acted=True)
    environment.step(environment.previous_action)
    fresh = teacher.targets(acted=False)
    assert np.array_equal(fresh, Teacher(runner("ppo"), made, environment).targets(acted=True))
    assert not np.array_equal(fresh, first)


@pytest.mark.medium
def test_a_policy_holds_nothing_of_its_critic(tmp_path: Path) -> None:
    """Its input is the deployable channels alone, so there is no place where privileged numbers could enter."""
    made = learn(tmp_path)
    tensors = weights.from_bytes(made.weights)
    assert sorted(tensors) == sorted(
        f"{part}.{kind}" for part in ("body.0", "body.2", "head") for kind in ("weight", "bias")
    )
    public = (
        5 + 5 + 9 + 1 + 1 + 6
    )  # joints, targets, pose of the case, its lid, the goal; places that follow from joints
    assert tensors["body.0.weight"].shape == (16, public)
    assert {channel.name for channel in made.contract.inputs} == {
        "joints",
        "previous_action",
        "objects",
        "displacement",
        "goal",
    }


def test_privileged_numbers_full_of_nan_leave_actor_and_normalisation_alone(tmp_path: Path) -> None:
    made = learn(tmp_path, steps=32)
    practice = Practices(BUNDLE, made.contract)
    clean = practice.reset()[:, : practice.public]
    for name, value in practice.seen.items():
        if name.startswith("privileged/"):
            value[:] = np.nan
    numbers = practice._numbers()
    assert np.array_equal(numbers[:, : practice.public], clean)
    assert np.isnan(numbers[:, practice.public :]).any()


def test_normalisation_is_fixed_by_the_bundle(tmp_path: Path) -> None:
    stub, trained = learn(tmp_path, "stub"), learn(tmp_path, steps=32)
    assert stub.contract == trained.contract
    objects = next(channel for channel in stub.contract.inputs if channel.name == "objects")
    assert objects.names == ("case",)
    assert objects.mean[:3] == pytest.approx((0.3, -0.2, 0.01), abs=1e-6)


def test_a_robot_with_other_joints_is_refused(tmp_path: Path) -> None:
    made = learn(tmp_path, "stub")
    with pytest.raises(RuleError, match="the policy does not fit the task bundle") as caught:
        load(made, episodes.bundle())
    assert "another embodiment" in caught.value.facts


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"groups": (), "control": "joints"}, "has no joints in `groups`"),
        ({"grip": "pinch"}, "has no grip `pinch`"),
    ],
)
def test_options_that_make_no_sense_are_refused(tmp_path: Path, options: dict[str, Any], message: str) -> None:
    with pytest.raises(RuleError, match=message):
        learn(tmp_path, "stub", **options)


@pytest.mark.parametrize(
    ("inputs", "message"),
    [
        (("joints", "objects"), "moves targets by steps and needs `previous_action`; add it to `inputs`"),
        (("joints", "previous_action", "rgb"), "`rgb` is no channel that this policy can take"),
        (("joints", "previous_action", "tip_poses"), "`tip_poses` is privileged: only a simulator measures it"),
    ],
)
def test_inputs_that_it_cannot_take_are_refused_before_anything_is_built(
    tmp_path: Path, inputs: tuple[str, ...], message: str
) -> None:
    kind = RuleRunner(tmp_path).find("learn.ppo").rule.options
    with pytest.raises(ValidationError, match=message):
        kind.model_validate({"inputs": inputs})


def test_a_robot_without_a_palm_is_steered_joint_by_joint(tmp_path: Path) -> None:
    frames = {role: site for role, site in BUNDLE.robot.frames.items() if role != "palm"}
    fields = {name: getattr(BUNDLE.robot, name) for name in RobotModel.model_fields if name != "limbs"}
    bundle = BUNDLE.model_copy(update={"robot": RobotModel(**fields | {"frames": frames})})
    with pytest.raises(RuleError, match="no frame `palm` that could be steered") as caught:
        learn(tmp_path, "stub", bundle)
    assert caught.value.hint == "set `control: joints`"
    made = learn(tmp_path, "stub", bundle, control="joints")
    assert made.contract.settings["joints"] == "x y z"


def test_the_stub_is_quick_and_complete(tmp_path: Path) -> None:
    runner = RuleRunner(tmp_path)
    runner.run("learn.ppo", profile="stub", bundle=BUNDLE)
    assert runner.outcome.line.endswith("% success while exploring")
    assert len(runner.outcome.previews) == 2
