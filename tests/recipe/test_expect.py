"""Bounds that a recipe states for its metrics."""

from __future__ import annotations

import pytest

from dextera_build.errors import RecipeError
from dextera_build.recipe import expect, strict_yaml
from dextera_build.recipe.plan import Request, plan

NODES = {
    "scores": {"Mask IoU": (0.93, ""), "F-score@1cm": (0.8, ""), "success, low": (60.0, "%")},
    "trials": {"success": (80.0, "%"), "success, low": (60.0, "%"), "success, high": (91.0, "%")},
    "settle": {"resting": (3.0, "of 4"), "drift": (0.5, "mm")},
    "body[mug].mesh": {"mask IoU": (0.97, "")},
    "body[box].mesh": {"mask IoU": (0.85, "")},
    "twin/scene": {"bodies": (4.0, "")},
    "later": None,
}


def judged(text: str) -> list[expect.Verdict]:
    return list(expect.judge(expect.read(strict_yaml.parse(text, "r.yaml")), NODES))


@pytest.mark.parametrize(
    ("text", "node", "metric", "ok"),
    [
        ("scores.Mask IoU: '>= 0.9'", "scores", "Mask IoU", True),
        ("scores.mask_iou: '> 0.93'", "scores", "Mask IoU", False),
        ("scores.f_score_1cm: '<= 0.8'", "scores", "F-score@1cm", True),
        ("settle.resting: '== all'", "settle", "resting", False),
        ("settle.resting: '==3'", "settle", "resting", True),
        ("settle.drift: '< 5e-1'", "settle", "drift", False),
        ("twin/scene.bodies: '== 4'", "twin/scene", "bodies", True),
        ("body[box].mesh.mask_iou: '>= 0.9'", "body[box].mesh", "mask IoU", False),
        ("later.anything: '>= 0.9'", "later", "anything", False),
    ],
)
def test_a_bound_is_compared(text, node, metric, ok):
    (found,) = judged(text)
    assert (found.node, found.metric, found.ok) == (node, metric, ok)
    assert (found.value is None) == (node == "later")


def test_a_bound_for_all_copies_is_one_for_each():
    for text in ("body[*].mesh.mask_iou: '>= 0.9'", "body.mesh.mask_iou: '>= 0.9'"):
        assert {found.node: found.ok for found in judged(text)} == {"body[mug].mesh": True, "body[box].mesh": False}


def test_an_interval_is_that_of_the_metrics_low_and_high():
    assert judged("trials.success: '>= 70'")[0].interval == (60.0, 91.0)
    assert judged("settle.drift: '>= 0'")[0].interval is None


@pytest.mark.parametrize(
    ("text", "code", "message", "hint"),
    [
        ("scores.mask_iou: 0.9", "R132", "the bound of `scores.mask_iou` is not of the form `OP VALUE`", None),
        ("scores.mask_iou: '=> 0.9'", "R132", "the bound of", None),
        ("scores.mask_iou: '>= all'", "R132", "the bound of", None),
        ("[a]", "R112", "`expect` is a mapping, this is list", None),
        ("score.mask_iou: '> 0'", "R133", "`score.mask_iou` names no metric of a node", "did you mean `scores`?"),
        ("scores: '> 0'", "R133", "`scores` names no metric of a node", "`NODE.METRIC: '>= 0.9'`; a copy is"),
        ("settle[mug].drift: '> 0'", "R133", "`settle[mug].drift` names no metric of a node", None),
        ("scores.mask_ui: '> 0'", "R133", "`scores` has no metric `mask_ui`", "did you mean `mask_iou`?"),
        ("body[mgu].mesh.mask_iou: '> 0'", "R133", "`body[mgu].mesh.mask_iou` names no copy", "did you mean `mug`?"),
        ("settle.drift: '== all'", "R134", "`all` is the total of a metric that counts, and `drift` does not", None),
    ],
)
def test_a_wrong_bound_is_refused_where_it_is_written(text, code, message, hint):
    with pytest.raises(RecipeError) as caught:
        judged(text)
    assert caught.value.code == f"DXB-{code}"
    assert caught.value.message.startswith(message)
    assert hint is None or str(caught.value.hint).startswith(hint)
    assert str(caught.value.where).startswith("r.yaml:1:")


def test_a_plan_refuses_a_bound_for_a_node_that_does_not_exist(space):
    text = "nodes: {a: {rule: toy.start}}\nexpect:\n  b.size: '> 0'\n"
    space.write("recipes/say/a.yaml", text)
    project = space.project()
    with pytest.raises(RecipeError, match="names no metric of a node") as caught:
        plan("say/a", project.recipe, project.library, project.root, Request())
    assert str(caught.value.where).endswith("say/a.yaml:3:3")
    space.write("recipes/say/a.yaml", text.replace("b.size", "a.size"))
    project = space.project()
    assert plan("say/a", project.recipe, project.library, project.root, Request()).graph
