"""Inputs that are run by code beside the rules that made them: found through the whole graph, and part of the key."""

from __future__ import annotations

from typing import Any

import pytest

from dextera_build.artifacts.base import Collection, File
from dextera_build.engine.graph import Call, Group
from dextera_build.engine.plan_json import read, write
from dextera_build.errors import RecipeError, RuleError
from dextera_build.recipe.plan import Plan, Request, plan
from dextera_build.recipe.runs import holds
from dextera_build.testing import RuleRunner
from tests.recipe.conftest import Space

SONG = '''
"""A song, and what a companion defines."""
from typing import Protocol
from dextera_build.artifacts.base import Artifact

class Song(Artifact):
    """A song."""
    singer: str
    """Who sings it."""

class Singer(Protocol):
    """What `sing.py` defines."""
    def sing(self, song: Song) -> bytes:
        """The sound of a song."""
        ...
'''
MAKE = '''
"""songs.{name}: a song."""
from dextera_build.rule import Context, rule
from ..song import Song

@rule(version=1)
def {name}(ctx: Context) -> Song:
    """Return a song."""
    return Song(singer="{name}")
'''
SING = '''
"""Sings."""
from . import notes

def sing(song):
    return song.singer.encode() + notes.LAST
'''
PICK = '''
"""songs.pick: one of several songs."""
from dextera_build.artifacts.base import Collection
from dextera_build.rule import Context, rule
from .song import Song

@rule(version=1)
def pick(ctx: Context, songs: Collection[Song]) -> Song:
    """Return the first."""
    return next(iter(songs.items.values()))
'''
PERFORM = '''
"""songs.perform: what a song sounds like."""
from dextera_build.artifacts.base import Collection, File
from dextera_build.rule import Context, Options, rule
from .song import Singer, Song

class PerformOptions(Options):
    """Options."""
    name: str = ""
    """Who sings; empty: as the song says."""

@rule(version=1, runs={"song": "sing"})
def perform(
    ctx: Context, song: Song, others: Collection[Song] | None = None, *, options: PerformOptions
) -> File:
    """Return the sound."""
    singer: Singer = ctx.companion("song", options.name or song.singer, Singer)
    return File(data=singer.sing(song))
'''
NODES = {
    "plain": """
  high: {rule: songs.high}
  low: {rule: songs.low}
  one: {rule: songs.perform, song: $high}
  other: {rule: songs.perform, song: $low}""",
    "through": """
  high: {rule: songs.high}
  low: {rule: songs.low}
  text: {rule: toy.start, text: a b}
  words: {rule: toy.split, text: $text}
  each:
    each: $words
    as: word
    overrides: {b: {picked: {songs: {x: $low}}}}
    nodes:
      own: {rule: songs.pick, songs: {x: $high}}
      picked: {rule: songs.pick, songs: {x: $own}}
      sung: {rule: songs.perform, song: $picked}
  all: {rule: songs.pick, songs: $each.picked}
  sung: {rule: songs.perform, song: $all, others: {x: $low}}""",
    "copy": """
  high: {rule: songs.high}
  low: {rule: songs.low}
  songs: {rule: songs.several, first: $high}
  each:
    each: $songs
    as: song
    overrides: {b: {picked: {songs: {x: $low}}, sung: {name: low}}}
    nodes:
      picked: {rule: songs.pick, songs: {x: $song}}
      sung: {rule: songs.perform, song: $picked}""",
}
SEVERAL = '''
"""songs.several: a song by two names."""
from dextera_build.artifacts.base import Collection
from dextera_build.rule import Context, rule
from .song import Song

@rule(version=1)
def several(ctx: Context, first: Song) -> Collection[Song]:
    """Return it twice."""
    return Collection[Song](items={"a": first, "b": first})
'''


@pytest.fixture
def songs(space: Space) -> Space:
    space.write("rules/songs/song.py", SONG.lstrip())
    for name, text in {"pick": PICK, "perform": PERFORM, "several": SEVERAL}.items():
        space.write(f"rules/songs/{name}.py", text.lstrip())
    for name in ("high", "low"):
        space.write(f"rules/songs/{name}/{name}.py", MAKE.format(name=name).lstrip())
        space.write(f"rules/songs/{name}/sing.py", SING.lstrip())
        space.write(f"rules/songs/{name}/notes.py", 'LAST = b"!"\n')
    for name, nodes in NODES.items():
        space.write(f"recipes/sung/{name}.yaml", f"summary: Songs.\nnodes:{nodes}\n")
    return space


