"""The key of a node: the digest of a document that holds everything its output depends on.

The document's digest is the key, and `dxb why` prints `compare` of two documents, so every part of the key can be
explained. The node's address, paths outside the rule tree, cores and memory are not part of it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import takewhile
from typing import Any, Literal, TypeAlias

from dextera_build import digest as digests
from dextera_build.code import order
from dextera_build.code.order import ORDER
from dextera_build.engine.graph import Call, RuleFacts
from dextera_build.store import traces

SCHEMA = 3
"""Incremented when the form or meaning of the document changes; this changes every key."""

_OWN = ("inputs", "options", "salt")
"""Parts of the document that differ between calls of one rule, in document order."""
_MARK = "\0"
"""Placeholder for these parts; no field of a rule has this value."""

Document: TypeAlias = dict[str, Any]
Kind: TypeAlias = Literal[
    "option", "code", "package", "backend", "companion", "input", "version", "type", "weights", "salt", "read"
]


class Writer:
    """Writes key documents as canonical bytes; the part shared by all calls of a rule is encoded once."""

    def __init__(self) -> None:
        self._rules: dict[int, tuple[RuleFacts, list[bytes]]] = {}

    def document(self, call: Call, inputs: Mapping[str, str]) -> bytes:
        """The key document of a call with known inputs (slot -> digest)."""
        around, spell = self._around(call.rule), digests.canonical
        pairs = [[slot, inputs[slot]] for slot in sorted(inputs)]
        # In the order of `_OWN`.
        own = (spell(pairs), spell(dict(call.options)), spell(call.salt))
        return b"%b%b%b%b%b%b%b" % (around[0], own[0], around[1], own[1], around[2], own[2], around[3])

    def _around(self, rule: RuleFacts) -> list[bytes]:
        """The bytes before, between and after the parts specific to each call."""
        # By identity: the facts contain unhashable mappings, and the entry keeps them alive.
        known = self._rules.get(id(rule))
        if known is None:
            text = digests.canonical(_shared(rule) | dict.fromkeys(_OWN, _MARK))
            known = self._rules[id(rule)] = (rule, text.split(digests.canonical(_MARK)))
        return known[1]


@dataclass(frozen=True)
class Change:
    """One difference between two key documents; None means absent."""

    kind: Kind
    name: str
    """Option path, `file: definition`, `file: order of statements`, distribution, slot, ..."""
    old: Any
    new: Any


def compare(old: Document, new: Document) -> list[Change]:
    """Every difference between two keys, starting with the kinds that people edit most directly."""
    changes = [
        *_rows("option", flat(old["options"]), flat(new["options"])),
        # Before the code, because another backend or companion has other code.
        *_rows("backend", {"backend": old["backend"]}, {"backend": new["backend"]}),
        *_rows("companion", _companions(old), _companions(new)),
        *_rows("code", _code(old), _code(new)),
        *_orders(old, new),
        *_rows("version", _versions(old), _versions(new)),
        *_rows("weights", _weights(old), _weights(new)),
        *_rows("package", old["packages"], new["packages"]),
        *_rows("type", old["types"], new["types"]),
        *_rows("input", dict(old["inputs"]), dict(new["inputs"])),
        *_rows("salt", {"salt": old["salt"]}, {"salt": new["salt"]}),
        *_rows("read", _reads(old), _reads(new)),
    ]
    return list(changes)


def _shared(rule: RuleFacts) -> Document:
    some: Document = {traces.READ: None} if rule.discovers else {}
    if rule.companions:
        some["companions"] = {slot: list(paths) for slot, paths in rule.companions.items()}
    return some | {
        "schema": SCHEMA,
        "rule": rule.path,
        "version": rule.version,
        "code": {file: dict(definitions) for file, definitions in rule.code.items()},
        "packages": dict(rule.packages),
        "backend": rule.backend,
        "weights": list(rule.weights),
        "types": dict(rule.types),
    }


def _rows(kind: Kind, old: Mapping[str, Any], new: Mapping[str, Any]) -> Iterator[Change]:
    for name in sorted({*old, *new}):
        before, after = old.get(name), new.get(name)
        # 1, 1.0 and True are equal in Python, but not in the key.
        if (name in old) != (name in new) or digests.canonical(before) != digests.canonical(after):
            yield Change(kind, name, before, after)


def flat(options: Mapping[str, Any]) -> dict[str, Any]:
    """Options with nested groups flattened to `group.option`."""
    found: dict[str, Any] = {}
    stack: list[tuple[str, Any]] = [*options.items()]
    while stack:
        name, value = stack.pop()
        if isinstance(value, dict) and value:
            stack += [(f"{name}.{inner}", item) for inner, item in value.items()]
        else:
            found[name] = value
    return found


def _reads(document: Document) -> dict[str, str]:
    return {traces.label(kind, name): answer for kind, name, answer in document.get(traces.READ) or ()}


def _companions(document: Document) -> dict[str, str]:
    return {slot: ", ".join(map(_companion, paths)) for slot, paths in document.get("companions", {}).items()}


def _companion(path: str) -> str:
    of, _, stem = path.rpartition("/")
    return of if of.endswith(f".{stem}") else f"`{stem}.py` of {of}"


def _code(document: Document) -> dict[str, str]:
    return {
        f"{file}: {definition}": digest
        for file, definitions in document["code"].items()
        for definition, digest in definitions.items()
        if definition != ORDER
    }


def _orders(old: Document, new: Document) -> Iterator[Change]:
    """Changed orders of statements that are the same in both; new and changed ones are found by their names."""
    for file in sorted(old["code"].keys() & new["code"].keys()):
        before, after = old["code"][file], new["code"][file]
        if ORDER in before and ORDER in after:
            same = {name for name in before if before[name] == after.get(name)}
            turned = [[name for name in _ordered(each) if name in same] for each in (before, after)]
            if turned[0] != turned[1]:
                yield Change("code", f"{file}: {ORDER}", *_apart(*turned))


def _ordered(definitions: Mapping[str, str]) -> list[str]:
    said = order.names_in(definitions[ORDER])
    return [*said, *sorted(definitions.keys() - {ORDER, *said})]


def _apart(old: list[str], new: list[str]) -> tuple[str, str]:
    """Two orders without their common beginning and end, as text."""
    start = _common(old, new)
    end = _common(old[start:][::-1], new[start:][::-1])
    return order.spelled(old[start : len(old) - end]), order.spelled(new[start : len(new) - end])


def _common(old: list[str], new: list[str]) -> int:
    """Length of the common beginning."""
    return sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], zip(old, new, strict=False)))


def _versions(document: Document) -> dict[str, Any]:
    return {name: document[name] for name in ("schema", "rule", "version")}


def _weights(document: Document) -> dict[str, str]:
    return {name: digest for name, _, digest in (entry.partition("@") for entry in document["weights"])}
