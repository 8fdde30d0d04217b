"""Rules that train, cast rays or cut into convex pieces say how far their results differ between machines."""

from __future__ import annotations

import json
import math
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from dextera_build.artifacts.comparison.difference import by_field, differences
from dextera_build.code.loader import RuleFile
from dextera_build.store.store import Store
from tests.rules.test_contract import LIBRARY, RULES

ROOT = Path(__file__).parents[2]
DIFFER = re.compile(
    r"^\s*(import|from) (torch|coacd|open3d|stable_baselines3|dextera_build\.learning\.gaussian_fit)\b"
    r"|^from dextera_build\.geometry import .*\braycast\b",
    re.MULTILINE,
)
"""Imports of what trains, cuts and casts rays."""

EXACT = {
    **dict.fromkeys(
        ("reference.convex_pieces", "factorize.collision"),
        "CoACD and the distances of Open3D gave equal bytes whatever instructions the processor has",
    ),
    **dict.fromkeys(
        ("benchmark.method_table", "benchmark.curves"), "they need names of columns from the module that casts the rays"
    ),
    **dict.fromkeys(("align.follow", "factorize.segment"), "only backends with pretrained networks reach torch"),
    **dict.fromkeys(
        ("reference.perfect_asset", "evaluate.views", "evaluate.visible"),
        "they ask rays what is seen and fit nothing to it; rays gave equal bytes wherever that was measured",
    ),
}
"""Rules without a tolerance that import one of these -> why."""


def imports(found: RuleFile) -> bool:
    """Whether the rule, a backend other than its stub, or a module of its stage imports one of these."""
    backends = [backend.file for name, backend in found.backends.items() if name != "stub"]
    reached = LIBRARY.code.of(found.file, *backends).sources
    own = [ROOT / name for name in reached if name.startswith("rules/")]
    return any(DIFFER.search(file.read_text()) for file in own if file.exists())


@pytest.mark.slow
def test_what_may_differ_between_machines_declares_by_how_much_or_is_known_to_be_exact():
    reaching = {found.path for found in RULES if imports(found)}
    declared = {found.path for found in RULES if found.rule.tolerance.fields}
    assert {"learn.act", "learn.ppo", "factorize.mesh", "align.object"} <= reaching
    assert reaching - declared == set(EXACT)


TRAIN = """
import json
import sys
from pathlib import Path
from dextera_build.store.store import Store
from dextera_build.testing import RuleRunner
from tests import episodes
from tests.rules.learn.test_act import ACT, BUNDLE

folder = Path(sys.argv[1])
runner = RuleRunner(folder / sys.argv[2])
made = runner.run("learn.act", backend="torch", bundle=BUNDLE, episodes=episodes.small(4, 30), options=ACT.small)
told = {name: value for name, (value, _) in runner.outcome.metrics.items()}
print(json.dumps([made.encode(Store(folder / "store").writer), told]))
"""


@pytest.mark.slow
@pytest.mark.skipif(
    " avx2 " not in Path("/proc/cpuinfo").read_text(), reason="needs a processor with AVX2 to do without"
)
def test_a_training_on_another_processor_is_within_its_tolerance(tmp_path):
    """The same episodes give other weights without AVX2, and a policy that is as good."""
    made = []
    for capability in ("avx2", "default"):
        command = [sys.executable, "-c", TRAIN, str(tmp_path), capability]
        environment = {**os.environ, "ATEN_CPU_CAPABILITY": capability, "OMP_NUM_THREADS": "1"}
        done = subprocess.run(command, env=environment, cwd=ROOT, capture_output=True, text=True, check=True)
        made.append(json.loads(done.stdout))
    (first, told), (again, told_again) = made
    found = by_field(differences(first, again, Store(tmp_path / "store").blobs.get, motions=False))
    tolerance = LIBRARY.find("learn.act").rule.tolerance
    assert "weights" in found
    assert not [name for name, apart in found.items() if (math.inf if apart is None else apart) > tolerance.of(name)]
    assert tolerance.metrics.keys() <= told.keys()
    assert all(abs(told[name] - told_again[name]) <= allowed for name, allowed in tolerance.metrics.items())
