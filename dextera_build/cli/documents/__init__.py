"""The JSON documents of all verbs.

Every verb with `--json` prints them through `cli.table`; the page of output for programs is made from them, and tests
compare what verbs print with them.
"""

from __future__ import annotations

from dextera_build.cli.documents import build, look, project, robot, share, show
from dextera_build.cli.documents.document import Document

GROUPS: dict[str, tuple[Document, ...]] = {
    "build": build.DOCUMENTS,
    "look": (*look.DOCUMENTS, *show.DOCUMENTS),
    "robot": robot.DOCUMENTS,
    "share": share.DOCUMENTS,
    "project": project.DOCUMENTS,
}
"""Group of verbs -> its documents."""
DOCUMENTS = {document.name: document for group in GROUPS.values() for document in group}
"""Name -> document."""
