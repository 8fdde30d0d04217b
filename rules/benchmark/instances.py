"""benchmark.instances: match found instances with the true ones; unmatched ones are listed too."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.cameras.image import LabelImage
from dextera_build.artifacts.objects.view import Segmentation
from dextera_build.artifacts.table import Cell, Column, Table
from dextera_build.rule import Context, Fraction, Options, rule


class InstancesOptions(Options):
    """Options of benchmark.instances."""

    found_iou: Fraction = 0.5
    """IoU at which a true instance counts as found."""


@rule(version=1, packages=("numpy", "scipy"))
def instances(ctx: Context, segmentation: Segmentation, truth: LabelImage, *, options: InstancesOptions) -> Table:
    """Return one row per true instance and one per unmatched found instance.

    True and found instances are paired one to one to maximize the sum of IoUs (Hungarian method).
    """
    found = segmentation.map.labels
    if found.shape != truth.labels.shape:
        ctx.fail(
            "the true labels and the photograph differ in size",
            truth=f"{truth.labels.shape[1]} x {truth.labels.shape[0]} px",
            photograph=f"{found.shape[1]} x {found.shape[0]} px",
            hint="use the labels of this very capture",
        )
    numbers = [int(n) for n in np.unique(truth.labels) if n > 0]
    if not numbers:
        ctx.fail("the true labels hold no instance", hint="0 is background; instances are 1 and up")
    matrix = overlaps(truth.labels, numbers, found, len(segmentation.names))
    pairs = assign(matrix)
    rows = []
    for i, number in enumerate(numbers):
        partner = pairs.get(i)
        iou = 0.0 if partner is None else float(matrix[i, partner])
        rows.append(_row(number, truth.labels, segmentation, iou, partner, options.found_iou))
    extra = [j for j in range(len(segmentation.names)) if j not in pairs.values()]
    rows += [("-", segmentation.names[j], 0, int((found == j + 1).sum()), None, "spurious") for j in extra]
    values = [float(row[4]) for row in rows[: len(numbers)] if isinstance(row[4], float)]
    missed = sum(row[5] == "missed" for row in rows)
    ctx.say(
        f"mean IoU {np.mean(values):.3f} over {len(numbers)} true instances, {missed} missed, {len(extra)} spurious"
    )
    ctx.metric("mean IoU", float(np.mean(values)))
    ctx.metric("missed", missed)
    ctx.metric("spurious", len(extra))
    return Table(
        title="Instances",
        columns=(
            Column(name="true instance"),
            Column(name="found instance"),
            Column(name="true area", unit="px"),
            Column(name="found area", unit="px"),
            Column(name="IoU", better="higher"),
            Column(name="result"),
        ),
        rows=tuple(rows),
        notes=(
            "IoU: intersection over union of the masks, over all pixels of the image",
            "pairs: one to one, chosen so that the sum of IoUs is largest; a true instance without a partner has IoU 0",
            f"found: IoU of at least {options.found_iou:g}; missed: less",
            "spurious: a found instance without a partner; it has no IoU and does not enter the mean",
            f"{len(numbers)} true instances, none left out; {missed} missed, {len(extra)} spurious",
        ),
    )


def overlaps(truth: np.ndarray, numbers: list[int], found: np.ndarray, count: int) -> np.ndarray:
    """IoU (true, found) of every pair of labels."""
    matrix = np.zeros((len(numbers), count))
    for i, number in enumerate(numbers):
        own = truth == number
        for j in range(count):
            other = found == j + 1
            matrix[i, j] = (own & other).sum() / max(1, int((own | other).sum()))
    return matrix


def assign(matrix: np.ndarray) -> dict[int, int]:
    """Row -> column of the one-to-one pairing with the largest sum; pairs without overlap are omitted."""
    from scipy.optimize import linear_sum_assignment

    rows, columns = linear_sum_assignment(-matrix)
    return {int(i): int(j) for i, j in zip(rows, columns, strict=True) if matrix[i, j] > 0}


def _row(
    number: int, truth: np.ndarray, segmentation: Segmentation, iou: float, partner: int | None, found_iou: float
) -> tuple[Cell, ...]:
    area = int((truth == number).sum())
    if partner is None:
        return str(number), "-", area, 0, 0.0, "missed"
    seen = int((segmentation.map.labels == partner + 1).sum())
    return str(number), segmentation.names[partner], area, seen, iou, "found" if iou >= found_iou else "missed"
