"""evaluate.replay: what it refuses, and the record that it keeps; the replay itself is tested in `tests/sim`."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.errors import RuleError
from dextera_build.policy.layout import embodiment
from dextera_build.testing import RuleRunner
from tests import episodes


@pytest.fixture
def runner(tmp_path):
    return RuleRunner(tmp_path)


def sources() -> Episodes:
    return episodes.small().model_copy(update={"embodiment": embodiment(episodes.robot())})


def world(**task: object) -> TaskBundle:
    twin = episodes.bundle()
    return twin.model_copy(update={"kind": "reference", "task": twin.task.model_copy(update=task)})


def test_the_record_of_a_replay(runner):
    found = runner.run(
        "evaluate.replay",
        profile="stub",
        twin=episodes.bundle(),
        world=world(),
        sources=sources(),
        options={"trials": 20, "resets": 40},
    )
    assert len(found.items) == 20
    assert (found.actor, found.label, found.algorithm, found.world) == ("replay", "replay", "", "reference")
    assert found.source == runner.encode(sources())
    assert runner.outcome.line.endswith(" in the reference")
    assert {episode.origin for episode in found.examples.items.values()} == {"replay"}


def test_replays_and_policies_face_the_same_starts(runner):
    from tests.policy import policies

    contract = policies.contract(episodes.bundle())
    made = policies.checkpoint(contract)
    options = {"trials": 5, "seed": 3}
    one = runner.run("evaluate.rollouts", profile="stub", bundle=world(), checkpoint=made, options=options)
    other = runner.run(
        "evaluate.replay",
        profile="stub",
        twin=episodes.bundle(),
        world=world(),
        sources=sources(),
        options=options,
    )
    assert [trial.seed for trial in one.items] == [trial.seed for trial in other.items]
    assert np.array_equal(one.placed, other.placed)


@pytest.mark.parametrize("backend", ["stub", "mujoco"])
def test_worlds_that_do_not_belong_together_are_refused(runner, backend):
    twin, demos = episodes.bundle(), sources()

    def refused(**given: object) -> RuleError:
        with pytest.raises(RuleError) as caught:
            runner.run(
                "evaluate.replay", backend=backend, **({"twin": twin, "world": world(), "sources": demos} | given)
            )
        return caught.value

    assert refused(twin=world(), world=twin).message == "the input `twin` is a reference world"
    other = refused(world=world(name="LiftCan", control_hz=10.0))
    assert other.message == "the two worlds do not hold the same task: task, control rate"
    assert other.facts["task"] == "LiftBox in the twin, LiftCan in the world"
    fewer = world().model_copy(update={"objects": {"box": twin.objects["box"]}})
    assert refused(world=fewer).message == "the two worlds do not hold the same task: objects, joints"
    of_others = demos.model_copy(update={"task": "LiftCan"})
    assert refused(sources=of_others).message == "the data set does not fit the task bundle: another task"
    assert refused(sources=demos.model_copy(update={"items": {}})).message == "no demonstrations were given"
