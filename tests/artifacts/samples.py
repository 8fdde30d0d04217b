"""Stored values of every artifact type and version, in `samples.json`: what a dxb of that version wrote.

`python -m tests.artifacts.samples` adds a sample of each type whose version has none. It never replaces one: a sample
that today's code cannot read shows that a version, or a reader of the version before, is missing. Until 0.1.0 is tagged
all types are of version 1, and the sample of a type that changes is deleted and made again.
"""

from __future__ import annotations

import base64
import inspect
import json
import re
from pathlib import Path
from typing import Any, get_args

from hypothesis import HealthCheck, Phase, given, settings
from pydantic import BaseModel

from dextera_build import digest
from dextera_build.artifacts.base import Artifact
from dextera_build.artifacts.core.arrays import Array
from dextera_build.artifacts.core.frames import Frames
from dextera_build.artifacts.core.identity import spelled
from dextera_build.artifacts.core.value import Value
from tests.artifacts import generated

FILE = Path(__file__).with_suffix(".json")
_MODULE = re.compile(r"\b[a-z_]+\.(?=\w)")
_MOST = 4000
"""Largest sample [bytes]."""


def read() -> dict[str, dict[str, Any]]:
    """Type and version, as headers spell them -> `key` of the header, `blobs` in base64, `fields`: `structure`."""
    found: dict[str, dict[str, Any]] = json.loads(FILE.read_text())
    return found


def blobs(sample: dict[str, Any]) -> dict[str, bytes]:
    """Digest -> bytes of a sample."""
    return {key: base64.b64decode(text) for key, text in sample["blobs"].items()}


def structure(kind: type[BaseModel]) -> dict[str, Any]:
    """Field -> its type as declared; a `Value` with its own fields, an artifact by name, as it has its own version."""
    found: dict[str, Any] = {}
    for name, info in kind.model_fields.items():
        forms = [each.describe() for each in info.metadata if isinstance(each, Array | Frames)]
        found[name] = " ".join([_MODULE.sub("", inspect.formatannotation(info.annotation)), *forms])
        for value in sorted(_values(info.annotation), key=lambda each: each.__name__):
            found[f"{name}: {value.__name__}"] = structure(value)
    return found


def _values(hint: Any) -> set[type[Value]]:
    if isinstance(hint, type) and issubclass(hint, Value):
        return {hint}
    return {value for part in get_args(hint) for value in _values(part)}


def make(kind: type[Artifact]) -> dict[str, Any]:
    """The sample of a type as it is now: of some generated values, the one with most parts."""
    found: list[tuple[int, int, str, dict[str, bytes]]] = []

    @settings(
        max_examples=40,
        derandomize=True,
        database=None,
        deadline=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(generated.values(kind))
    def draw(value: Artifact) -> None:
        stored: dict[str, bytes] = {}

        def put(data: bytes) -> str:
            key = digest.of_bytes(data)
            stored[key] = data
            return key

        key = value.encode(put)
        size = sum(map(len, stored.values()))
        found.append((len(stored) if size <= _MOST else 0, -size, key, stored))

    draw()
    _, _, key, stored = max(found, key=lambda each: each[:2])
    texts = {name: base64.b64encode(data).decode() for name, data in sorted(stored.items())}
    return {"key": key, "blobs": texts, "fields": structure(kind)}


def main() -> None:
    """Add the samples that are missing."""
    known = read() if FILE.exists() else {}
    for kind in generated.kinds():
        if spelled(kind) not in known:
            known[spelled(kind)] = make(kind)
            print(spelled(kind))
    FILE.write_text(json.dumps(known, indent=0, sort_keys=True) + "\n")


if __name__ == "__main__":
    main()
