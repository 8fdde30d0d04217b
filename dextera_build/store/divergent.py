"""Keys that gave another output when they were run again: the first one stays, and what came later is written down."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path

from dextera_build import digest as digests
from dextera_build.errors import StoreError
from dextera_build.store import failpoints, files
from dextera_build.store.blobs import is_digest

_MOST = 16
"""Outputs of one key that are kept in mind."""


@dataclass(frozen=True)
class Divergence:
    """One key with more than one output."""

    key: str
    node: str
    """Address of the node that was run again, with its recipe where that is known."""
    first: str
    """Digest of the output that the store serves."""
    again: tuple[str, ...]
    """Digests of the others, in the order in which they came."""
    time: float
    """When the last one came, seconds since the epoch."""


class Divergent:
    """What this machine knows of such keys, one small file each.

    Args:
        root: The folder; made when the first one is found.
    """

    def __init__(self, root: Path) -> None:
        self.root = root

    def note(self, key: str, node: str, first: str, again: str, time: float) -> None:
        """Remember that `key` gave `again` where the store has `first`; a store that cannot be written does not."""
        known = self.get(key)
        others = known.again if known and known.first == first else ()
        if again not in others and len(others) < _MOST:
            others = (*others, again)
        found = Divergence(key, node, first, others, time)
        with suppress(StoreError):
            files.write(str(self.root / key), json.dumps(asdict(found)).encode(), 0o644)
        failpoints.reach("result.diverged")

    def get(self, key: str) -> Divergence | None:
        """What is known of a key, or None."""
        try:
            raw = digests.plain(files.read(str(self.root / key)))
        except (OSError, ValueError):
            return None
        match raw:
            case {"key": str(), "node": str(), "first": str(), "again": [*again], "time": int() | float()} if len(
                raw
            ) == 5 and all(isinstance(output, str) for output in again):
                return Divergence(**{**raw, "again": tuple(again)})
        return None

    def all(self) -> Iterator[Divergence]:
        """Every one, the newest first."""
        names = [entry.name for entry in self.root.iterdir()] if self.root.is_dir() else []
        found = [known for name in names if is_digest(name) and (known := self.get(name)) is not None]
        yield from sorted(found, key=lambda known: -known.time)