def planned(space: Space, address: str = "sung/plain") -> Plan:
    project = space.project()
    return plan(address, project.recipe, project.library, project.root, Request())


def calls(space: Space, address: str = "sung/plain") -> dict[str, Call]:
    return {".".join(path): call for path, call in planned(space, address).graph.calls()}


def makers(call: Call) -> list[str]:
    assert call.rule.companions.keys() <= {"song"}
    return [path.removesuffix("/sing") for path in call.rule.companions.get("song", ())]


def test_the_code_beside_the_rule_that_made_an_input_is_part_of_the_key(songs: Space) -> None:
    found = calls(songs)
    assert found["one"].rule.companions == {"song": ["songs.high/sing"]}
    assert {"rules/songs/high/sing.py", "rules/songs/high/notes.py"} <= found["one"].rule.code.keys()
    assert found["one"].rule.code.keys() <= found["one"].rule.sources.keys()
    assert not [name for name in found["one"].rule.code if name.startswith("rules/songs/low")]
    assert "rules/songs/high/sing.py" not in found["high"].rule.code


@pytest.mark.parametrize(
    ("change", "stale"),
    [
        (("rules/songs/high/sing.py", "song.singer.encode()", "song.singer.upper().encode()"), {"one"}),
        (("rules/songs/low/notes.py", "!", "?"), {"other"}),
        (("rules/songs/high/high.py", "version=1", "version=2"), {"high"}),
    ],
)
def test_only_what_runs_an_input_has_another_key(songs: Space, change: tuple[str, str, str], stale: set[str]) -> None:
    before = calls(songs)
    songs.edit(*change)
    after = calls(songs)
    assert {name for name in before if before[name].rule != after[name].rule} == stale


def test_an_input_is_followed_through_rules_that_pass_it_on(songs: Space) -> None:
    plan = planned(songs, "sung/through")
    found = {".".join(path): call for path, call in plan.graph.calls()}
    both = ["songs.high", "songs.low"]
    assert makers(found["sung"]) == both
    # Of copies that share one call, each may have been given what one of them was.
    assert makers(found["each.sung"]) == both
    assert {rule.path for rule in plan.rules if rule.companions} == {"songs.perform"}


def test_a_copy_of_its_own_is_followed_through_itself(songs: Space) -> None:
    group = planned(songs, "sung/copy").graph.members["each"]
    assert isinstance(group, Group)
    assert makers(group.overrides["b"]["sung"]) == ["songs.low"]
    generic = group.members["sung"]
    assert isinstance(generic, Call)
    assert makers(generic) == ["songs.high", "songs.low"]


def test_a_kept_plan_has_them(songs: Space) -> None:
    made = planned(songs, "sung/through")
    assert read(write(made)) == made


def test_every_place_of_a_companion_is_looked_at(songs: Space) -> None:
    project = songs.project()
    plan("sung/through", project.recipe, project.library, project.root, Request())
    looked = project.library.looked_at()
    assert {str(songs.root / f"rules/songs/{place}sing.py") for place in ("high/", "low/", "")} <= looked


def test_a_rule_without_a_companion_is_refused(songs: Space) -> None:
    (songs.root / "rules/songs/low/sing.py").unlink()
    with pytest.raises(RecipeError, match=r"`songs\.perform` runs the result of `songs\.low`, which has no") as caught:
        planned(songs)
    assert caught.value.code == "DXB-R216"
    assert "plain.yaml" in str(caught.value.where)
    assert caught.value.facts["looked for"] == str(songs.root / "rules/songs/low/sing.py")


