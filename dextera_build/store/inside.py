"""What an entry of the action cache holds itself, so that it takes no files of its own.

`result.json` stands in every entry. The key document of a node does, too, unless it is long: whoever has its digest has
the key, and so finds the entry. Such an entry needs no blobs for the two; any other has them beside it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from dextera_build import digest as digests
from dextera_build.store.reapi import OutputFile, encode

if TYPE_CHECKING:
    from dextera_build.store.actions import ActionResult
    from dextera_build.store.cas import Blobs

RESULT = "result.json"
KEY = "key.json"
MOST = 1 << 16
"""Key documents up to this size [bytes] stand in the entry, which is read whenever the key is looked up."""


def key_document(outputs: Sequence[OutputFile]) -> bytes:
    """The key document that an entry holds, b"" where it is a blob."""
    # It stands near the end.
    return next((file.contents for file in reversed(outputs) if file.path == KEY), b"")


def blobs(outputs: Sequence[OutputFile]) -> list[OutputFile]:
    """What an entry names that must be there as blobs."""
    return [file for file in outputs if not file.contents] if key_document(outputs) else list(outputs)


def asked(digest: str, document: bytes, blobs: Blobs) -> OutputFile | None:
    """The key document for an entry: in it, or a blob where it is long; None where there are no bytes of it."""
    if len(document) > MOST:
        return OutputFile(KEY, blobs.put(document), len(document))
    return OutputFile(KEY, digest, len(document), document) if document else None


def last(result: ActionResult, asked: OutputFile, blobs: Blobs) -> OutputFile:
    """The `result.json` for an entry; a blob, too, where the key document is one."""
    document = result.document
    result.know(digests.of_bytes(document) if asked.contents else blobs.put(document))
    return OutputFile(RESULT, result.digest, len(document), document)


def travelling(outputs: Sequence[OutputFile]) -> tuple[bytes, list[OutputFile]]:
    """The entry for other stores, and what it names: there the key document is a blob, as cache servers know it."""
    named = [file._replace(contents=b"") if file.path == KEY else file for file in outputs]
    return encode(named), named
