"""The JSON documents of verbs and the events of a build, from their descriptions."""

from __future__ import annotations

import ast
import inspect
import re
from itertools import groupby, pairwise

from dextera_build.cli.documents import GROUPS
from dextera_build.cli.documents.document import Document
from dextera_build.runs import events

from .markdown import code, escaped, join, table

_INHERITED = "Event"
_TYPES = {
    "str": "text",
    "Status": "text",
    "float": "number",
    "int": "integer",
    "bool": "boolean",
    "list": "list",
    "Mapping": "object",
    "DxbError": "object",
}
"""Type of a field of an event -> its type in JSON."""


def page() -> str:
    """One section per verb, with a table of the fields of each document."""
    documents = [document for group in GROUPS.values() for document in group]
    verbs = groupby(sorted(documents, key=_verb), key=_verb)
    return join(*(join(f"## dxb {verb}", *(_document(each) for each in found)) for verb, found in verbs))


def _verb(document: Document) -> str:
    return document.name.partition(".")[0]


def _document(document: Document) -> str:
    rows = [[code(path), kind, escaped(meaning)] for path, (kind, meaning) in document.fields.items()]
    when = f" {document.when}" if document.when else ""
    said = f"`{document.command} --json` prints {code(document.schema)}{when}:"
    return join(said, table(["field", "type", "meaning"], rows))


def events_page() -> str:
    """One row per event: its name, meaning and fields."""
    tree = ast.parse(inspect.getsource(events))
    classes = [node for node in tree.body if isinstance(node, ast.ClassDef)]
    made = [node for node in classes if any(ast.unparse(base) == _INHERITED for base in node.bases)]
    return table(["event", "meaning", "fields"], [_event(node) for node in made])


def _event(node: ast.ClassDef) -> list[str]:
    kind = getattr(events, node.name).kind
    told = []
    for field, after in pairwise([*node.body, ast.Pass()]):
        if isinstance(field, ast.AnnAssign) and ast.unparse(field.target) != "kind":
            said = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant) and after.value.value
            meaning = f": {_prose(str(said)).rstrip('.')}" if said else ""
            told.append(f"{code(ast.unparse(field.target))} ({_type(ast.unparse(field.annotation))}){meaning}")
    return [code(kind), _prose(ast.get_docstring(node) or ""), "; ".join(told)]


def _type(annotation: str) -> str:
    """An annotation as a type of JSON: `str | None` is `text or null`."""
    name, _, rest = annotation.partition(" | ")
    return _TYPES[name.partition("[")[0]] + (" or null" if rest == "None" else "")


def _prose(docstring: str) -> str:
    """A docstring in one line, without references to other classes."""
    return escaped(re.sub(r"; see `[^`]*`", "", " ".join(docstring.split())))
