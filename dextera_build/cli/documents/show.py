"""Documents of `dxb show`."""

from __future__ import annotations

from dextera_build.cli.documents.document import EPOCH, Document, rows

_STUB = ("text or null", "a sentence, if stub backends made it")
_HEADER = {
    "type": ("text or null", "type of the artifact; null: the store has lost the result"),
    "fields.*.told": ("text", "the field in a few words"),
    "fields.*.value": ("any", "the value of a field of plain data; null for others"),
    "fields.*.dtype": ("text or null", "type of the numbers of an array; null: it is none"),
    "fields.*.shape": ("list of integer or null", "shape of an array; null: it is none"),
}
_METRIC = {"metrics.*.value": ("number", "value of a metric"), "metrics.*.unit": ("text", "its unit")}
_OPTION = {
    "name": ("text", "name of an option; `group.field` in a group"),
    "type": ("text", "its type"),
    "required": ("boolean", "whether it has to be given"),
    "default": ("any", "its default; null: none, or that of the group's options"),
    "bounds": ("text or null", "its bounds"),
    "meaning": ("text", "what it means, with its unit"),
}


def _options(parent: str) -> dict[str, tuple[str, str]]:
    return {f"{parent}[].{name}": told for name, told in _OPTION.items()}


DOCUMENTS = (
    rows(
        "show.recipe",
        "dxb show RECIPE",
        {
            "node": ("text", "address of a node that was built"),
            "seconds": ("number", "how long it took [s]"),
            "run": ("text or null", "id of the run; null: a build of another recipe made it"),
            "line": ("text or null", "its result in one line; null: the store has lost it"),
            "stub": ("boolean", "whether a stub backend made it"),
        },
    ),
    Document(
        "show.node",
        "dxb show RECIPE:NODE",
        {
            "node": ("text", "address of the node, with its recipe"),
            "result": ("text or null", "its result in one line; null: the store has lost it"),
            "rule": ("text", "address of its rule"),
            "version": ("integer", "version of the rule"),
            "backend": ("text or null", "backend of the rule; null: the rule has none"),
            "run": ("text or null", "id of the run that built it; null: a build of another recipe"),
            "time": ("number", f"when it was built [{EPOCH}]"),
            "seconds": ("number", "how long it took to make [s]"),
            "key": ("text", "its key"),
            "stub": _STUB,
            "usage.*": ("number", "`cpu_seconds` [s], `memory_bytes`, `read_bytes`, `written_bytes` [byte], if known"),
            "output": ("text or null", "digest of its output"),
            "whole": ("boolean", "whether the store has the bytes of the output"),
            "calls": ("list of text", "digests of the recorded calls that it made"),
            **_METRIC,
            **_HEADER,
            "options.*": ("any", "value of an option"),
            "inputs.*": ("text", "slot -> digest of what it read"),
            "reads.*": ("text", "what the rule read in the project by itself -> what it found"),
            "packages.*": ("text", "package -> version"),
        },
    ),
    Document(
        "show.part",
        "dxb show RECIPE:NODE.FIELD",
        {
            "part": ("text", "address of the part"),
            "of": ("text", "address of the node, with its recipe"),
            "result": ("text", "the part in one line"),
            "stub": _STUB,
            "digest": ("text", "its digest"),
            **_HEADER,
        },
    ),
    Document(
        "show.rule",
        "dxb show RULE",
        {
            "rule": ("text", "address of the rule"),
            "version": ("integer", "its version"),
            "summary": ("text", "what it does"),
            "inputs[].name": ("text", "name of an input"),
            "inputs[].type": ("text", "its type"),
            "inputs[].required": ("boolean", "whether it has to be given"),
            "output": ("text", "type of what it returns"),
            **_options("options"),
            "files[].kind": ("text", "`primitive`, `algorithm` and the like: what a file in a folder adds"),
            "files[].name": ("text", "its name"),
            "files[].summary": ("text", "what it does"),
            **_options("files[].options"),
            "backends[].name": ("text", "name of a backend"),
            "backends[].profiles": ("list of text", "profiles that take it"),
            "backends[].extra": ("text or null", "the extra that installs its packages"),
            "backends[].gpu_gb": ("number or null", "memory of a GPU that it needs [GiB]; null: none"),
            "backends[].weights": ("list of text", "models whose weights it needs"),
            "backends[].lacks": ("list of text", "packages that are not installed"),
            "backends[].summary": ("text", "what it does"),
            **_options("backends[].options"),
        },
    ),
    Document(
        "show.call",
        "dxb show CALL",
        {
            "call": ("text", "digest of the recorded call"),
            "service": ("text", "the service that was asked"),
            "time": ("number or null", f"when it was asked [{EPOCH}]"),
            "seconds": ("number", "how long the answer took [s]"),
            **_METRIC,
            "request.*": ("any", "a field of the request"),
            "output": ("text", "digest of the recorded answer"),
            "answer": ("text", "the answer, whole"),
        },
    ),
    rows(
        "show.config",
        "dxb show --config",
        {
            "setting": ("text", "name of a setting"),
            "value": ("any", "its value: a number, text, list or table; null: none is set"),
            "origin": ("text", "where it was set"),
        },
    ),
    Document(
        "show.graph",
        "dxb show --graph RECIPE[:TARGET]",
        {
            "recipe": ("text", "the recipe"),
            "target": ("text or null", "the target; null: the whole recipe"),
            "by": ("text", "`node`, `group`, `rule` or `recipe`: what a box is"),
            "nodes[].id": ("text", "the address"),
            "nodes[].rule": ("text or null", "address of the rule; null: the box has several"),
            "nodes[].backend": ("text or null", "its backend; null: none, or several"),
            "nodes[].status": ("text or null", "`cached`, `stale` or `unknown`; null without `--status`"),
            "nodes[].count": ("integer", "number of nodes in the box"),
            "edges[].from": ("text", "id of the node that is read"),
            "edges[].to": ("text", "id of the node that reads it"),
        },
    ),
    Document(
        "show.lineage",
        "dxb show --lineage RECIPE[:NODE]",
        {
            "roots": ("list of text", "ids of the targets"),
            "nodes[].id": ("text", "key of a node, or digest of a file or folder"),
            "nodes[].kind": ("text", "`node`, `file`, `folder` or `unknown`"),
            "nodes[].missing": ("text?", "what the store has lost of it"),
            "nodes[].path": ("text?", "of a file or folder: its path"),
            "nodes[].digest": ("text?", "of a file or folder: its digest"),
            "nodes[].files.*": ("text?", "of a folder: file -> SHA-256; of a file: its own, under an empty name"),
            "nodes[].node": ("text?", "of a node: its address"),
            "nodes[].key": ("text?", "of a node: its key"),
            "nodes[].output": ("text or null?", "of a node: digest of its output"),
            "nodes[].line": ("text?", "of a node: its result in one line"),
            "nodes[].calls": ("list of object?", "of a node: recorded calls, with `call`, `service` and `model`"),
            "nodes[].rule": ("text?", "of a node: address of its rule"),
            "nodes[].version": ("integer?", "of a node: version of the rule"),
            "nodes[].backend": ("text or null?", "of a node: backend of the rule"),
            "nodes[].options": ("object?", "of a node: its options"),
            "nodes[].packages": ("object?", "of a node: package -> version"),
            "nodes[].weights": ("list of text?", "of a node: models whose weights it read, with their digests"),
            "nodes[].code.digest": ("text?", "of a node: digest of its code"),
            "nodes[].code.files.*": ("text?", "of a node: file of the code -> digest"),
            "nodes[].reads.*": ("text?", "of a node: what the rule read in the project by itself -> what it found"),
            "edges[].from": ("text", "id of what is read"),
            "edges[].to": ("text", "id of the node that reads it"),
            "edges[].slot": ("text", "the input by which it is read"),
            "edges[].part": ("text", "path of the part that is read; empty: the whole"),
            "edges[].digest": ("text", "digest of what is read"),
        },
    ),
    Document(
        "show.trace",
        "dxb show --trace [RUN]",
        {
            "traceEvents": ("list", "events of the Trace Event Format, which other programs define"),
            "displayTimeUnit": ("text", "`ms`"),
            "otherData": ("object", "run, recipe, profile and version of dxb"),
        },
    ),
    Document(
        "show.file",
        "dxb show --graph RECIPE -o FILE",
        {"file": ("text", "path of the file that holds the graph or the trace")},
    ),
)
