"""Names in `dxb.lock`: a proposer that renames breaks no task, a new photograph is noticed, and what is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from dextera_build.api import Project
from dextera_build.building import bind
from dextera_build.errors import RuleError, UsageError
from dextera_build.recipe.bindings import Binding
from dextera_build.session import warnings
from tests.e2e.space import Space

pytestmark = pytest.mark.usefixtures("array_workers")

NAMED = "twin/desk:named"
RULES = {
    "photo": '''
"""toy.photo: a photograph of two boxes."""
import numpy as np
from dextera_build.artifacts.cameras.camera import Camera, Photograph
from dextera_build.artifacts.cameras.image import Image
from dextera_build.rule import Context, Options, rule

class PhotoOptions(Options):
    """Options."""
    shade: int = 90
    """Grey of the table."""

@rule(version=1)
def photo(ctx: Context, *, options: PhotoOptions) -> Photograph:
    """Take it."""
    pixels = np.full((48, 64, 3), options.shade, np.uint8)
    pixels[10:30, 5:25], pixels[10:30, 35:55] = (30, 40, 170), (180, 20, 20)
    camera = Camera(width=64, height=48, fx=60.0, fy=60.0, cx=31.5, cy=23.5)
    return Photograph(rgb=Image(pixels=pixels), camera=camera)
''',
    "find": '''
"""toy.find: the two boxes, as a proposer calls them, left to right or right to left."""
import numpy as np
from dextera_build.artifacts.cameras.camera import Photograph
from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.objects.view import Instance, InstanceMap, ObjectView, Segmentation, Traits
from dextera_build.rule import Context, Options, rule

class FindOptions(Options):
    """Options."""
    left: str = "mug"
    """Name of the left one."""
    right: str = "bowl"
    """Name of the right one."""
    turned: bool = False
    """Whether the right one comes first."""

@rule(version=1)
def find(ctx: Context, photograph: Photograph, *, options: FindOptions) -> Segmentation:
    """Find them."""
    labels, items = np.zeros((48, 64), np.int32), {}
    places = [(options.left, 5), (options.right, 35)]
    for number, (name, left) in enumerate(places[::-1] if options.turned else places, start=1):
        crop = np.s_[10:30, left : left + 20]
        labels[crop] = number
        view = ObjectView(
            rgb=Image(pixels=photograph.rgb.pixels[crop].copy()),
            mask=np.ones((20, 20), bool),
            occluder=np.zeros((20, 20), bool),
            camera=photograph.camera.crop(left, 10, 20, 20),
            phrase=name,
        )
        items[name] = Instance(view=view, traits=Traits(category="thing", body_type="rigid", material="ceramic"))
    return Segmentation(items=items, names=tuple(items), map=InstanceMap(labels=labels, fixed=labels < 0))
''',
    "crop": '''
"""toy.crop: the picture of one object."""
from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.objects.view import ObjectView
from dextera_build.rule import Context, rule

@rule(version=1)
def crop(ctx: Context, view: ObjectView) -> Image:
    """Return it."""
    return view.rgb
''',
    "grasp": '''
"""toy.grasp: a task on one object, by its name."""
from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.cameras.image import Image
from dextera_build.rule import Context, Options, rule

class GraspOptions(Options):
    """Options."""
    object: str = "cup"
    """Its name."""

@rule(version=1)
def grasp(ctx: Context, crops: Collection[Image], *, options: GraspOptions) -> Image:
    """Return the picture of the object."""
    ctx.check(options.object in crops.items, f"no `{options.object}`")
    return crops.items[options.object]
''',
}
TWIN = """nodes:
  photo: {rule: toy.photo, shade: 90}
  objects: {rule: toy.find, photograph: $photo, left: mug, right: bowl, turned: false}
  named: {rule: factorize.name, photograph: $photo, objects: $objects, names: {}}
  body: {each: $named, as: object, nodes: {crop: {rule: toy.crop, view: $object.view}}}
