"""evaluate.rollouts of a policy that runs elsewhere: the same trials as here, and no hidden failures of a network."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.artifacts.tasks.trials import Trials
from dextera_build.errors import MachineError
from dextera_build.policy.wire.codec import pack
from dextera_build.testing import RuleRunner
from tests import gate
from tests.policy import policies
from tests.serving import servers

BUNDLE = gate.bundle()


def trials(runner: RuleRunner, checkpoint: Checkpoint, count: int) -> Trials:
    found = runner.run("evaluate.rollouts", bundle=BUNDLE, checkpoint=checkpoint, options={"trials": count})
    assert isinstance(found, Trials)
    return found


@pytest.fixture
def runner(tmp_path: Path) -> RuleRunner:
    return RuleRunner(tmp_path / "served", made_by={"checkpoint": "learn.served"})


def behind(runner: RuleRunner, address: str, **options: Any) -> Checkpoint:
    found = runner.run("learn.served", bundle=BUNDLE, options={"address": address} | options)
    assert isinstance(found, Checkpoint)
    return found


@pytest.mark.medium
def test_trials_of_a_served_policy_are_those_of_the_local_one(runner: RuleRunner, tmp_path: Path) -> None:
    contract = policies.contract(BUNDLE, every=2, forget=0.1)
    action = contract.action.model_copy(update={"mean": (0.6,), "scale": (0.2,)})
    act = policies.checkpoint(contract.model_copy(update={"action": action}))
    here = trials(RuleRunner(tmp_path / "act", made_by={"checkpoint": "learn.act"}), act, 2)
    with servers.running(servers.served(act, BUNDLE)) as address:
        there = trials(runner, behind(runner, address), 2)
    assert (there.label, there.algorithm) == ("SERVED", "served")
    assert [trial.model_dump() for trial in there.items] == [trial.model_dump() for trial in here.items]
    assert runner.encode(there.examples) == runner.encode(here.examples)


def chunk(target: float) -> bytes:
    return pack({"actions": np.full((1, 1), gate.target(target))})


def after(count: int, then: Callable[[], bytes | str | None]) -> Callable[[bytes], bytes | str | None]:
    """Answers that succeed, but for one number `count`."""
    asked = iter(range(10**9))

    def answer(data: bytes) -> bytes | str | None:
        return then() if next(asked) == count else chunk(gate.PUSHES)

    return answer


@pytest.mark.parametrize(
    ("fault", "reason"),
    [
        (lambda: None, "the connection to the policy at `ADDRESS` was lost"),
        (lambda: "out of memory", "the policy at `ADDRESS` answered with an error: out of memory"),
        (lambda: pack({"actions": np.zeros((1, 2))}), "the answer of the policy at `ADDRESS` has 2 numbers a step"),
    ],
)
def test_a_fault_in_a_trial_fails_that_trial_alone(
    fault: Callable[[], bytes | str | None], reason: str, runner: RuleRunner
) -> None:
    with servers.scripted(servers.foreign(after(5, fault))) as address:
        found = trials(runner, behind(runner, address), 3)
    assert [trial.success for trial in found.items] == [False, True, True]
    (told,) = found.reasons
    assert told.startswith(reason.replace("ADDRESS", address))
    (failed,) = found.examples.failures.values()
    assert len(failed.action) == 5  # nothing was sent after the fault


def test_without_a_server_no_trial_counts_as_failed(runner: RuleRunner) -> None:
    with servers.scripted(servers.foreign(lambda data: chunk(gate.PUSHES))) as address:
        made = behind(runner, address)
    with pytest.raises(MachineError, match="no policy can be asked"):
        trials(runner, made, 2)
