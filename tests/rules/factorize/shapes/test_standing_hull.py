"""A view that shows too little to fit a body still gives one, and says so."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dextera_build.geometry import solids
from dextera_build.rule import Context
from dextera_build.testing import RuleRunner
from rules.factorize.shapes import evidence, mesh_primitives
from tests import object_views
from tests.rules.factorize import synthetic_views as synthetic

BOX = solids.box((0.09, 0.06, 0.05), (0.0, 0.0, 0.025))


def test_a_hull_of_what_was_seen_stands_in(tmp_path):
    runner = RuleRunner(tmp_path)
    seen = synthetic.view(BOX, synthetic.Eye())
    found = runner.run("factorize.mesh", options={"least_points": 10**6}, **object_views.sights(seen))
    assert found.hypothesis == "hull"
    assert found.mesh.is_closed
    assert found.mesh.extent == pytest.approx([0.09, 0.06, 0.05], abs=0.015)
    assert "the convex hull of the seen points is used" in runner.outcome.warnings[0]
    assert found.asset_source == "rgbd"


@pytest.mark.medium
@pytest.mark.parametrize("count", [12, 30])
def test_a_dozen_pixels_are_enough(tmp_path, count):
    seen = synthetic.view(BOX, synthetic.Eye())
    assert seen.measured is not None
    depth = np.zeros_like(seen.measured.depth.depth)
    rows, columns = np.nonzero(seen.view.mask & (seen.measured.depth.depth > 0))
    few = np.random.default_rng(1).choice(len(rows), count, replace=False)
    depth[rows[few], columns[few]] = seen.measured.depth.depth[rows[few], columns[few]]
    runner = RuleRunner(tmp_path)
    found = runner.run("factorize.mesh", **object_views.sights(object_views.changed(seen, depth=depth)))
    assert found.mesh.is_closed
    assert abs(float(found.mesh.vertices[:, 2].min())) < 1e-4


def test_a_family_that_fails_is_left_out(tmp_path, monkeypatch):
    whole = mesh_primitives.propose

    def propose(view, allowed, *more):
        if "cylinder" in allowed:
            raise np.linalg.LinAlgError("singular")
        return whole(view, allowed, *more)

    monkeypatch.setattr(mesh_primitives, "propose", propose)
    seen = evidence.gather(object_views.seen(synthetic.view(BOX, synthetic.Eye())))
    context: Context[Any] = Context(scratch=tmp_path)
    options = mesh_primitives.PrimitivesOptions(hypotheses=("box", "cylinder"))
    assert [found.candidate.model.name for found in mesh_primitives._fits(context, seen, options)] == ["box"]
    assert context.outcome.warnings == ["cylinder was not tried: LinAlgError: singular"]
