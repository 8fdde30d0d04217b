"""`dxb check calibration`: build a node of `align.camera_motion`; the exit code is whether the camera moved."""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING

from dextera_build.building.build import Order
from dextera_build.building.lock import Locking
from dextera_build.cli import options, table
from dextera_build.cli.build.build import built
from dextera_build.errors import UsageError
from dextera_build.session import Session

if TYPE_CHECKING:
    from dextera_build.project.project import Project

RULE = "align.camera_motion"
CODES = (0, 1, 3)
"""Exit codes of unmoved, moved and unsure: the metric `verdict` of the rule."""
MOVED = {0: False, 1: True, 3: None}
"""Exit code -> whether the camera moved; None: unsure."""


def run(args: argparse.Namespace, targets: list[str], project: Project) -> int:
    """Print one line per node; return the largest of their codes.

    Raises:
        UsageError: No node is named, or it is of another rule.
    """
    if not targets or any(":" not in target for target in targets):
        raise UsageError(
            "`dxb check calibration` needs a node",
            code="DXB-U151",
            hint=f"`dxb check calibration RECIPE:NODE`, where the node is of rule `{RULE}`",
        )
    rows = found(args, targets, project)
    if rows is None:
        return 4  # as a requirement that is missing: nothing is known of the camera
    told = [{"target": row.target, "moved": MOVED[row.code], "found": row.line} for row in rows]
    cells = [{"target": row.target, "found": row.line} for row in rows]
    table.give("check.calibration", told, as_json=args.json, cells=cells)
    return max(row.code for row in rows)


@dataclass(frozen=True)
class Row:
    """What is known of one camera."""

    target: str
    """The node that was built."""
    code: int
    """One of `CODES`."""
    line: str
    """What the rule says."""


def found(args: argparse.Namespace, targets: list[str], project: Project) -> list[Row] | None:
    """Build nodes of align.camera_motion, and tell what they found; None if one failed, which was said.

    Raises:
        UsageError: A node is of another rule.
    """
    rows = list[Row]()
    for recipe, nodes in options.by_recipe(targets).items():
        session = Session(project, recipe, options.added(args), makes=True)
        order = Order(nodes, False, [], False, tuple(sys.argv[1:]))
        locking = Locking(project, lock=False, locked=False, added=options.added(args))
        done = built(session, order, locking, None, verbose=False)
        if not done.ok:
            return None
        for node in nodes:
            finished = done.result.nodes[node]
            if finished.rule != RULE:
                raise UsageError(
                    f"`{recipe}:{node}` is of rule {finished.rule}, which detects no motion",
                    code="DXB-U152",
                    hint=f"name a node of rule `{RULE}`",
                )
            known = session.store.actions.known(finished.key or "")
            verdict = int(known.metrics["verdict"][0]) if known is not None else 2
            rows.append(Row(f"{recipe}:{node}", CODES[verdict], finished.line))
    return rows