targets: {default: [body.crop]}
"""
TASK = """inputs: {crops: "twin/desk:body.crop"}
nodes: {task: {rule: toy.grasp, crops: $crops, object: cup}}
targets: {default: [task]}
"""


@pytest.fixture
def project(tmp_path: Path) -> Project:
    for name, text in RULES.items():
        write(tmp_path / "rules" / "toy" / f"{name}.py", text.lstrip())
    write(tmp_path / "recipes" / "twin" / "desk.yaml", TWIN)
    write(tmp_path / "recipes" / "task" / "lift.yaml", TASK)
    write(tmp_path / "dxb.toml", 'cache = "cache"\n')
    warnings.clear()
    return Project.find(tmp_path)


def write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def edit(project: Project, old: str, new: str) -> None:
    path = project.root / "recipes" / "twin" / "desk.yaml"
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))


def rename(project: Project) -> None:
    """What another proposer does: other names in another order, and the old name of one for the other."""
    edit(project, "left: mug, right: bowl, turned: false", "left: beaker, right: mug, turned: true")


def names(table: bind.Table) -> dict[str, str]:
    return {row.object: row.name for row in table.rows}


LEFT = Binding((14, 20))


@pytest.mark.slow
@pytest.mark.parametrize("draft", [LEFT, Binding(properties={"phrase": "mug"})], ids=["point", "phrase"])
def test_a_proposer_that_renames_breaks_no_task(project, draft):
    assert names(bind.Naming(project, "task/lift").bind("cup", draft)) == {"mug": "cup", "bowl": "bowl"}
    first = project.build("task/lift")
    assert first.ok, first.errors
    rename(project)
    again = project.build("task/lift")
    assert again.ok, again.errors
    assert again.nodes["twin/desk:objects"].status == "ran"
    assert again.nodes["twin/desk:body[cup].crop"].status == "cached"
    assert again.nodes["task"].output == first.nodes["task"].output


@pytest.mark.medium
def test_a_phrase_of_the_recipe_becomes_a_point(project):
    edit(project, "names: {}", "names: {cup: {phrase: mug}}")
    table = bind.Naming(project, "twin/desk").bind()
    assert [(row.name, row.bound) for row in table.rows] == [("cup", "dxb.lock"), ("bowl", "")]
    rename(project)
    assert names(bind.Naming(project, "twin/desk").bind()) == {"beaker": "cup", "mug": "mug"}
    # Another phrase in the recipe goes before the point that belonged to the former one.
    edit(project, "phrase: mug", "phrase: mug, colour: red")
    project.plan("twin/desk")
    assert "dxb.lock binds `cup` in another way than the recipe; `dxb bind twin/desk:named` renews it" in warnings
    assert names(bind.Naming(project, "twin/desk").bind()) == {"beaker": "beaker", "mug": "cup"}


@pytest.mark.slow
def test_on_a_new_photograph_a_phrase_decides_and_a_point_is_refused(project):
    naming = bind.Naming(project, "twin/desk")
    naming.bind("cup", Binding(properties={"phrase": "mug"}))
    edit(project, "shade: 90", "shade: 100")
    rename(project)
    built = project.build("twin/desk")
    assert "not the photograph of `dxb.lock`, so by property: cup; `dxb bind` renews" in built.nodes["named"].line
    fresh = bind.Naming(project, "twin/desk")
    assert names(fresh.bind()) == {"mug": "cup", "beaker": "beaker"}
    fresh.bind("pot", LEFT)
    edit(project, "shade: 100", "shade: 110")
    built = project.build("twin/desk")
    assert (built.errors["named"].code, "pot" in built.errors["named"].message) == ("DXB-B384", True)
    table = bind.Naming(project, "twin/desk").bind()
    assert (names(table), table.stale) == ({"mug": "cup", "beaker": "beaker"}, ("pot",))
    bind.Naming(project, "twin/desk").bind("pot", LEFT)
    assert project.build("twin/desk").ok


def test_a_point_of_another_view_is_refused(project):
    with pytest.raises(UsageError, match="another photograph than the view") as caught:
        bind.Naming(project, "twin/desk").bind("cup", LEFT, on="0" * 64)
    assert caught.value.code == "DXB-U210"


@pytest.mark.medium
@pytest.mark.parametrize(
    ("name", "draft", "message"),
    [
        ("cup", Binding((1, 1)), "no object is at the point"),
        ("cup", Binding(properties={"phrase": "thing"}), "2 objects fit the name `cup`"),
        ("Cup", LEFT, "`Cup` is not a name"),
        ("cup", None, "`cup` has no point and no property"),
        ("plate", LEFT, "the recipe binds `plate` in another way"),
        ("dish", Binding(properties={"phrase": "mug"}), "the recipe binds `dish` in another way"),
        ("pot", LEFT, "`cup` and `pot` are bound to the same object|`plate` and `pot` are bound"),
    ],
)
def test_what_is_refused_is_not_written(project, name, draft, message):
    if name == "plate":
        edit(project, "names: {}", "names: {plate: {at_px: [40, 20]}}")
    if name == "dish":
        edit(project, "names: {}", "names: {dish: {phrase: bowl}}")
    naming = bind.Naming(project, "twin/desk")
    if name == "pot":
        naming.bind("cup", LEFT)
    before = naming.names()
    with pytest.raises((RuleError, UsageError), match=message):
        naming.bind(name, draft)
    assert naming.names() == before


@pytest.mark.medium
def test_a_name_is_removed_also_when_its_recipe_is_gone(project):
    naming = bind.Naming(project, "twin/desk")
    naming.bind("cup", LEFT)
    with pytest.raises(UsageError, match="does not bind `cap` in `twin/desk`") as caught:
        bind.remove(project, "twin/desk", "cap")
    assert (caught.value.code, caught.value.hint) == ("DXB-U211", "did you mean `cup`?")
    edit(
        project,
        "rule: factorize.name, photograph: $photo, objects: $objects, names: {}",
        "rule: toy.find, photograph: $photo",
    )
    project.plan("twin/desk")
    assert f"dxb.lock binds `cup`, but `{NAMED}` gives no names; `dxb bind {NAMED} --remove cup`" in warnings
    bind.remove(project, NAMED, "cup")
    assert naming.names() == {}


@pytest.mark.medium
def test_the_command_prints_every_object_and_says_what_is_wrong(project):
    space = Space(project.root)
    answer = space.dxb("bind", "task/lift", "cup", "--at", "14,20")
    assert (answer.code, answer.out) == (0, "cup\tmug\t14,20\tdxb.lock\nbowl\tbowl\t44,19\t-\n")
    edit(project, "shade: 90", "shade: 100")
    answer = space.dxb("bind", "twin/desk", "--json")
    assert answer.document["stale"] == ["cup"]
    assert f"warning: `cup` is bound by a point on another photograph; `dxb bind {NAMED} cup --at" in answer.err
    assert "DXB-U212" in space.dxb("bind", "twin/desk", "--at", "14,20").err
    answer = space.dxb("bind", "twin/desk", "cup", "--at", "14;20")
    assert (answer.code, "`14;20` is not a point" in answer.err) == (2, True)
    assert space.dxb("bind", "twin/desk", "--remove", "cup", "--json").document["removed"] == "cup"
    assert bind.Naming(project, "twin/desk").names() == {}


def test_the_node_is_found_or_asked_for(project):
    assert bind.Naming(project, "task/lift").address == NAMED
    with pytest.raises(UsageError, match="`twin/desk:objects` gives names to objects in no node") as caught:
        bind.Naming(project, "twin/desk:objects")
    assert caught.value.hint == "`dxb bind twin/desk:named`"
    write(
        project.root / "recipes" / "twin" / "tables.yaml",
        "nodes:\n  table:\n    matrix: {shade: [90, 91]}\n    nodes:\n"
        "      photo: {rule: toy.photo, shade: $matrix.shade}\n      objects: {rule: toy.find, photograph: $photo}\n"
        "      named: {rule: factorize.name, photograph: $photo, objects: $objects}\n",
    )
    with pytest.raises(UsageError, match=r"`table\.named` is in a group") as caught:
        bind.Naming(project, "twin/tables")
    assert caught.value.code == "DXB-U207"
