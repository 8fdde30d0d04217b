"""Calls: the type of a result that an option names."""

from __future__ import annotations

from dextera_build.engine.graph import Output
from dextera_build.recipe import settings
from tests.recipe.test_plan import planned, refused

OPENED = '''
"""toy.opened: a type that an option names."""
from typing import Literal
from dextera_build.artifacts.base import Collection, File
from dextera_build.artifacts.cameras.image import Image
from dextera_build.rule import Context, Options, rule

class OpenedOptions(Options):
    """Options of toy.opened."""
    type: Literal["File", "Image"]
    """Type of the result."""

@rule(version=1, typed_by="type")
def opened(ctx: Context, *, options: OpenedOptions) -> File | Image:
    """Return a file, whatever was asked for."""
    return File(data=b"one")
'''


def test_an_option_may_name_the_type_of_the_result(space):
    space.write("rules/toy/opened.py", OPENED)
    text = "nodes: {{o: {{rule: toy.opened, type: {}}}, s: {{rule: toy.shout, text: $o}}}}\n"
    space.write("recipes/say/a.yaml", text.format("File"))
    assert dict(planned(space, "say/a").calls())["s",].inputs["text"] == Output(("o",))
    assert refused(space, text.format("Image")).message == "`text` takes File, but `$o` is Image"
    error = refused(space, text.format("File"), settings=(settings.parse("o.type=Image"),))
    assert error.message == "`text` takes File, but `$o` is Image"
    space.write("recipes/say/a.yaml", "nodes: {o: {rule: toy.opened, type: Image}}\n")
    built = space.dxb("build", "say/a:o")
    assert "toy.opened returned File, but Image is declared" in built.err
