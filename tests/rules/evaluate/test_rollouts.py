"""evaluate.rollouts: policies in closed loop."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.errors import RuleError
from dextera_build.testing import RuleRunner
from tests import episodes, factories, gate
from tests.policy import policies
from tests.sim.runtime import cells


@pytest.fixture
def runner(tmp_path):
    return RuleRunner(tmp_path, made_by={"checkpoint": "learn.act"})


def saying(goal: float, bundle: TaskBundle, inputs: tuple[str, ...] = policies.INPUTS, view=None) -> Checkpoint:
    """A checkpoint whose network is weighed with 0, so that it says one target."""
    contract = policies.contract(bundle, inputs, view)
    action = contract.action.model_copy(update={"mean": (gate.target(goal),), "scale": (0.0,)})
    return policies.checkpoint(contract.model_copy(update={"action": action}))


def drunk(bundle: TaskBundle) -> Checkpoint:
    """A checkpoint whose network overflows."""
    from dextera_build.learning import weights

    made = saying(gate.PUSHES, bundle)
    tensors = weights.from_bytes(made.weights)
    tensors["head.weight"].fill_(3e38)
    tensors["head.bias"].fill_(3e38)
    return made.model_copy(update={"weights": weights.to_bytes(tensors)})


@pytest.mark.medium
def test_a_policy_that_pushes_succeeds_from_every_start(runner):
    bundle = gate.bundle()
    found = runner.run(
        "evaluate.rollouts", bundle=bundle, checkpoint=saying(gate.PUSHES, bundle), options={"trials": 6}
    )
    assert found.successes == 6
    assert (found.actor, found.label, found.algorithm, found.world, found.robot) == (
        *("policy", "ACT", "act"),
        *("twin", "kuka_leap"),
    )
    assert found.source == runner.encode(saying(gate.PUSHES, bundle))
    assert runner.outcome.line == "6/6 (61-100 %) in the twin"
    assert runner.outcome.metrics["success"] == (100.0, "%")
    assert found.mean_time_s == pytest.approx(1.1, abs=0.4)
    assert (list(found.examples.items), found.examples.failures) == (["0"], {})
    assert len({trial.start for trial in found.items}) == 6


@pytest.mark.medium
def test_one_that_stops_short_fails_with_its_reason(runner):
    bundle = gate.bundle("reference")
    found = runner.run(
        "evaluate.rollouts", bundle=bundle, checkpoint=saying(gate.STOPS_SHORT, bundle), options={"trials": 3}
    )
    assert found.reasons == {"not done within 3 s: a joint is not at its command": 3}
    assert found.mean_time_s is None
    assert list(found.examples.failures) == ["0"]
    assert runner.outcome.line == "0/3 (0-56 %) in the reference"


@pytest.mark.medium
@pytest.mark.parametrize(
    ("goal", "stage", "progress"), [(gate.STOPS_SHORT, "moved", 0.25), (0.5, "halfway", 0.5), (0.8, "success", 1.0)]
)
def test_progress_is_the_last_stage_that_the_true_state_reached(runner, goal, stage, progress):
    bundle = gate.bundle()
    found = runner.run("evaluate.rollouts", bundle=bundle, checkpoint=saying(goal, bundle), options={"trials": 2})
    assert found.stages == ("moved", "halfway", "at its command", "success")
    assert [found.stages[trial.stage - 1] for trial in found.items] == [stage] * 2
    assert found.progress.tolist() == [progress] * 2
    assert runner.outcome.metrics["progress"] == (100 * progress, "%")


@pytest.mark.medium
def test_all_policies_face_the_same_starts_and_another_seed_gives_others(runner):
    bundle = gate.bundle()

    def starts(goal: float, trials: int, seed: int) -> list[str]:
        found = runner.run(
            "evaluate.rollouts",
            bundle=bundle,
            checkpoint=saying(goal, bundle),
            options={"trials": trials, "seed": seed},
        )
        return [trial.start for trial in found.items]

    first = starts(gate.PUSHES, 3, 0)
    assert starts(gate.STOPS_SHORT, 5, 0)[:3] == first
    assert not set(starts(gate.PUSHES, 3, 1)) & set(first)


@pytest.mark.slow
def test_twin_and_reference_place_objects_alike(runner):
    both = [
        runner.run(
            "evaluate.rollouts",
            bundle=bundle,
            checkpoint=saying(gate.PUSHES, bundle),
            options={"trials": 4},
        )
        for bundle in (gate.bundle(ball=True), gate.bundle("reference", peg_m=0.05, ball=True))
    ]
    assert both[0].placed == pytest.approx(both[1].placed, abs=1e-6)
    assert both[0].successes > both[1].successes == 0


@pytest.mark.medium
def test_the_same_twice_is_the_same_bytes(runner):
    bundle = gate.bundle()
    made = saying(gate.PUSHES, bundle)
    one, other = (
        runner.run("evaluate.rollouts", bundle=bundle, checkpoint=made, options={"trials": 2}) for _ in range(2)
    )
    assert runner.encode(one) == runner.encode(other)


def test_numbers_that_are_no_numbers_fail_the_trial_alone(runner):
    bundle = gate.bundle()
    found = runner.run("evaluate.rollouts", bundle=bundle, checkpoint=drunk(bundle), options={"trials": 3})
    assert found.reasons == {"the policy gave NaN at step 0": 3}
    assert [trial.steps for trial in found.items] == [0, 0, 0]
    assert found.placed.shape == (3, 1, 7)


def test_a_policy_that_sees_gets_the_view_s_pictures(runner):
    bundle, view = gate.bundle(), gate.view()
    made = saying(gate.PUSHES, bundle, ("joints", "rgb"), view)
    found = runner.run("evaluate.rollouts", bundle=bundle, checkpoint=made, view=view, options={"trials": 1})
    assert (found.successes, found.label) == (1, "ACT image")


@pytest.mark.medium
@pytest.mark.parametrize("view", [None, gate.view()])
def test_a_film_strip_of_a_success_and_of_a_failure(runner, view):
    # The case is turned so far that one target is enough at some starts and not at others.
    bundle = gate.bundle(yaw_rad=0.5)
    seen = {} if view is None else {"view": view}
    found = runner.run(
        "evaluate.rollouts", bundle=bundle, checkpoint=saying(0.65, bundle), options={"trials": 8}, **seen
    )
    assert 0 < found.successes < 8
    (one, first), (other, second) = runner.outcome.previews
    assert (one.endswith(", success"), "failure: not done within 3 s: a joint is not at its command" in other) == (
        True,
        True,
    )
    assert one.startswith("OpenGate, trial ")
    assert first != second


@pytest.mark.medium
def test_with_a_cell_the_policy_sees_what_its_tracker_sees(runner):
    bundle = gate.bundle("reference")
    given = {"bundle": bundle, "checkpoint": saying(gate.PUSHES, bundle), "options": {"trials": 2}}
    exact = runner.run("evaluate.rollouts", **given)
    assert (exact.poses, exact.items[0].sighting) == ("exact", None)
    tracked = runner.run("evaluate.rollouts", cell=cells.cell(), **given)
    assert tracked.poses == "tracked"
    assert runner.outcome.line == "2/2 (34-100 %) in the reference, poses tracked"
    assert [trial.start for trial in tracked.items] == [trial.start for trial in exact.items]
    assert np.array_equal(tracked.placed, exact.placed)
    assert all(trial.sighting.tracked == trial.sighting.frames > 10 for trial in tracked.items)
    assert runner.outcome.metrics["found"] == (2.0, "of 2")
    assert runner.outcome.metrics["tracker, position, median"][0] < 2.0


def test_an_object_that_is_not_found_is_a_failure(runner):
    bundle = gate.bundle("reference")
    blind = cells.cell(loss=1.0, search_s=0.2)
    found = runner.run(
        "evaluate.rollouts",
        bundle=bundle,
        checkpoint=saying(gate.PUSHES, bundle),
        cell=blind,
        options={"trials": 2},
    )
    assert (found.reasons, found.excluded) == ({"the tracker did not find the object": 2}, {})
    assert [trial.sighting.found_s for trial in found.items] == [None, None]
    assert runner.outcome.metrics["found"] == (0.0, "of 2")


@pytest.mark.parametrize("backend", ["mujoco", "stub"])
def test_a_checkpoint_for_something_else_is_refused(runner, backend):
    bundle = gate.bundle()
    other = bundle.model_copy(update={"task": bundle.task.model_copy(update={"name": "CloseGate"})})
    with pytest.raises(RuleError, match="the policy does not fit the task bundle: another task"):
        runner.run("evaluate.rollouts", backend=backend, bundle=other, checkpoint=saying(0.8, bundle))
    arm = policies.checkpoint(policies.contract(episodes.bundle()))
    with pytest.raises(RuleError, match="another embodiment"):
        runner.run("evaluate.rollouts", backend=backend, bundle=bundle, checkpoint=arm)
    sees = saying(0.8, bundle, ("joints", "rgb"), gate.view())
    with pytest.raises(RuleError, match="no view"):
        runner.run("evaluate.rollouts", backend=backend, bundle=bundle, checkpoint=sees)


def test_starts_that_cannot_be_drawn_are_left_out_and_said(runner):
    crowded = gate.bundle(ball=True)
    inside = crowded.objects["ball"].model_copy(update={"pose": factories.placed(factories.pose(z=0.05))})
    bundle = crowded.model_copy(update={"objects": {"case": crowded.objects["case"], "ball": inside}})
    with pytest.raises(RuleError, match="no trial of `OpenGate` came about") as caught:
        runner.run("evaluate.rollouts", bundle=bundle, checkpoint=saying(0.8, bundle), options={"trials": 2})
    assert caught.value.facts["reasons"] == "2 x no start of `OpenGate` without collisions was found"


@pytest.mark.medium
def test_the_stub_needs_neither_simulator_nor_network(runner, tmp_path):
    found = runner.run(
        "evaluate.rollouts", profile="stub", bundle=episodes.bundle(), checkpoint=nothing(), options={"trials": 40}
    )
    assert 28 <= found.successes < 40
    assert found.placed.shape == (40, 2, 7)
    assert np.linalg.norm(found.placed[..., 3:], axis=-1) == pytest.approx(1.0)
    code = (
        "import sys\nfrom dextera_build.code.loader import Library\n"
        "for path in ('evaluate.rollouts', 'evaluate.replay'):\n"
        "    Library().find(path).backends['stub'].module\n"
        "print([name for name in ('torch', 'mujoco') if name in sys.modules])"
    )
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert answer.stdout.strip() == "[]"


def nothing() -> Checkpoint:
    """A checkpoint without weights that fits the hand-made task."""
    return Checkpoint(
        weights=b"",
        contract=policies.contract(episodes.bundle()),
        steps=np.array([1], np.int64),
        curve=np.array([1.0], np.float32),
        curve_name="L1 loss",
    )
