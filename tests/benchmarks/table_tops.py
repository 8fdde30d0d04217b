"""Print how the instances of real table tops compare with outlines drawn by hand.

    python -m tests.benchmarks.table_tops

The captures lie outside the project; see `tests/rules/factorize/masks/outlines.yaml`.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from dextera_build.testing import RuleRunner
from tests.rules.factorize.masks import outlines


def main() -> None:
    """One row per photograph."""
    print("| capture | objects | found | missed | spurious | in pieces | mean IoU |\n|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        runner = RuleRunner(Path(folder))
        for capture in outlines.outlines():
            if not (outlines.CAPTURES / capture).is_dir():
                continue
            told = outlines.judge(capture, outlines.segmented(runner, capture))
            count, missed = len(told.iou), ", ".join(told.missed) or "-"
            pieces, mean = ", ".join(told.in_pieces) or "-", np.mean(list(told.iou.values()))
            found = count - len(told.missed)
            print(f"| {capture} | {count} | {found} | {missed} | {len(told.spurious)} | {pieces} | {mean:.3f} |")


if __name__ == "__main__":
    main()
