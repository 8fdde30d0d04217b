"""What artifacts refer to, through all headers below them; each header is read once as long as few are known."""

from __future__ import annotations

from dextera_build.store import headers as header
from dextera_build.store.blobs import Blobs, MissingBlob

_MOST_KNOWN = 4096
_MOST_HEADER = 1 << 30
"""The header of a folder of ten million files has this length [bytes]; longer ones are refused."""
UNREADABLE = (MissingBlob, ValueError, KeyError, TypeError, AttributeError, IndexError, RecursionError)
"""Raised for a header that is missing or malformed."""


class References:
    """The references of one store.

    Args:
        blobs: Hold the headers.
    """

    def __init__(self, blobs: Blobs) -> None:
        self._blobs = blobs
        self._known: dict[str, tuple[list[str], list[str]]] = {}

    def below(self, output: str) -> dict[str, bool]:
        """Everything that `output` refers to, through all artifacts, each once: digest -> whether it is a header.

        Raises:
            MissingBlob: A header is not there.
        """
        found: dict[str, bool] = {}
        seen = {output}
        stack = [output]
        while stack:
            refs, blobs = self.directly(stack.pop())
            for blob in blobs:
                found.setdefault(blob, False)
            fresh = [ref for ref in dict.fromkeys(refs) if ref not in seen]
            seen.update(fresh)
            found.update(dict.fromkeys(fresh, True))
            stack += fresh
        found.pop(output, None)
        return found

    def headers(self, output: str) -> list[str] | None:
        """The header of `output` and all headers below it, or None where one is not there."""
        return self._there(output, whole=False)

    def are_here(self, output: str) -> bool:
        """Whether `output` is there with every artifact and blob that it refers to."""
        return self._there(output, whole=True) is not None

    def _there(self, output: str, *, whole: bool) -> list[str] | None:
        try:
            wanted = [output, *(digest for digest, is_header in self.below(output).items() if whole or is_header)]
            return wanted if all(map(self._blobs.has, wanted)) else None
        except UNREADABLE:
            return None

    def directly(self, digest: str) -> tuple[list[str], list[str]]:
        """(artifacts, blobs) that one header refers to.

        Raises:
            MissingBlob: It is not there.
            ValueError: It is longer than any header.
        """
        if digest not in self._known:
            if len(self._known) >= _MOST_KNOWN:
                self._known.clear()
            self._known[digest] = header.closure(self._read(digest))
        return self._known[digest]

    def _read(self, digest: str) -> bytes:
        if (self._blobs.size(digest) or 0) > _MOST_HEADER:
            raise ValueError("a header is too long")
        return self._blobs.get(digest)
