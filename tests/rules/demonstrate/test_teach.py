"""demonstrate.teach: what a student sees, what its teacher answers, and that the answers help."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.artifacts.tasks.task import Reset
from dextera_build.errors import RuleError
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.training.teaching import Teacher
from dextera_build.testing import RuleRunner
from tests import task_bundles
from tests.policy import policies
from tests.rules.learn.test_ppo import SMALL, successes

BUNDLE = task_bundles.close(reset=Reset(position_m=0.01, joint_rad=0.1, robot_rad=0.005))
EXACT = {"position_m": 0.0, "rotation_deg": 0.0, "loss": 0.0}


def taught(tmp_path: Path, **more: Any) -> Checkpoint:
    options = SMALL | {"privileged": True} | more
    made = RuleRunner(tmp_path).run("learn.ppo", backend="sb3", bundle=BUNDLE, options=options)
    assert isinstance(made, Checkpoint)
    return made


@pytest.fixture(scope="module")
def teacher(tmp_path_factory: pytest.TempPathFactory) -> Checkpoint:
    return taught(tmp_path_factory.mktemp("teacher"))


def teach(
    tmp_path: Path, teacher: Checkpoint, student: Checkpoint | None = None, backend: str = "mujoco", **options: Any
) -> Episodes:
    makers = {"teacher": "learn.ppo", "student": "learn.act"}
    given = {"teacher": teacher} if student is None else {"teacher": teacher, "student": student}
    runner = RuleRunner(tmp_path, made_by={slot: makers[slot] for slot in given})
    made = runner.run("demonstrate.teach", backend=backend, bundle=BUNDLE, options=options, **given)
    assert isinstance(made, Episodes)
    return made


def untrained() -> Checkpoint:
    return policies.checkpoint(policies.contract(BUNDLE))


@pytest.mark.medium
def test_labels_are_what_the_teacher_would_do_in_the_true_state(tmp_path: Path, teacher: Checkpoint) -> None:
    made = teach(tmp_path, teacher, untrained(), episodes=1, position_m=0.01).items["00000"]
    environment = Environment(BUNDLE)
    asked = Teacher(policies.runner("ppo"), teacher, environment)
    environment.begin(made.start)
    for label, sent in zip(made.action[:20], made.executed, strict=False):
        np.testing.assert_allclose(asked.targets(acted=False), label, atol=1e-6)
        environment.step(sent)
    assert np.abs(made.action - made.executed).max() > 1e-3, "the student acted"


def test_without_a_student_the_teacher_acts(tmp_path: Path, teacher: Checkpoint) -> None:
    made = teach(tmp_path, teacher, episodes=2, first=7, **EXACT)
    assert list(made.items) == ["00007", "00008"]
    environment = Environment(BUNDLE)
    for one in made.items.values():
        environment.begin(one.start)
        sent = [environment.step(action).executed for action in one.action]
        np.testing.assert_allclose(np.array(sent), one.executed, atol=1e-6)


def test_noise_is_what_the_student_sees_and_changes_no_start(tmp_path: Path, teacher: Checkpoint) -> None:
    exact = teach(tmp_path, teacher, episodes=1, **EXACT).items["00000"]
    noisy = teach(tmp_path, teacher, episodes=1, position_m=0.004, rotation_deg=2.0, loss=0.0).items["00000"]
    np.testing.assert_array_equal(noisy.start.qpos, exact.start.qpos)
    np.testing.assert_array_equal(noisy.action, exact.action)
    error = (noisy.objects - exact.objects)[..., :3]
    assert 0.003 < error.std() < 0.005
    np.testing.assert_array_equal(noisy.joints, exact.joints)


def test_a_lost_measurement_leaves_the_previous_one(tmp_path: Path, teacher: Checkpoint) -> None:
    made = teach(tmp_path, teacher, episodes=1, position_m=0.004, loss=0.5).items["00000"].objects[:, 0, :3]
    same = (made[1:] == made[:-1]).all(axis=1)
    assert 0.3 < same.mean() < 0.7


@pytest.mark.slow
def test_a_round_repeats_bit_for_bit(tmp_path: Path, teacher: Checkpoint) -> None:
    one, other = (teach(tmp_path / name, teacher, untrained(), episodes=1, led=0.5) for name in "ab")
    np.testing.assert_array_equal(one.items["00000"].executed, other.items["00000"].executed)
    np.testing.assert_array_equal(one.items["00000"].objects, other.items["00000"].objects)


@pytest.mark.medium
def test_led_by_the_teacher_nothing_is_the_students(tmp_path: Path, teacher: Checkpoint) -> None:
    made = teach(tmp_path, teacher, untrained(), episodes=1, led=1.0).items["00000"]
    alone = teach(tmp_path, teacher, episodes=1).items["00000"]
    np.testing.assert_array_equal(made.executed, alone.executed)


def test_a_teacher_runs_nowhere_else(teacher: Checkpoint) -> None:
    with pytest.raises(RuleError, match="sees the state of the simulator") as caught:
        policies.load(teacher, BUNDLE)
    assert "demonstrate.teach" in str(caught.value.hint)


def test_a_policy_that_remembers_is_no_teacher(tmp_path: Path) -> None:
    remembers = policies.checkpoint(policies.contract(BUNDLE, history=2))
    with pytest.raises(RuleError, match="that remembers is no teacher"):
        Teacher(policies.runner("act"), remembers, Environment(BUNDLE))


def test_the_stub_needs_no_simulator(tmp_path: Path, teacher: Checkpoint) -> None:
    assert len(teach(tmp_path, teacher, backend="stub", episodes=3).items) == 3


@pytest.mark.slow
def test_a_student_that_sees_less_learns_to_close_a_lid(tmp_path: Path) -> None:
    """A teacher on privileged state, two rounds of correction, and a student that succeeds about as often."""
    teacher = taught(tmp_path, steps=20_000, worlds=8, rollout=32, batch=128, epochs=10, width=64)
    rounds = {"0": teach(tmp_path, teacher, episodes=20)}
    student = None
    for number in (1, 2):
        student = learned(tmp_path, rounds)
        rounds[str(number)] = teach(tmp_path, teacher, student, episodes=20, first=20 * number)
    student = learned(tmp_path, rounds)
    shown = sum(one.success for one in rounds["0"].items.values())
    assert shown >= 10
    assert successes(student) >= shown - 5


def learned(tmp_path: Path, rounds: dict[str, Episodes]) -> Checkpoint:
    data = RuleRunner(tmp_path).run("demonstrate.gather", shards=Collection[Episodes](items=rounds))
    options = {"steps": 800, "width": 32, "heads": 2, "chunk": 8, "batch": 64}
    made = RuleRunner(tmp_path).run("learn.act", backend="torch", bundle=BUNDLE, episodes=data, options=options)
    assert isinstance(made, Checkpoint)
    return made
