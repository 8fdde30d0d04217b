"""Follows the references of artifacts through all headers below them; parsed headers are cached."""

from __future__ import annotations

from dextera_build.store import headers as header
from dextera_build.store.blobs import Blobs, MissingBlob

_MOST_KNOWN = 4096
_MOST_HEADER = 1 << 30
"""Longest accepted header [bytes], enough for a folder of ten million files."""
UNREADABLE = (MissingBlob, ValueError, KeyError, TypeError, AttributeError, IndexError, RecursionError)
"""Raised for a header that is missing or malformed."""


class References:
    """The references of one store.

    Args:
        blobs: Holds the headers.
    """

    def __init__(self, blobs: Blobs) -> None:
        self._blobs = blobs
        self._known: dict[str, tuple[list[str], list[str]]] = {}

    def below(self, output: str) -> dict[str, bool]:
        """Everything that `output` refers to, directly or not: digest -> whether it is a header.

        Raises:
            MissingBlob: A header is missing.
        """
        found = {output: True}
        stack = [output]
        while stack:
            refs, blobs = self.directly(stack.pop())
            for blob in blobs:
                found.setdefault(blob, False)
            fresh = [ref for ref in dict.fromkeys(refs) if not found.get(ref)]
            found.update(dict.fromkeys(fresh, True))
            stack += fresh
        del found[output]
        return found

    def are_here(self, output: str) -> bool:
        """Whether `output` and every artifact and blob that it refers to are in the store."""
        try:
            return all(map(self._blobs.has, (output, *self.below(output))))
        except UNREADABLE:
            return False

    def directly(self, digest: str) -> tuple[list[str], list[str]]:
        """(artifacts, blobs) that one header refers to.

        Raises:
            MissingBlob: The header is missing.
            ValueError: It is too long or malformed.
        """
        if digest not in self._known:
            if (self._blobs.size(digest) or 0) > _MOST_HEADER:
                raise ValueError("a header is too long")
            if len(self._known) >= _MOST_KNOWN:
                self._known.clear()
            self._known[digest] = header.closure(self._blobs.get(digest))
        return self._known[digest]
