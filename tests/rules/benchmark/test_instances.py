"""Instance scores and their summary on masks whose scores are known by hand."""

from __future__ import annotations

import importlib

import numpy as np
import pytest

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.cameras.image import LabelImage
from dextera_build.artifacts.objects.view import InstanceMap, Segmentation
from dextera_build.artifacts.table import Column, Table
from dextera_build.code.loader import Library
from dextera_build.errors import RuleError
from dextera_build.testing import RuleRunner

Library().find("benchmark.instances")
instances = importlib.import_module("rules.benchmark.instances")


@pytest.fixture
def runner(tmp_path):
    return RuleRunner(tmp_path)


def painted(*boxes: tuple[int, int, int, int]) -> np.ndarray:
    """Labels 1.. of boxes (left, top, right, bottom) in 30 x 20 px."""
    labels = np.zeros((20, 30), np.int32)
    for number, (left, top, right, bottom) in enumerate(boxes, start=1):
        labels[top:bottom, left:right] = number
    return labels


def found(labels: np.ndarray) -> Segmentation:
    names = tuple(f"thing_{n}" for n in range(1, int(labels.max()) + 1))
    return Segmentation(items={}, names=names, map=InstanceMap(labels=labels, fixed=np.zeros(labels.shape, bool)))


def scored(runner, seen: np.ndarray, truth: np.ndarray) -> Table:
    return runner.run("benchmark.instances", segmentation=found(seen), truth=LabelImage(labels=truth))


def test_equal_masks_score_one(runner):
    labels = painted((2, 2, 10, 10), (12, 2, 20, 10))
    table = scored(runner, labels, labels)
    assert [row[4:] for row in table.rows] == [(1.0, "found"), (1.0, "found")]
    assert runner.outcome.metrics["mean IoU"] == (1.0, "")


def test_the_order_of_labels_does_not_matter(runner):
    one, other = painted((2, 2, 10, 10), (12, 2, 20, 10)), painted((12, 2, 20, 10), (2, 2, 10, 10))
    assert [row[4] for row in scored(runner, one, other).rows] == [1.0, 1.0]


def test_a_missed_instance_counts_as_zero(runner):
    table = scored(runner, painted((2, 2, 10, 10)), painted((2, 2, 10, 10), (20, 2, 28, 10)))
    assert table.rows[1] == ("2", "-", 64, 0, 0.0, "missed")
    assert runner.outcome.metrics["mean IoU"][0] == pytest.approx(0.5)
    assert runner.outcome.line == "mean IoU 0.500 over 2 true instances, 1 missed, 0 spurious"


def test_a_spurious_instance_has_a_row_but_no_iou(runner):
    table = scored(runner, painted((2, 2, 10, 10), (20, 2, 28, 12)), painted((2, 2, 10, 10)))
    assert table.rows[1] == ("-", "thing_2", 0, 80, None, "spurious")
    assert runner.outcome.metrics["mean IoU"][0] == 1.0
    assert runner.outcome.metrics["spurious"][0] == 1


def test_one_found_thing_pays_for_one_true_one_only(runner):
    merged = painted((2, 2, 20, 10))
    table = scored(runner, merged, painted((2, 2, 14, 10), (14, 2, 20, 10)))
    assert table.rows[0][4] == pytest.approx(12 / 18)
    assert table.rows[1][4:] == (0.0, "missed")


def test_pairs_are_chosen_for_the_largest_sum():
    # Greedily, the first would take column 0 and leave the second nothing.
    assert instances.assign(np.array([[0.5, 0.45], [0.4, 0.0]])) == {0: 1, 1: 0}
    assert instances.assign(np.array([[0.5, 0.0], [0.4, 0.0]])) == {0: 0}


def test_a_poor_match_is_missed(runner):
    table = scored(runner, painted((2, 2, 5, 10)), painted((2, 2, 10, 10)))
    assert table.rows[0][5] == "missed"
    assert table.rows[0][4] == pytest.approx(3 / 8)


def test_notes_say_what_the_numbers_mean(runner):
    notes = " ".join(scored(runner, painted((2, 2, 5, 10)), painted((2, 2, 10, 10))).notes)
    for word in ("IoU", "missed", "spurious", "0.5", "none left out"):
        assert word in notes


def test_labels_of_another_image_are_refused(runner):
    with pytest.raises(RuleError, match="differ in size") as caught:
        scored(runner, painted((2, 2, 5, 10)), np.zeros((5, 6), np.int32))
    assert caught.value.facts == {"truth": "6 x 5 px", "photograph": "30 x 20 px"}


def test_truth_without_instances_is_refused(runner):
    with pytest.raises(RuleError, match="the true labels hold no instance"):
        scored(runner, painted((2, 2, 5, 10)), np.zeros((20, 30), np.int32))


COLUMNS = (Column(name="thing"), Column(name="IoU", better="higher"), Column(name="result"))


def table(*rows: tuple[str, float | None, str]) -> Table:
    return Table(title="Instances", columns=COLUMNS, rows=rows, notes=("IoU: overlap", "3 of 3"))


def test_the_summary_pools_rows_not_captures(runner):
    tables = Collection[Table](
        items={
            "b": table(("1", 0.6, "found")),
            "a": table(("1", 1.0, "found"), ("2", 0.8, "found"), ("3", 0.0, "missed"), ("-", None, "spurious")),
        }
    )
    result = runner.run("benchmark.summary", tables=tables)
    names = [column.name for column in result.columns]
    rows = {row[0]: dict(zip(names, row, strict=True)) for row in result.rows}
    assert list(rows) == ["a", "b", "all"]
    assert rows["a"]["IoU mean"] == pytest.approx(0.6)
    assert rows["all"]["IoU mean"] == pytest.approx(0.6)
    assert rows["all"]["count"] == 4
    assert rows["all"]["IoU deviation"] == pytest.approx(np.std([1.0, 0.8, 0.0, 0.6], ddof=1))
    assert rows["b"]["IoU deviation"] is None
    assert (rows["all"]["found"], rows["all"]["missed"], rows["all"]["spurious"]) == (3, 1, 1)
    assert rows["all"]["IoU low"] < 0.6 < rows["all"]["IoU high"]
    assert any("bootstrap" in note for note in result.notes)


def test_the_interval_covers_the_mean_about_as_often_as_it_says(runner):
    rng = np.random.default_rng(0)
    hits = 0
    for _ in range(60):
        rows = [("x", float(v), "found") for v in rng.normal(0.5, 0.1, 30)]
        tables = Collection[Table](items={"a": table(*rows)})
        result = runner.run("benchmark.summary", tables=tables, options={"draws": 400})
        _, _, _, _, low, high, _ = result.rows[-1]
        hits += low <= 0.5 <= high
    assert 50 <= hits <= 60


def test_tables_of_different_form_are_refused(runner):
    other = Table(title="x", columns=COLUMNS[:1], rows=(("1",),))
    with pytest.raises(RuleError, match="the table of `b` has other columns than that of `a`"):
        runner.run("benchmark.summary", tables=Collection[Table](items={"a": table(), "b": other}))


def test_no_table_is_refused(runner):
    with pytest.raises(RuleError, match="no table was given"):
        runner.run("benchmark.summary", tables=Collection[Table](items={}))
