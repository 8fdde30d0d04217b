"""Names in a recipe: inputs that are not given."""

from __future__ import annotations

import pytest

from dextera_build.errors import RecipeError
from dextera_build.recipe.plan import Request, plan


@pytest.mark.parametrize(
    ("nodes", "code", "message"),
    [
        ("{a: {rule: toy.spilt, text: $x}}", "R201", "no rule is called `toy.spilt`"),
        ("{a: {rule: toy.split, txt: $x}}", "R105", "`toy.split` has no input or option `txt`"),
        ("{a: {rule: toy.shout, text: $x, times: y}}", "R109", "`times` of `toy.shout` must be a valid integer"),
        ("{a: {rule: toy.split, text: $y}}", "R104", "`$y` names nothing"),
        (
            "{a: {rule: toy.split, text: $x}, b: {rule: toy.shout, text: $a}}",
            "R107",
            "`text` takes File, but `$a` is Collection[File]",
        ),
        (
            "{a: {rule: toy.split, text: $x}, b: {rule: toy.join, texts: $x}}",
            "R107",
            "`texts` takes Collection[File], but `$x` is given to `text`, too, which takes File",
        ),
        ("{a: {rule: toy.split, text: $x.y}, b: {rule: toy.join, texts: $x.y}}", "R107", "`texts` takes"),
        ("{a: {recipe: say/used, texts: $x}, b: {rule: toy.split, text: $x}}", "R107", "`text` takes"),
        ("{a: {rule: toy.split, text: $x.y}, b: {rule: toy.join, texts: $x.z}}", "", ""),
        ("{a: {each: $x, nodes: {b: {rule: toy.shout, text: $item}}}, c: {rule: toy.join, texts: $x}}", "", ""),
    ],
)
def test_an_input_that_is_not_given_hides_no_error(space, nodes, code, message):
    space.write("recipes/say/used.yaml", "inputs: {texts: {}}\nnodes: {a: {rule: toy.join, texts: $texts}}")
    space.write("recipes/say/x.yaml", f"inputs: {{x: {{help: a file}}}}\nnodes: {nodes}\ntargets: {{default: x}}")
    project = space.project()
    request = Request(incomplete=True)
    if not code:
        assert plan("say/x", project.recipe, project.library, project.root, request).absent
        return
    with pytest.raises(RecipeError) as caught:
        plan("say/x", project.recipe, project.library, project.root, request)
    assert caught.value.code == f"DXB-{code}"
    assert caught.value.message.startswith(message)
    assert ".yaml:" in str(caught.value.where)
