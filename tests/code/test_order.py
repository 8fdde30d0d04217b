"""The order of statements: what may change places, and what may not."""

from __future__ import annotations

import pytest

from dextera_build.code import order, syntax

TEXT = "from __future__ import annotations\n"
USES = "from dataclasses import dataclass\nfrom typing import Protocol\nfrom dextera_build.rule import Options, rule\n"


def turned(first: str, second: str, around: str = TEXT, last: str = "") -> bool:
    """Whether two pieces of a module may not change places."""
    one, other = (f"{around}{head}\n{tail}\n{last}\n" for head, tail in ((first, second), (second, first)))
    digests = [syntax.source(text.encode(), "x.py").definitions for text in (one, other)]
    return digests[0] != digests[1]


@pytest.mark.parametrize(
    ("first", "second"),
    [
        pytest.param("T = {'k': 3}\nF = T['k']", "T.update(k=8)", id="a mutation"),
        pytest.param("random.seed(1)", "F = random.random()", id="a seed"),
        pytest.param("from ._q import F", "F = 3", id="an import over an assignment"),
        pytest.param("from ._q import f", "def f(): ...", id="an import over a function"),
        pytest.param("from ._q import *", "def f(): ...", id="all of a module"),
        pytest.param("C.size = 3", "F = C().size", id="a patch of a class"),
        pytest.param("@register\ndef a(): ...", "@register\ndef b(): ...", id="registered functions"),
        pytest.param("class A(Base): ...", "class B(Base): ...", id="registered classes"),
        pytest.param("def f(): return 1", "X = f()", id="a function over its use"),
        pytest.param("def open(): return 1", "X = open", id="a name that hides another"),
        pytest.param("LIMIT = 3", "def f(x=LIMIT): ...", id="a value and a default"),
        pytest.param("class C:\n    size = LIMIT", "LIMIT = 3", id="a value in a class"),
        pytest.param("def f(x=count()): ...", "def g(x=count()): ...", id="defaults that count"),
        pytest.param("LIMIT += 1", "OTHER = LIMIT", id="an augmented assignment"),
        pytest.param("try: X = f()\nexcept NameError: X = 3", "def f(): return 4", id="what may fail"),
        pytest.param("@dataclass\nclass C:\n    x: int = field()", "X = made()", id="fields"),
    ],
)
def test_statements_that_may_act_on_one_another_count_in_order(first: str, second: str) -> None:
    assert turned(first, second, TEXT + USES)
    assert turned(first, second, TEXT + USES, "def last(): ...")


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("def f(x: np.ndarray, y=1, *, z=None) -> int: return g(x)", "async def g(x): return LIMIT"),
        ("def f(): return LIMIT", "LIMIT = 2 * 1024"),
        ("SIZES: tuple[int, ...] = (1, -2)", "def f(): return SIZES"),
        ("class C:\n    'text'\n    def f(self): return g()", "def g(): ..."),
        ("@dataclass(frozen=True)\nclass C:\n    x: int = 1\n    @property\n    def y(self): ...", "def g(): ..."),
        ("class C(Protocol):\n    def f(self) -> int: ...", "class D(Options):\n    x: int = 1"),
        ("@rule(version=1)\ndef r(ctx: Context, *, options: Options) -> File: return g(ctx)", "def g(ctx): ..."),
        ("'text'", "def f(): ..."),
    ],
)
def test_statements_that_only_bind_a_name_may_change_places(first: str, second: str) -> None:
    assert not turned(first, second, TEXT + USES)
    assert not turned(first, second, TEXT + USES, "X = f()")


@pytest.mark.parametrize(
    "around", ["from mine import dataclass, Protocol, Options, rule\n", f"{USES}def other(rule, dataclass): ...\n"]
)
def test_decorators_and_bases_are_known_only_by_their_origin(around: str) -> None:
    assert turned("@rule(version=1)\ndef r(): ...", "def g(): ...", TEXT + around, "X = 1 / 3\ng()")
    assert turned("@dataclass\nclass C: ...", "def g(): ...", TEXT + around, "g()")


def test_annotations_are_read_unless_they_stay_text() -> None:
    assert turned("class int: ...", "def f(x: int): ...", "import a\n", "a.b()")
    assert not turned("class int: ...", "def f(x: int): ...", TEXT, "a.b()")
    assert turned("def f(x: ask()): ...", "def g(): ...", "import a\n", "a.b()")


def test_how_often_a_name_comes_before_another_counts() -> None:
    one, other = ("X=f()\nX=f()\nY=f()\nX=f()\n", "X=f()\nY=f()\nX=f()\nX=f()\n")
    assert syntax.source(one.encode(), "x").definitions != syntax.source(other.encode(), "x").definitions


def test_the_text_of_an_order_is_read_again() -> None:
    names = ["<module>", "<module>", "A", "b", "A"]
    assert order.spelled(names) == "<module>*2 A b A"
    assert order.names_in(order.spelled(names)) == names
    assert order.names_in("<module>*2 b,c,c D") == ["<module>", "<module>", "b", "c", "c", "D"]
