"""Upper limits of options that declare none."""

from __future__ import annotations

import pytest
from pydantic import Field, PositiveFloat, PositiveInt

from dextera_build.errors import RecipeError
from dextera_build.recipe import limits
from dextera_build.recipe.plan import Request, plan
from dextera_build.recipe.settings import parse
from dextera_build.rule import Options


class Inner(Options):
    """A group."""

    wall_m: PositiveFloat = 0.003
    damping_nms_rad: PositiveFloat = 200.0


class Made(Options):
    """One option of each kind."""

    wall_m: PositiveFloat = 0.003
    size_m: PositiveFloat | None = None
    bounded_m: float = Field(0.1, gt=0, le=5000.0)
    at_m: tuple[float, float] = (0.0, 0.0)
    upper_rad: float = 1.0
    rounds: PositiveInt = 3
    weight: float = 0.5
    flag: bool = True
    joints_deg: dict[str, float] = Field(default_factory=dict)
    inner: Inner = Inner()
    many: dict[str, Inner] = Field(default_factory=dict)


@pytest.mark.parametrize(
    ("given", "path"),
    [
        ({"wall_m": 3.0}, ("wall_m",)),  # millimetres
        ({"wall_m": 0.3}, None),
        ({"size_m": 93.0}, None),
        ({"size_m": 930.0}, ("size_m",)),
        ({"bounded_m": 4000.0}, None),
        ({"at_m": (0.0, -250.0)}, ("at_m", 1)),
        ({"upper_rad": 90.0}, ("upper_rad",)),  # degrees
        ({"rounds": 10**8}, ("rounds",)),
        ({"weight": 501.0}, ("weight",)),
        ({"joints_deg": {"elbow": -721.0}}, ("joints_deg", "elbow")),
        ({"inner": Inner(wall_m=3.0)}, ("inner", "wall_m")),
        ({"many": {"a": Inner(damping_nms_rad=2000.0)}}, None),  # not an angle
        ({"many": {"a": Inner(wall_m=3.0)}}, ("many", "a", "wall_m")),
    ],
)
def test_what_is_given_is_compared_with_the_unit_and_the_default(given, path):
    found = limits.exceeded(Made(**given))
    assert (found[0] if found else None) == path


def test_a_length_in_millimetres_is_refused_with_the_limit_and_its_unit(space):
    space.write("recipes/say/a.yaml", "nodes:\n  photo: {rule: capture.imgviz}\n")
    project, request = space.project(), Request(settings=(parse("photo.farthest_m=3000"),))
    with pytest.raises(RecipeError) as caught:
        plan("say/a", project.recipe, project.library, project.root, request)
    assert caught.value.message == "`farthest_m` of `capture.imgviz` must be at most 100 m"
    assert str(caught.value.where) == "the command line: --set photo.farthest_m=3000"
