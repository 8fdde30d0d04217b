"""Worlds in a batch: what is refused, and that every one does what MuJoCo does with it alone."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.packed import pack
from dextera_build.artifacts.tasks.episode import Start
from dextera_build.artifacts.tasks.task import Reset, TaskBundle
from dextera_build.errors import MachineError, RuleError
from dextera_build.sim.runtime import batch
from dextera_build.sim.runtime.batch import Batch
from dextera_build.sim.runtime.environment import Environment
from tests import task_bundles

PLAN = [
    ((0.3, 0.1, 0.1), 0.05, 18),
    ((0.3, 0.1, 0.0), 0.05, 8),
    ((0.3, 0.1, 0.0), 0.012, 6),
    ((0.3, 0.1, 0.15), 0.012, 40),
]
"""Slides of the palm and of the fingers [m], and control periods, of a lift."""


def test_without_warp_the_error_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco_warp", None)
    with pytest.raises(MachineError) as caught:
        Batch(task_bundles.lift(), [Environment(task_bundles.lift()).start])
    assert caught.value.code == "DXB-E302"
    assert "[batch]" in str(caught.value.hint)


@pytest.mark.slow
class TestWithWarp:
    """Needs the extra `batch`; Warp compiles its kernels at their first use, which takes a minute."""

    @pytest.fixture(autouse=True)
    def warp(self) -> None:
        pytest.importorskip("mujoco_warp")

    def test_verdicts_and_ways_are_those_of_mujoco(self) -> None:
        """Different masses, frictions, gains and places; every second world shuts the hand too late."""
        bundle = task_bundles.lift(reset=Reset(position_m=0.004, dynamics=1.0, joints=1.0))
        alone = Environment(bundle)
        starts = [alone.draw(seed) for seed in range(6)]
        assert len({start.mass_scale["box"] for start in starts}) == len({start.gain_scale for start in starts}) == 6
        batch_of_six = Batch(bundle, starts, "cpu")
        actions = [actions_of(late=bool(number % 2)) for number in range(6)]
        together = [batch_of_six.step(np.array(each)) for each in zip(*actions, strict=True)]
        for number, (start, targets) in enumerate(zip(starts, actions, strict=True)):
            alone.begin(start)
            outcomes = [alone.step(target) for target in targets]
            found = [each[number] for each in together]
            assert any(outcome.success for outcome in outcomes) is not bool(number % 2)
            assert any(outcome.success for outcome in found) is not bool(number % 2)
            for one, other in zip(outcomes, found, strict=True):
                assert one.executed.tobytes() == other.executed.tobytes()
            there, here = batch_of_six.worlds[number].observe(), alone.observe()
            together = {name: values[number].tobytes() for name, values in batch_of_six.observe().items()}
            assert together == {name: values.tobytes() for name, values in there.values.items()}
            # Not the lid, which creeps under its friction where it does not sleep.
            assert np.allclose(there["objects"][0], here["objects"][0], atol=1e-3)
            assert np.allclose(there["joints"], here["joints"], atol=1e-4)

    def test_an_action_that_is_not_finite_ends_one_episode_and_no_other(self) -> None:
        bundle = task_bundles.lift()
        two = Batch(bundle, [Environment(bundle).start] * 2, "cpu")
        actions = np.array([np.full(5, np.nan), two.worlds[1].previous_action])
        bad, good = two.step(actions)
        assert (bad.over, bad.reason) == (True, "the action for `x` is not a finite number")
        assert not good.over

    def test_the_code_of_the_page_runs(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
        page = Path(batch.__file__).parents[2] / "docs" / "gymnasium.md"
        (code,) = re.findall(r"^```py\n(.*?)^```", page.read_text(), re.DOTALL | re.MULTILINE)
        (tmp_path / "bundles").mkdir()
        bundle = task_bundles.lift(reset=Reset(position_m=0.03))
        (tmp_path / "bundles" / "LiftBlueMug-KL-v0.bundle").write_bytes(pack(bundle))
        monkeypatch.chdir(tmp_path)
        exec(code.replace("range(64)", "range(3)"), {})
        assert capsys.readouterr().out.startswith("False [[")

    def test_sizes_that_differ_are_refused(self) -> None:
        start = Environment(task_bundles.lift()).start
        with pytest.raises(RuleError) as caught:
            Batch(task_bundles.lift(), [start, start.model_copy(update={"size_scale": {"box": 1.1}})], "cpu")
        assert caught.value.code == "DXB-B221"

    def test_what_warp_does_not_know_is_named(self) -> None:
        bundle, start = unknown_to_warp()
        with pytest.raises(RuleError) as caught:
            Batch(bundle, [start], "cpu")
        assert caught.value.code == "DXB-B222"
        assert "mjENBL_FWDINV" in str(caught.value.facts)

    def test_more_contacts_than_there_is_room_for_are_an_error(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(batch, "CONTACTS", 2)
        bundle = task_bundles.lift()
        world = Batch(bundle, [Environment(bundle).start], "cpu")
        with pytest.raises(RuleError) as caught:
            world.step(np.array([world.worlds[0].previous_action]))
        assert caught.value.code == "DXB-B223"


def actions_of(*, late: bool) -> list[np.ndarray]:
    """Joint targets of a lift; late: the fingers shut above the box."""
    plan = [PLAN[0], PLAN[1], *([(PLAN[3][0], 0.05, 20)] if late else []), *PLAN[2 + late :]]
    found = [np.array([*place, fingers, fingers]) for place, fingers, periods in plan for _ in range(periods)]
    return (found + found[-1:] * 80)[:78]


def unknown_to_warp() -> tuple[TaskBundle, Start]:
    """A task whose model asks for something that MuJoCo Warp does not have."""
    bundle = task_bundles.lift()
    scene = bundle.model.files["scene.xml"].replace(
        b'impratio="10"/>', b'impratio="10"><flag fwdinv="enable"/></option>'
    )
    assert scene != bundle.model.files["scene.xml"]
    return bundle.model_copy(update={"model": Folder(files={"scene.xml": scene})}), Environment(bundle).start
