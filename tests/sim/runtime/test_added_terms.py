"""Terms of a project in a simulated task."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.tasks.term import TermSpec
from dextera_build.geometry import transforms
from dextera_build.policy.added import AddedTerm
from dextera_build.policy.seen import Seen
from dextera_build.sim.runtime.environment import Environment
from tests import gate

PALMS = TermSpec(term="palms", about="the palms in the world", rows="limbs", parts=("x", "y", "z"), unit="m")


def palms(worlds: Seen) -> np.ndarray:
    return transforms.apply(worlds.world_from_base, worlds.palms[..., :3])


def test_a_term_knows_the_world_and_so_the_table_by_the_calibrated_base() -> None:
    environment = Environment(gate.bundle(), terms=[AddedTerm(PALMS, palms)])
    assert not np.allclose(environment.bundle.base_pose.matrix, np.eye(4), atol=0.1)
    found = environment.begin(environment.start)["palms"]
    assert np.allclose(found, environment.data.site("robot/palm").xpos, atol=1e-6)
    # The true base of an episode is not known to a policy, so the term is off by its error.
    moved = environment.start.model_copy(update={"base_error": (0.02, 0.0, 0.0, 0.0, 0.0, 0.0)})
    found = environment.begin(moved)["palms"]
    assert np.isclose(np.linalg.norm(found - environment.data.site("robot/palm").xpos), 0.02, atol=1e-6)
