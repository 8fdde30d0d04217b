"""Task bundles by name, file and reference: every way to Gymnasium's `make`."""

from __future__ import annotations

import shutil
import subprocess
import warnings
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.wrappers import FlattenObservation, RescaleAction
from stable_baselines3.common.env_checker import check_env

from dextera_build import envs
from dextera_build.artifacts.packed import pack
from dextera_build.artifacts.tasks.task import Reset, TaskBundle
from dextera_build.bundle.closure_of_targets import survey
from dextera_build.bundle.config import Build, Contents
from dextera_build.bundle.export import Export
from dextera_build.engine.graph import Address
from dextera_build.engine.key import Writer
from dextera_build.errors import MachineError, UsageError
from dextera_build.store.entry import ActionResult
from dextera_build.store.store import Store
from tests import task_bundles
from tests.engine.tiny import call, graph

ANY = f"dextera_build.envs:{envs.ANY}"


@pytest.fixture(scope="module")
def task() -> TaskBundle:
    return task_bundles.lift(reset=Reset(position_m=0.03))


def archive(path: Path, *tasks: TaskBundle) -> Path:
    """A bundle of results whose targets are these tasks, as `dxb bundle create` writes it."""
    store = Store(path.with_suffix(".store"))
    nodes = [call(f"task_{number}", "const", str(number)) for number in range(len(tasks))]
    plan = graph(*nodes)
    for node, each in zip(nodes, tasks, strict=True):
        document = store.blobs.put(Writer().document(node, {}))
        store.actions.put(document, ActionResult(each.encode(store.blobs.put), "", (), {}, 1.0, None, document))
    wanted = [Address((node.name,)) for node in nodes]
    found = survey(plan, wanted, store, "targets", lambda file: file.name)
    build = Build("task/lift", found.targets, "cpu", found.nodes)
    Export(store, Contents("targets", "1.0", (build,), {"task/lift": "nodes: {}\n"})).write(path)
    return path


def starts_alike(environment: gymnasium.Env, task: TaskBundle) -> bool:
    """Whether an environment is of this task: the same seed begins the same episode."""
    wanted, _ = envs.make(task).reset(seed=5)
    seen, _ = environment.reset(seed=5)
    return all(np.array_equal(seen[name], value) for name, value in wanted.items())


def test_a_name_is_looked_up_when_the_environment_is_made(task, tmp_path, monkeypatch):
    """The module was imported long before the variable is set and the file is written."""
    monkeypatch.setenv("DXB_BUNDLES", f"{tmp_path / 'none'}:{tmp_path}")
    (tmp_path / "LiftBox-GANTRY-v0.bundle").write_bytes(pack(task))
    for name in ("LiftBox-GANTRY-v0", "dxb/LiftBox-GANTRY-v0", tmp_path / "LiftBox-GANTRY-v0.bundle"):
        assert starts_alike(gymnasium.make(ANY, bundle=name), task)
    several = gymnasium.make_vec(
        ANY, num_envs=2, vectorization_mode="vector_entry_point", bundle="LiftBox-GANTRY-v0", action="delta"
    )
    assert several.action_space.shape == (2, 5)
    with pytest.raises(UsageError, match="no bundle `LiftBx-GANTRY-v0`") as caught:
        gymnasium.make(ANY, bundle="LiftBx-GANTRY-v0")
    assert "did you mean `LiftBox-GANTRY-v0`?" in str(caught.value.hint)


def test_a_bundle_of_results_holds_one_task(task, tmp_path):
    assert starts_alike(gymnasium.make(ANY, bundle=str(archive(tmp_path / "one.tar", task))), task)
    with pytest.raises(UsageError, match="has 2 tasks among its targets"):
        envs.find(archive(tmp_path / "two.tar", task, task_bundles.close()))


@pytest.mark.skipif(not shutil.which("skopeo"), reason="`make servers`")
def test_a_reference_is_copied_by_skopeo(task, tmp_path):
    path = archive(tmp_path / "one.tar", task)
    copied = f"oci:{tmp_path / 'layout'}:v1"
    subprocess.run(["skopeo", "copy", "--quiet", f"oci-archive:{path}", copied], check=True)
    assert starts_alike(gymnasium.make(ANY, bundle=copied), task)
    with pytest.raises(MachineError, match="cannot be copied") as caught:
        envs.find(f"oci:{tmp_path / 'layout'}:v2")
    assert "v2" in str(caught.value.facts["skopeo"])


def test_wrapped_as_the_page_says_stable_baselines_has_no_remark(task):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", ".*lowered by casting to float32")  # joint limits, rounded by Gymnasium
        check_env(FlattenObservation(RescaleAction(envs.make(task), -1.0, 1.0)))
