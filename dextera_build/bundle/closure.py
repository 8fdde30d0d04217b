"""The blobs that belong to a bundle; export and import use the same walk.

A whole result needs everything that its output refers to, its previews, log and `result.json`. Any other node needs its
key document, the headers of its output without their bytes, and `result.json` if its result is known. The headers of
all inputs are included, so that an input can be traced to its node or project file.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from dextera_build.bundle import documents
from dextera_build.bundle.config import Contents, Node
from dextera_build.bundle.documents import BODY, DIGEST, TEXT, Form, Read, maybe
from dextera_build.bundle.errors import ill_formed, wrong_result
from dextera_build.errors import StoreError
from dextera_build.store import traces
from dextera_build.store.blobs import MissingBlob
from dextera_build.store.entry import ActionResult
from dextera_build.store.references import UNREADABLE
from dextera_build.store.results import Actions

_INTEGER = Form("a whole number", lambda it: type(it) is int)
_INPUT = Form(
    "a list of slots with SHA-256 digests",
    lambda it: isinstance(it, list) and len(it) == 2 and isinstance(it[0], str) and DIGEST.fits(it[1]),
)
_KEY: dict[Any, Any] = {
    "schema": _INTEGER,
    "rule": TEXT,
    "version": _INTEGER,
    "code": {BODY: {TEXT: TEXT}},
    "packages": {TEXT: TEXT},
    "backend": maybe(TEXT),
    "weights": [TEXT],
    "types": {TEXT: TEXT},
    "options": {},
    "salt": BODY,
    "inputs": [_INPUT],
}
"""Fields of a key document; `engine/key.py` writes them."""


def of(contents: Contents, read: Read, actions: Actions) -> tuple[set[str], dict[str, ActionResult]]:
    """The blobs that all nodes of a bundle need, and key -> result.

    Args:
        contents: The nodes.
        read: Returns the bytes of a document, which is untrusted.
        actions: Results of the store that holds the blobs.

    Raises:
        BundleRefused: A document is malformed.
        MissingBlob: A blob is not in the store.
    """
    blobs: set[str] = set()
    results: dict[str, ActionResult] = {}
    for address, node in contents.nodes():
        document = _document(read, address, node)
        result = None if node.result is None else _result(read, address, node, node.result)
        if result is not None and results.setdefault(node.key, result) != result:
            raise wrong_result(address, "another node has the same key and another result")
        try:
            blobs |= _needed(actions, node, document, result)
        except MissingBlob:
            raise
        except (*UNREADABLE, StoreError):
            raise ill_formed(f"a header of `{address}`", "it does not describe an artifact") from None
    return blobs, results


def _needed(actions: Actions, node: Node, document: Mapping[str, Any], result: ActionResult | None) -> set[str]:
    found = {node.key} if node.result is None else {node.key, node.result}
    for output in (node.output, *(digest for _, digest in document["inputs"])):
        below = actions.references.below(output)
        found |= {output, *(digest for digest, is_header in below.items() if is_header)}
    if result is not None and node.is_whole:
        found |= {file.digest for file in actions.made(result).files}
    return found


def _document(read: Read, address: str, node: Node) -> dict[str, Any]:
    what, data = f"the key document of `{address}`", read(node.key)
    document = documents.parse(data, _KEY, what)
    if document.keys() - {traces.READ} != _KEY.keys():
        raise ill_formed(what, "it does not have the fields of a key document")
    documents.refuse_other_spelling(data, document, what)
    if document["rule"] != node.rule or document["backend"] != node.backend:
        raise wrong_result(address, "its key document names another rule or backend")
    try:
        traces.parts_of(data)
    except (ValueError, TypeError, KeyError):
        raise ill_formed(what, "it lists a read that no call can make") from None
    return document


def _result(read: Read, address: str, node: Node, digest: str) -> ActionResult:
    result = read_result(read(digest), address)
    if result.key_document != node.key:
        raise wrong_result(address, "its key document does not have the digest that is its key")
    if result.output != node.output:
        raise wrong_result(address, "it names another output than the config")
    if result.digest != digest:
        raise wrong_result(address, "it is not spelled as dxb spells it")
    for key, answer in result.calls if node.is_whole else ():
        documents.parse(read(key), {"service": TEXT, "request": {}}, f"a call of `{address}`")
        called = read_result(read(answer), address)
        if called.key_document != key or called.digest != answer or not called.is_record:
            raise wrong_result(address, "a call that it names is not one")
    return result


def read_result(data: bytes, address: str) -> ActionResult:
    """Parse an untrusted `result.json`.

    Raises:
        BundleRefused: It is malformed.
    """
    what = f"the result of `{address}`"
    try:
        result = ActionResult.from_document(data)
    except ValueError:
        raise ill_formed(what, "it does not have the fields of a result") from None
    units = [unit for _, unit in result.metrics.values()]
    texts = [result.line, *(caption for caption, _ in result.previews), *result.metrics, *units]
    documents.check(texts, [TEXT], what, "text")
    return result
