"""Digests of sources: the same on every version of Python."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from dextera_build.code import syntax
from dextera_build.code.modules import PACKAGE

SOURCES = [
    "x = f'a{b}c' 'd' f'{e!r:>{w}}{{}}'",
    "x = f'{b=}' f'{b = }'",
    "x = f'{a:}' f'' ''",
    "x = f'{a:{{}}}' rf'\\d{a}' f'\\N{BULLET}{a:%Y-%m}'",
    'x = f"""{\na\n:>{w}.{p}}\n"""',
    "x = u'a' b'b' if 0 else u'\\ud800\u00e9'".replace(" b'b'", ""),
    "def f(a, /, b: int = 1, *c, d, e=2, **g) -> None: ...",
    "async def f():\n    async with a as b, c: pass\n    return [x async for x in y]",
    "class A(B, metaclass=C):\n    'text'\n    x: int = 1\n    def f(self): 'text'",
    "match a:\n    case {'b': [1, *_], **rest} | C(d=1.5e300, e=-2j): pass\n    case None: pass",
    "x = " + hex(7**9000),
    "x = 1e400, 1_000, 0x_f, ..., None, True, b'\\x00', 2.5j",
    "try: pass\nexcept* A as e: pass",
    "global a, b\nlambda *, a: (yield)\nx = {**a, 'b': 1}\nprint(*a, **b)\ndel a[1:2, ::3]",
    "with (a as b, c as d): pass\nfor i in range(3): pass\nelse: pass\nwhile (x := 1): break",
    "x = '\u212b\u00e4', '\\u2028'\nassert a, 'b'\nraise A from B",
]
PROGRAM = """
import json, sys
from dextera_build.code import syntax
sources = [source.encode() for source in json.load(sys.stdin)]
sources += [open(file, "rb").read() for file in sys.argv[1:]]
said = [syntax.source(data, "x.py") for data in sources]
print(json.dumps([[each.definitions, each.lines, each.imports, each.exports] for each in said]))
"""


@pytest.mark.slow
@pytest.mark.parametrize("version", ["3.12", "3.13"])
def test_digests_are_the_same_on(version):
    python = another(version)
    files = sorted(map(str, [*(PACKAGE.parent / "rules").rglob("*.py"), *PACKAGE.rglob("*.py")]))
    done = [
        subprocess.run(
            [command, "-B", "-c", PROGRAM, *files],
            input=json.dumps(SOURCES),
            capture_output=True,
            text=True,
            check=True,
            env={**os.environ, "PYTHONPATH": str(PACKAGE.parent)},
        ).stdout
        for command in (sys.executable, python)
    ]
    here, there = map(json.loads, done)
    assert len(here) == len(SOURCES) + len(files)
    assert [place for place, said in enumerate(here) if said != there[place]] == []


def another(version: str) -> str:
    """A Python of this version, or a skip."""
    named = [os.environ.get(f"PYTHON_{version.replace('.', '_')}", ""), shutil.which(f"python{version}") or ""]
    managed = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
    for command in [*named, *(str(path) for path in sorted(managed.glob(f"{version}.*/bin/python")))]:
        if command and not subprocess.run([command, "-c", f"import sys; assert {version!r} in sys.version"]).returncode:
            return command
    pytest.skip(f"there is no Python {version} on this machine")


def test_different_sources_differ():
    said = {str(syntax.source(source.encode(), "x.py").definitions) for source in SOURCES}
    assert len(said) == len(SOURCES)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("x = 'ab'", "x = b'ab'"),
        ("x = 1", "x = True"),
        ("x = 1", "x = 1.0"),
        ("x = f'{a}b'", "x = f'a{b}'"),
        ("x = f'{a!r}'", "x = f'{a!s}'"),
        ("x = [a, b]", "x = (a, b)"),
        ("x = a.b", "x = a['b']"),
        ("x = 'a)', 'b'", "x = 'a', ')b'"),
        ("x = 0.0", "x = -0.0"),
        ("def f():\n    x = 1\n    return x", "def f():\n    x = 2\n    return x"),
        ("if a: b()\nelse: c()", "if a: b()\nc()"),
        ("for x in y: pass\nelse: z()", "for x in y: pass\nz()"),
        ("global a", "nonlocal a"),
    ],
)
def test_what_means_something_else_has_another_digest(one, other):
    assert syntax.source(one.encode(), "x.py").definitions != syntax.source(other.encode(), "x.py").definitions


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("x = f'a' f'{b}'", "x = f'a{b}'"),
        ("x = 'a' 'b'", "x = 'ab'"),
        ("x = u'a'", "x = 'a'"),
        ("def f():\n    'text'\n    pass", "def f():\n    pass"),
        ("x = 0x10  # sixteen", "x = 16"),
    ],
)
def test_what_means_the_same_has_the_same_digest(one, other):
    assert syntax.source(one.encode(), "x.py").definitions == syntax.source(other.encode(), "x.py").definitions
