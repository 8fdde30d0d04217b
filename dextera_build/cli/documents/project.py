"""Documents of the verbs that set a project and its machine up."""

from __future__ import annotations

from dextera_build.cli.documents.document import Document, rows

_INSTALLED = {
    "model": ("text", "name of the model"),
    "digest": ("text", "digest of its weights"),
}

DOCUMENTS = (
    Document(
        "doctor",
        "dxb doctor",
        {
            "cores": ("integer", "cores that this process may use"),
            "free_bytes": ("integer", "free space where the store is [byte]"),
            "rows[].what": ("text", "what was checked: `python`, `store`, `RULE=BACKEND`, ..."),
            "rows[].ok": ("boolean", "whether it is fine"),
            "rows[].found": ("text", "what was found, in words"),
            "rows[].mend": ("text or null", "what mends it; null: nothing to mend"),
        },
    ),
    rows(
        "models.ls",
        "dxb models ls",
        {
            "model": ("text", "name of the model"),
            "state": ("text", "`installed`, `missing`, `incomplete` or `licence not accepted`"),
            "digest": ("text or null", "digest of the installed weights, or that of the description"),
            "folder": ("text or null", "where they are; null: not installed"),
            "bytes": ("integer or null", "their size [byte]; null: not installed"),
            "memory_gb": ("number or null", "memory that they take [GiB]; null: not stated"),
            "licence": ("text", "their licence"),
            "forbids": ("text or null", "a use that it forbids"),
            "source": ("text or null", "where they are from; null: they are added by hand"),
            "rows": ("text or null", "the part of the pipeline that it fills"),
            "backends": ("list of text", "backends that need them, `RULE=BACKEND`"),
            "summary": ("text", "what the model is"),
        },
    ),
    rows("models.get", "dxb models get NAME", _INSTALLED | {"folder": ("text", "where the weights are")}),
    rows("models.add", "dxb models add NAME FILE", _INSTALLED | {"folder": ("text", "where the weights are")}),
    rows("models.verify", "dxb models verify", _INSTALLED | {"damaged": ("list of text", "files that are damaged")}),
    rows(
        "models.accept",
        "dxb models accept NAME",
        {
            "model": ("text", "name of the model"),
            "licence": ("text", "the licence that was accepted"),
            "forbids": ("text or null", "a use that it forbids"),
        },
    ),
    rows("models.rm", "dxb models rm NAME", _INSTALLED | {"bytes": ("integer", "size of what was removed [byte]")}),
    rows(
        "consent.ls",
        "dxb consent ls",
        {
            "service": ("text", "name of the service; `*`: every one"),
            "data": ("text", "kind of data; `*`: every one"),
            "project": ("text", "folder of the project; `*`: every one; `DXB_CONSENT`: given by that variable"),
            "given": ("text or null", "date, `2026-01-31`; null: given by the variable"),
        },
    ),
)
