"""What a search among families of bodies may leave out."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.geometry import raycast
from rules.factorize.shapes import evidence, fitted, hypotheses, scoring
from tests import object_views
from tests.rules.factorize import synthetic_views as synthetic
from tests.rules.factorize.shapes.test_mesh import box, shape_of


@pytest.mark.medium
def test_a_family_too_complex_to_be_among_the_two_best_is_not_tried(tmp_path):
    seen = synthetic.view(box(0.1, 0.07, 0.05), synthetic.fine())
    names = ("box", "tilted_box", "mirrored")
    found = shape_of(seen, tmp_path, hypotheses=names, explained=1.0)
    assert set(found.scores) == {"box", "tilted_box"}
    assert min(found.scores.values()) > scoring.BEST - hypotheses.COSTS["mirrored"]
    alone = shape_of(seen, tmp_path, hypotheses=names[1:], explained=1.0)
    assert set(alone.scores) == {"tilted_box", "mirrored"}
    assert alone.scores["mirrored"] < scoring.BEST - hypotheses.COSTS["mirrored"]


@pytest.mark.parametrize("body", [box(0.1, 0.07, 0.05), synthetic.cup(0.04, 0.04, 0.095, 0.004, 0.006)])
def test_rays_across_the_outline_meet_what_single_rays_meet(body):
    seen = evidence.gather(object_views.seen(synthetic.view(body, synthetic.Eye()))).silhouette
    for moved in (0.0, 0.004, 0.03):
        away = synthetic.placed(body, moved, 0.0, 0.1)
        scene = raycast.RayScene((away.vertices, away.faces))
        every = np.isfinite(scene.cast(seen.rays).distance)
        assert 0.2 < every.mean() < 0.8
        assert (seen.met(scene) == every).mean() > 0.999


@pytest.mark.medium
def test_families_are_compared_with_the_handle_that_they_may_have():
    """Without it, a mirrored front, which copies any outline, explained mugs better than a vessel did."""
    seen = synthetic.view(synthetic.placed(object_views.mug(), 0.0, 0.0, 20), synthetic.Eye())
    found = evidence.gather(object_views.seen(seen))
    (vessel,) = hypotheses.propose(found, ("revolved_hollow",), 0.003)
    fit = fitted.fitted_of(vessel, found, 6)
    bare = scoring.judge(vessel.model.build(fit.parameters), found, vessel.model.cost)
    assert fit.score > bare.score + 0.03
    (front,) = hypotheses.propose(found, ("mirrored",), 0.003)
    assert fit.score > fitted.fitted_of(front, found, 6).score
