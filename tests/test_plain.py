"""Cheap data classes do what those of the standard library do, but for a refusal at run time."""

from __future__ import annotations

import copy
import dataclasses
import pickle
from typing import Any, ClassVar

import pytest

from dextera_build import plain


def pair(make: Any, **how: bool) -> tuple[type[Any], type[Any]]:
    """A class and one that goes on from it."""

    @make(**how)
    class Base:
        kind: ClassVar[str] = "base"
        time: float
        names: list[str] = dataclasses.field(default_factory=list, compare=False)

    @make(**how)
    class More(Base):
        place: tuple[int, ...] = (1, 2)
        secret: str = dataclasses.field(default="x", repr=False)

    return Base, More


@pytest.mark.parametrize("how", [{"frozen": True}, {}, {"eq": False}, {"frozen": True, "slots": True}])
def test_they_are_equal_hashed_and_shown_as_those_of_the_library(how: dict[str, bool]) -> None:
    for ours, known in zip(pair(plain.dataclass, **how), pair(dataclasses.dataclass, **how), strict=True):
        for values in ({"time": 1.0}, {"time": 2.0, "names": ["a"]}):
            one, other = ours(**values), known(**values)
            assert repr(one) == repr(other)
            assert dataclasses.asdict(one) == dataclasses.asdict(other)
            assert dataclasses.replace(one, time=3.0).time == 3.0
            assert (one == ours(**values)) == (other == known(**values))
            assert (one == ours(time=1.0)) == (other == known(time=1.0))
            assert one != other
            assert copy.copy(one).time == one.time
            if how.get("frozen"):
                assert hash(one) == hash(ours(**values))
            elif how.get("eq", True):
                with pytest.raises(TypeError, match="unhashable"):
                    hash(one)
        with pytest.raises(TypeError):
            ours()


@plain.dataclass(frozen=True)
class Sent:
    """One that travels."""

    name: str
    size: int = 0

    def __repr__(self) -> str:
        return self.name


def test_what_a_class_says_of_itself_stands() -> None:
    assert repr(Sent("a")) == "a"
    assert pickle.loads(pickle.dumps(Sent("a", 2))) == Sent("a", 2)


def test_one_without_fields_is_equal_to_its_like() -> None:
    @plain.dataclass(frozen=True)
    class Nothing:
        """No fields."""

    assert Nothing() == Nothing()
    assert len({Nothing(), Nothing()}) == 1


@plain.dataclass(slots=True)
class Counted:
    """One with all that a field can be."""

    first: int
    many: list[int] = dataclasses.field(default_factory=list)
    late: str = dataclasses.field(default="", init=False)
    last: int = 3

    def __post_init__(self) -> None:
        self.late = f"{self.first} {self.last}"


def test_objects_begin_as_those_of_the_library() -> None:
    one, other = Counted(1), Counted(2, [4], 5)
    assert (one.first, one.many, one.late, one.last) == (1, [], "1 3", 3)
    assert (other.first, other.many, other.late, other.last) == (2, [4], "2 5", 5)
    assert one.many is not Counted(1).many
    with pytest.raises(TypeError, match=r"Counted.__init__\(\) got an unexpected keyword argument 'late'"):
        Counted(1, late="x")
    with pytest.raises(TypeError, match=r"Counted.__init__\(\) missing 1 required positional argument: 'first'"):
        Counted()
