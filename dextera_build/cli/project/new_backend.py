"""The files of `dxb new backend`: a backend that returns the result of another one, its program, and its test."""

from __future__ import annotations

import ast
import builtins
import inspect
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_type_hints

from dextera_build.code.loader import RuleFile

KINDS = ("in-process", "call", "command", "server")
_HEAD = '''"""Backend `{backend}` of {path}."""

from __future__ import annotations

{imports}

# Read without importing this file: literals only.
BACKEND = Backend({words})


class {kind}Options(Options):
    """Options of backend `{backend}`; in a recipe `{backend}: {{seed: 1}}`."""

    seed: int = 0
    """Seed of its random numbers."""
'''
_FUNCTION = '''

def {name}({parameters}) -> {returns}:
    """{doc}"""
{body}
'''
_UNWRITTEN = '    ctx.fail("`{name}` of backend `{backend}` is not written yet", hint="fill it in: {file}")'
_IN_PROCESS = """    # Write your own method here, and leave out `uses`.
    return ctx.other("{other}").{name}({arguments})"""
_CALL = """    # Add everything on which the answer depends; make the result from it, and leave out `uses`.
    _ask(ctx, {{"function": "{name}", "seed": options.seed}})
    return ctx.other("{other}").{name}({arguments})"""
_ASK = '''

def _ask(ctx: Context, request: dict[str, Any]) -> bytes:
    """The answer of the service, recorded under the whole request; bytes enter it by their digest."""
    return ctx.call("{backend}", request, lambda timeout_s: _send(request, timeout_s))


def _send(request: dict[str, Any], timeout_s: float) -> bytes:
    """The host is not part of the request; bytes need a form in JSON, such as base64."""
    asked = urllib.request.Request(os.environ["{variable}"], json.dumps(request).encode())
    with urllib.request.urlopen(asked, timeout=timeout_s) as answer:
        return bytes(answer.read())
'''
_OUTSIDE = """    # Send the values that the program needs, and return its result; at first it returns `example`.
    example = ctx.other("{other}").{name}({arguments})
    return ctx.outside("{name}", example=example{inputs})"""
_PROGRAM = '''"""The program of backend `{backend}` of {path}: runs in an environment of its own, without dxb."""

import dxb_backend

{functions}

dxb_backend.serve({served})
'''
_ANSWER = '''
def {name}(request):
    """Answer with `dxb_backend.value(type, file=...)`, plain values, dicts or lists."""
    print("inputs:", ", ".join(request.inputs), "on", request.device)
    return request.inputs["example"]
'''
_TEST = '''"""Backend `{backend}` of {path}."""

from __future__ import annotations

from pathlib import Path

from dextera_build.testing import RuleRunner

PROJECT = Path(__file__).parents[1]
{answer}

def test_{backend}_answers_and_passes_the_checks_of_the_rule(tmp_path: Path) -> None:
    runner = RuleRunner(tmp_path, PROJECT{calls})
    inputs, options = runner.example("{path}")
    assert runner.run("{path}", backend="{backend}", options=options, **inputs) is not None
'''
_ANSWER_OF_SERVICE = 'ANSWER = b"{}"  # an answer to this request, in place of the service\n'
_CALLS = ", calls=lambda service, request, send, **manner: ANSWER"


@dataclass(frozen=True)
class Wanted:
    """The files to write.

    Args:
        found: The rule.
        backend: Name of the backend.
        kind: One of `KINDS`.
        file: The file of the backend.
        shown: The same, as messages show it.
        beside: Whether it is in the rule's folder, so that it can import the definitions of the rule's file.
    """

    found: RuleFile
    backend: str
    kind: str
    file: Path
    shown: str
    beside: bool

    @property
    def program(self) -> Path:
        """The folder of its program."""
        return self.file.with_suffix("")

    @property
    def other(self) -> str | None:
        """The backend whose result it returns at first: the stub, else one without program and other backends.

        A new stub has none, because a stub needs no package of another backend.
        """
        if self.backend == "stub":
            return None
        known = [name for name, each in self.found.backends.items() if not each.missing() and name != self.backend]
        return min(known, key=lambda name: (name != "stub", self._needs(name), name), default=None)

    def _needs(self, backend: str) -> bool:
        facts = self.found.backends[backend].facts
        return bool(facts.uses or facts.command) or "cpu" not in facts.profiles

    @property
    def methods(self) -> list[Any]:
        """Functions of the rule's `Protocol`."""
        protocol = self.found.rule.protocol
        each = [method for method in vars(protocol).values() if inspect.isfunction(method)] if protocol else []
        return [method for method in each if not method.__name__.startswith("_")]


def note(wanted: Wanted) -> str:
    """Missing parts of the files, and the reason; empty if they lack nothing."""
    path, name = wanted.found.path, wanted.backend
    if not wanted.methods:
        return f"{path} takes no `ctx: Context[PROTOCOL]`, which lists the functions of a backend: no function, no test"
    if wanted.other is None:
        first = "" if name == "stub" else f"; with a backend `stub` (`dxb new backend {path}=stub`), others begin as it"
        return f"backend `{name}` has none to begin as: fill in its functions; no program, no test{first}"
    return ""


