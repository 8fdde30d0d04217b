"""Documents of the verbs that build and check."""

from __future__ import annotations

from dextera_build.cli.documents.document import ERROR, NODE, STALE, Document, below, rows

DOCUMENTS = (
    rows(
        "plan",
        "dxb plan RECIPE",
        NODE
        | {
            "needs": ("list of text", "what the backend lacks on this machine"),
            "next": ("text or null", "how to get it"),
        },
    ),
    rows("plan.check", "dxb plan RECIPE --check", STALE),
    Document(
        "bind",
        "dxb bind RECIPE [NAME]",
        {
            "node": ("text", "the node that gives names"),
            "objects[].name": ("text", "name of an object"),
            "objects[].object": ("text", "name that was proposed for it"),
            "objects[].at_px": ("list of integer", "column and row of one of its pixels [px]"),
            "objects[].bound": ("text or null", "`recipe` or `dxb.lock`; null: it has its proposed name"),
            "stale": ("list of text", "names that are bound by a point on another photograph"),
        },
    ),
    Document(
        "bind.removed",
        "dxb bind RECIPE --remove NAME",
        {"target": ("text", "the recipe or node"), "removed": ("text", "the name")},
    ),
    rows(
        "check",
        "dxb check [RECIPE[:NODE]]",
        {
            "target": ("text", "the recipe, or the node that was rebuilt"),
            "found": ("text or null", "what was found, in words; null if an error came first"),
            "bounds[].node": ("text", "the node that a bound of the recipe names"),
            "bounds[].metric": ("text", "its metric"),
            "bounds[].value": ("number or null", "its value; null: the node is not built"),
            "bounds[].unit": ("text", "unit of the value"),
            "bounds[].interval": ("list of number or null", "ends of its interval, in the same unit"),
            "bounds[].bound": ("text", "the bound as the recipe states it"),
            "bounds[].ok": ("boolean or null", "whether it holds; null: the node is not built"),
            "error": ("object or null", "the error of this target; null: none"),
            **below("error", ERROR),
        },
    ),
    rows(
        "check.calibration",
        "dxb check calibration RECIPE:NODE",
        {
            "target": ("text", "the node"),
            "moved": ("boolean or null", "whether the camera moved; null: unsure"),
            "found": ("text", "what was measured, in words"),
        },
    ),
)
