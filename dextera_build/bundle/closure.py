"""Which blobs belong to a bundle; export and import use the same walk.

A whole result needs everything that its output refers to, its previews, log and `result.json`. Any other node needs its
key document, the headers of its output without their bytes, and `result.json` if its result is known. The headers of
all inputs are included, so that an input can be traced to its node or project file.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from dextera_build.bundle import documents
from dextera_build.bundle.config import Contents, Node
from dextera_build.bundle.documents import BODY, DIGEST, TEXT, Form, Read, maybe
from dextera_build.bundle.errors import ill_formed, wrong_result
from dextera_build.store import headers, references, traces
from dextera_build.store.blobs import is_digest
from dextera_build.store.entry import ActionResult

_INTEGER = Form("a whole number", lambda it: type(it) is int)
_INPUT = Form(
    "a list of slots with SHA-256 digests",
    lambda it: isinstance(it, list) and len(it) == 2 and isinstance(it[0], str) and DIGEST.fits(it[1]),
)
_KEY = {
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


class Closure:
    """The blobs that a set of nodes needs.

    Args:
        read: Gives the bytes of a document, which need not be what they claim to be.
    """

    def __init__(self, read: Read) -> None:
        self._read = read
        self._direct: dict[str, tuple[list[str], list[str]]] = {}
        self.blobs: set[str] = set()
        self.results: dict[str, ActionResult] = {}
        """Key -> result."""

    def add(self, address: str, node: Node) -> None:
        """Add everything that a node needs.

        Raises:
            BundleRefused: One of its documents is malformed.
        """
        document = self._document(address, node)
        self.blobs.add(node.key)
        self._refs([node.output, *(digest for _, digest in document["inputs"])], whole=False)
        if node.result is None:
            return
        result = self._result(address, node)
        if self.results.setdefault(node.key, result) != result:
            raise wrong_result(address, "another node has the same key and another result")
        self.blobs |= {node.result, result.key_document}
        if not node.is_whole:
            return
        self.blobs |= {digest for _, digest in result.previews}
        if result.log is not None:
            self.blobs.add(result.log)
        for key, digest in result.calls:
            self._call(address, key, digest)
        self._refs([node.output], whole=True)

    def _call(self, address: str, key: str, digest: str) -> None:
        """Add a recorded call: request and answer."""
        what = f"a call of `{address}`"
        documents.check(documents.parse(self._read(key), what), {"service": TEXT, "request": {}}, what)
        called = read_result(self._read(digest), address)
        if called.key_document != key or called.digest != digest or not called.is_record:
            raise wrong_result(address, "a call that it names is not one")
        self.blobs |= {key, digest}
        self._refs([called.output], whole=True)

    def _document(self, address: str, node: Node) -> dict[str, Any]:
        what = f"the key document of `{address}`"
        document = documents.parse(self._read(node.key), what)
        if document.keys() - {traces.READ} != _KEY.keys():
            raise ill_formed(what, "it does not have the fields of a key document")
        documents.check(document, _KEY, what)
        if document["rule"] != node.rule or document["backend"] != node.backend:
            raise wrong_result(address, "its key document is that of another rule or backend")
        try:
            traces.parts_of(self._read(node.key))
        except (ValueError, TypeError, KeyError):
            raise ill_formed(what, "it says that the call read what none can read") from None
        return document

    def _result(self, address: str, node: Node) -> ActionResult:
        assert node.result is not None, "asked for nodes that have one"
        data = self._read(node.result)
        result = read_result(data, address)
        if result.key_document != node.key:
            raise wrong_result(address, "its key document does not have the digest that is its key")
        if result.output != node.output:
            raise wrong_result(address, "it names another output than the config")
        if result.digest != node.result:
            raise wrong_result(address, "it is not spelled as dxb spells it")
        return result

    def _refs(self, roots: Iterable[str], *, whole: bool) -> None:
        """Add all headers reachable from `roots`; with `whole` also the blobs that they name."""
        found = references.below(roots, self._directly)
        self.blobs.update(digest for digest, is_header in found.items() if whole or is_header)

    def _directly(self, digest: str) -> tuple[list[str], list[str]]:
        if digest not in self._direct:
            self._direct[digest] = read_header(self._read(digest), digest)
        return self._direct[digest]


def of(contents: Contents, read: Read) -> Closure:
    """The closure of all nodes of a bundle.

    Raises:
        BundleRefused: A document is malformed.
    """
    found = Closure(read)
    for address, node in contents.nodes():
        found.add(address, node)
    return found


def read_header(data: bytes, digest: str) -> tuple[list[str], list[str]]:
    """(artifacts, blobs) that an untrusted header refers to.

    Raises:
        BundleRefused: It is no header.
    """
    what = f"the header `{digest[:12]}`"
    documents.parse(data, what)
    try:
        refs, blobs = headers.closure(data)
        whole = all(isinstance(name, str) and is_digest(name) for name in (*refs, *blobs))
    except (ValueError, KeyError, TypeError, AttributeError, IndexError):
        whole = False
    if not whole:
        raise ill_formed(what, "it is not that of an artifact")
    return refs, blobs


def read_result(data: bytes, address: str) -> ActionResult:
    """Parse an untrusted `result.json`.

    Raises:
        BundleRefused: It spells none.
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