def test_two_folders_of_one_name_are_refused(songs: Space) -> None:
    songs.write("rules/hymns/low/calm.py", MAKE.format(name="calm").lstrip())
    songs.write("rules/hymns/low/sing.py", SING.lstrip())
    songs.write("rules/hymns/low/notes.py", 'LAST = b"."\n')
    songs.write("rules/hymns/song.py", SONG.lstrip())
    songs.write(
        "recipes/sung/two.yaml",
        "nodes:\n  a: {rule: songs.low}\n  b: {rule: hymns.calm}\n"
        "  c: {rule: songs.pick, songs: {a: $a, b: $b}}\n  d: {rule: songs.perform, song: $c}\n",
    )
    with pytest.raises(RecipeError, match="two folders called `low` hold companions of the inputs") as caught:
        planned(songs, "sung/two")
    assert caught.value.code == "DXB-R215"


@pytest.mark.slow
def test_a_build_runs_it(songs: Space) -> None:
    assert songs.build("sung/plain").nodes("ran") == {"high", "low", "one", "other"}
    assert songs.dxb("get", "sung/plain:one", "-o", "one.txt").code == 0
    assert (songs.root / "one.txt").read_bytes() == b"high!"
    songs.edit("rules/songs/high/sing.py", "song.singer.encode()", "song.singer.upper().encode()")
    why = songs.dxb("why", "sung/plain:one").out
    assert "`sing` of rules/songs/high/sing.py" in why
    again = songs.build("sung/plain")
    assert (again.nodes("ran"), again.nodes("cached")) == ({"one"}, {"high", "low", "other"})
    assert songs.dxb("check", "sung/plain:one").code == 0


def run(space: Space, made_by: str | None, **options: Any) -> Any:
    runner = RuleRunner(space.root / "scratch", space.root, made_by={"song": made_by} if made_by else None)
    return runner.run("songs.perform", options=options, song=runner.run("songs.high"))


def test_a_name_that_no_maker_has_is_one_clear_error(songs: Space) -> None:
    assert run(songs, "songs.high").data == b"high!"
    with pytest.raises(RuleError, match="no rule that made the input `song` has a companion `hihg`") as wrong:
        run(songs, "songs.high", name="hihg")
    assert (wrong.value.code, wrong.value.facts) == ("DXB-B385", {"high": "`sing.py` of songs.high"})
    assert "high" in str(wrong.value.hint)
    with pytest.raises(RuleError, match="no rule that made the input `song` has a companion"):
        run(songs, None)


def test_a_rule_may_be_its_own_companion(songs: Space) -> None:
    songs.edit("rules/songs/perform.py", 'runs={"song": "sing"}', 'runs={"song": ""}')
    own = SING.replace('"""Sings."""', "")
    for name in ("high", "low"):
        songs.write(f"rules/songs/{name}/{name}.py", MAKE.format(name=name).lstrip() + own)
    before = calls(songs)
    assert before["one"].rule.companions == {"song": ["songs.high/high"]}
    assert run(songs, "songs.high").data == b"high!"
    with pytest.raises(RuleError, match="no rule that made the input `song` has a companion") as wrong:
        run(songs, "songs.high", name="low")
    assert wrong.value.hint == "the rule must name its result after its folder or file: high"
    songs.edit("rules/songs/high/high.py", "song.singer.encode()", "song.singer.upper().encode()")
    after = calls(songs)
    assert {name for name in before if before[name].rule.code != after[name].rule.code} == {"high", "one"}


def test_a_companion_without_its_function_is_one_clear_error(songs: Space) -> None:
    songs.edit("rules/songs/high/sing.py", "def sing", "def hum")
    with pytest.raises(RuleError, match=r"`sing\.py` of songs\.high has no function `sing`") as caught:
        run(songs, "songs.high")
    assert caught.value.facts["its functions"] == "hum"


def test_a_slot_that_the_rule_does_not_take_is_refused(songs: Space) -> None:
    songs.edit("rules/songs/perform.py", 'runs={"song"', 'runs={"tune"')
    with pytest.raises(RecipeError, match=r"`runs` names \['tune'\], which `perform` does not take"):
        planned(songs)


def test_types_that_hold_another() -> None:
    from dextera_build.artifacts.cameras.camera import Camera, Capture
    from dextera_build.artifacts.tasks.policy import Checkpoint

    assert holds(Checkpoint, Checkpoint)
    assert holds(Collection[Collection[Checkpoint]], Checkpoint)
    assert holds(File | Checkpoint, Checkpoint)
    assert holds(Capture, Camera)
    assert not holds(Camera, Capture)
    assert not holds(Collection[File], Checkpoint)
