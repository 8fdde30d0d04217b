"""`task/as_published`: each algorithm trains and acts at the size that its authors give."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from dextera_build.learning import weights
from dextera_build.testing import RuleRunner
from tests import episodes
from tests.policy import policies

REPO = Path(__file__).parents[3]
NODES = yaml.safe_load((REPO / "recipes" / "task" / "as_published.yaml").read_text())["nodes"]
SHAPES = {
    "act": ("encoder.3.mlp.0.weight", (3200, 512)),
    "diffusion": ("body.middle.second.first.0.weight", (1024, 1024, 5)),
    "diffusion_transformer": ("body.blocks.7.linear1.weight", (1024, 256)),
    "bc_rnn": ("lstm.weight_hh_l1", (1600, 400)),
}
"""A weight of each, and its shape."""


@pytest.mark.slow
@pytest.mark.parametrize("name", SHAPES)
def test_two_steps_at_the_size_of_the_authors(name: str, tmp_path: Path) -> None:
    options = {key: value for key, value in NODES[name].items() if key not in ("rule", "bundle", "episodes")}
    options |= {"steps": 2, "batch": 2, "held_out": 0.0}
    made = RuleRunner(tmp_path).run(
        NODES[name]["rule"], backend="torch", bundle=episodes.bundle(), episodes=episodes.small(3, 30), options=options
    )
    weight, shape = SHAPES[name]
    assert tuple(weights.from_bytes(made.weights)[weight].shape) == shape
    assert np.isfinite(policies.load(made, episodes.bundle()).act(policies.observation())).all()