def files(wanted: Wanted, tests: Path) -> dict[Path, str]:
    """Path -> text of every file; the backend first.

    Args:
        wanted: The backend.
        tests: The folder of the project's tests.
    """
    made = {wanted.file: _backend(wanted)}
    if wanted.other is None or not wanted.methods:
        return made  # nothing to begin with: its functions fail until they are written
    if wanted.kind in ("command", "server"):
        names = [method.__name__ for method in wanted.methods]
        made[wanted.program / "program.py"] = _PROGRAM.format(
            backend=wanted.backend,
            path=wanted.found.path,
            functions="\n".join(_ANSWER.format(name=name) for name in names),
            served=", ".join(f"{name}={name}" for name in names),
        )
    answer, calls = (_ANSWER_OF_SERVICE, _CALLS) if wanted.kind == "call" else ("", "")
    test = _TEST.format(backend=wanted.backend, path=wanted.found.path, answer=answer, calls=calls)
    return made | {tests / f"test_{wanted.found.path.replace('.', '_')}_{wanted.backend}.py": test}


def _backend(wanted: Wanted) -> str:
    found, other = wanted.found, wanted.other
    kind = "".join(part.capitalize() for part in wanted.backend.split("_"))
    imports = _imports(ast.parse(found.file.read_text()), found.file.stem) if wanted.methods else {}
    known = {name: line for name, line in imports.items() if wanted.beside or not line.startswith("from .")}
    used = {"from dextera_build.rule import Backend, Context, Options"}
    parts = [_function(wanted, method, f"{kind}Options", known, used) for method in wanted.methods]
    if wanted.kind == "call" and other:
        used |= {"import json", "import os", "import urllib.request", "from typing import Any"}
        parts.append(_ASK.format(variable=f"{wanted.backend.upper()}_URL", backend=wanted.backend))
    profiles = '("stub",)' if wanted.backend == "stub" else "()"
    words = ['summary="what it does, in one line"', f"profiles={profiles}", "packages=()"]
    words += [f'uses=("{other}",)'] if other else []
    if wanted.kind in ("command", "server") and other:
        folder = wanted.program.name
        words += [f'command=("{{python}}", "{folder}/program.py")', f'files=("{folder}/*.py",)']
        words += ["server=True"] if wanted.kind == "server" else []
    text = "\n    " + ",\n    ".join(words) + ",\n" if len(", ".join(words)) > 90 else ", ".join(words)
    head = _HEAD.format(backend=wanted.backend, path=found.path, kind=kind, imports=_sorted(used), words=text)
    return head + "".join(parts)


def _function(wanted: Wanted, method: Any, options: str, known: dict[str, str], used: set[str]) -> str:
    signature = inspect.signature(method)
    inner = [each for name, each in signature.parameters.items() if name not in ("self", "options")]
    parameters = [f"{each.name}: {_known(each.annotation, known, used)}" for each in inner]
    names = [each.name for each in inner if each.name != "ctx"]
    body = {"in-process": _IN_PROCESS, "call": _CALL}.get(wanted.kind, _OUTSIDE) if wanted.other else _UNWRITTEN
    return _FUNCTION.format(
        name=method.__name__,
        parameters=", ".join([*parameters, f"options: {options}"]),
        returns=_known(signature.return_annotation, known, used),
        doc=inspect.getdoc(method) or "",
        body=body.format(
            name=method.__name__,
            backend=wanted.backend,
            file=wanted.shown,
            other=wanted.other,
            arguments=", ".join(names),
            inputs="".join(f", {name}={name}" for name in names if _is_data(method, name)),
        ),
    )


def _is_data(method: Any, name: str) -> bool:
    """Whether a program can be sent this input; objects that measure something for their backend cannot."""
    import numpy as np

    from dextera_build.formats.exchange import has_form

    return has_form(get_type_hints(method, localns={"np": np}, include_extras=True)[name])


def _imports(tree: ast.Module, stem: str) -> dict[str, str]:
    """Name -> the statement that imports it, for all names of a rule's file."""
    found: dict[str, str] = {}
    for node in tree.body:
        if isinstance(node, ast.Import):
            found |= {each.asname or each.name: ast.unparse(ast.Import([each])) for each in node.names}
        elif isinstance(node, ast.ImportFrom):
            lines = {each.asname or each.name: ast.ImportFrom(node.module, [each], node.level) for each in node.names}
            found |= {name: ast.unparse(line) for name, line in lines.items()}
        elif isinstance(node, ast.ClassDef):
            found[node.name] = f"from .{stem} import {node.name}"
    return found


def _known(annotation: Any, known: dict[str, str], used: set[str]) -> str:
    """An annotation, with its imports added to `used`; `Any` if a name of it cannot be imported."""
    if not isinstance(annotation, str):  # the rule's file does not postpone annotations
        annotation = getattr(annotation, "__name__", "Any")
    words = [node.id for node in ast.walk(ast.parse(annotation)) if isinstance(node, ast.Name)]
    lines = set(_lines(words, known))
    if None in lines:
        used.add("from typing import Any")
        return "Any"
    used |= {line for line in lines if line}
    return str(annotation)


def _sorted(lines: set[str]) -> str:
    """Import statements as a formatter orders them: the standard library, other packages, dxb, the folder itself."""
    merged: dict[str, list[str]] = {}
    for line in lines:
        module, _, name = line.partition(" import ")
        merged.setdefault(module, []).extend(name.split(", ") if name else [])
    groups: list[list[str]] = [[], [], [], []]
    for module, parts in sorted(merged.items(), key=lambda item: (item[0].startswith("from "), item[0])):
        name = module.split()[1]
        top = name.partition(".")[0]
        place = 3 if not top else 2 if top == "dextera_build" else 0 if top in sys.stdlib_module_names else 1
        groups[place].append(f"{module} import {', '.join(sorted(parts))}" if parts else module)
    return "\n\n".join("\n".join(group) for group in groups if group)


def _lines(words: list[str], known: dict[str, str]) -> Iterator[str | None]:
    for word in words:
        if word not in ("Context", *vars(builtins)):
            yield known.get(word)
