"""Documents of the verbs that exchange results."""

from __future__ import annotations

from dextera_build.cli.documents.document import Document, rows

_COUNTED = {
    "kind": ("text", "what was counted: `blobs`, ..."),
    "count": ("integer", "number of them"),
    "bytes": ("integer", "their size [byte]"),
}


def _counted(parent: str) -> dict[str, tuple[str, str]]:
    return {f"{parent}[].{name}": told for name, told in (_COUNTED | {"why": ("text", "the reason")}).items()}


DOCUMENTS = (
    rows(
        "cache.push",
        "dxb cache push RECIPE",
        {"node": ("text", "address of a node that the remote has"), "key": ("text", "its key")},
    ),
    rows(
        "cache.pull",
        "dxb cache pull RECIPE",
        {"node": ("text", "a target"), "file": ("text", "path of its main file")},
    ),
    rows("cache.size", "dxb cache size", _COUNTED),
    Document(
        "cache.gc",
        "dxb cache gc",
        {
            **_counted("gone"),
            **_counted("stays"),
            "before": ("integer", "size of the store before [byte]"),
            "after": ("integer", "size of the store after [byte]"),
            "running": ("boolean", "whether builds were running, whose results stay"),
            "vanished": ("list of text", "projects whose folder is missing"),
            "dry": ("boolean", "whether nothing was deleted, as without `--yes`"),
        },
    ),
    Document(
        "cache.verify",
        "dxb cache verify",
        {
            "blobs": ("integer", "number of blobs that were looked at"),
            "bytes": ("integer", "their size [byte]"),
            "results": ("integer", "number of results that were looked at"),
            "findings[].kind": ("text", "`damaged`, `truncated`, `unreadable`, `lacking` or `leftover`"),
            "findings[].name": ("text", "digest, key or path"),
            "findings[].detail": ("text", "what is wrong"),
            "findings[].repaired": ("boolean", "whether `--repair` removed it"),
            "whole": ("boolean", "whether no damage is left"),
        },
    ),
    Document("cache.serve", "dxb cache serve", {"url": ("text", "address of the server")}, when="when it listens"),
    Document(
        "bundle.create",
        "dxb bundle create RECIPE -o FILE.tar",
        {"file": ("text", "path of the bundle"), "digest": ("text", "its digest, `sha256:...`")},
    ),
    Document(
        "bundle.inspect",
        "dxb bundle inspect FILE.tar",
        {
            "digest": ("text", "digest of the bundle, `sha256:...`"),
            "bytes": ("integer", "its size [byte]"),
            "manifest": ("object", "its OCI manifest"),
            "config": ("object", "targets, nodes and recipes, as the bundle states them"),
            "signature.state": ("text", "`trusted`, `unknown` or `unsigned`"),
            "signature.signer": (
                "text or null",
                "name and id of a trusted key, or the id of an unknown one; null: not signed",
            ),
        },
    ),
    Document(
        "bundle.recipe",
        "dxb bundle inspect FILE.tar --recipe NAME",
        {"recipe": ("text", "name of the recipe"), "yaml": ("text", "its YAML")},
    ),
    Document(
        "bundle.import",
        "dxb bundle import FILE.tar",
        {
            "digest": ("text", "digest of the bundle, `sha256:...`"),
            "signature": ("text", "`trusted`, `unknown` or `unsigned`"),
            "targets.*": ("text or null", "target -> digest of its output"),
            "new": ("integer", "results that the store lacked"),
            "bare": ("integer", "how many of them came without their bytes"),
            "known": ("integer", "results that the store had"),
            "other": ("list of text", "nodes for which the store keeps another result"),
        },
    ),
    Document(
        "bundle.keygen",
        "dxb bundle keygen FILE",
        {"file": ("text", "path of the public key"), "key": ("text", "id of the key")},
    ),
)
