"""Print names, masses and sizes of the things in real photographs beside what they are.

    python -m tests.benchmarks.captured_things            # all tables
    python -m tests.benchmarks.captured_things --names    # names alone: no body is fitted
    python -m tests.benchmarks.captured_things --known --outlined    # sizes with masks that are outlined by hand

The captures lie outside the project. The words are by eye. Sizes and masses are those published with the YCB object
set (Calli et al. 2015), for full packages as bought; what the photographed ones contain is not known.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from PIL import Image as Pillow

from dextera_build.artifacts.objects.object import Body, Link, Shape, Support
from dextera_build.artifacts.objects.view import Instance, Segmentation
from dextera_build.geometry import boxes, transforms
from dextera_build.testing import RuleRunner
from rules.benchmark.instances import overlaps
from tests import object_views
from tests.benchmarks.masses import PUBLISHED_G
from tests.rules.factorize.masks import outlines

WORDS: dict[str, str | dict[str, str]] = {
    "table_mustard": "bottle",
    "table_blue_mug": "mug",
    "table_white_bowl": "bowl",
    "table_cheezit": "box",
    "table_sugar": "box",
    "table_top_0": {
        "mustard": "bottle",
        "drill": "drill",
        "black_mug": "mug",
        "white_mug": "mug",
        "small_can": "can",
        "meat_can": "can",
        "teal_bowl": "bowl",
        "white_bowl": "bowl",
        "cracker_box": "box",
        "soup_can": "can",
    },
    "table_top_2": {
        "cracker_box": "box",
        "mustard": "bottle",
        "soup_can": "can",
        "meat_can": "can",
        "drill": "drill",
        "teal_bowl": "bowl",
        "small_can": "can",
        "black_mug": "mug",
        "white_bowl": "bowl",
    },
    "table_top_5": {"bag": "bag", "red_box": "box", "blue_box": "box"},
    "table_top_7": {
        "knobs": "block",
        "green_mug": "mug",
        "purple_cup": "cup",
        "lying_marker": "marker",
        "standing_marker": "marker",
    },
    "kitchen_table": {
        "white_cup": "mug",
        "patterned_cup": "mug",
        "left_magazines": "magazine",
        "middle_magazines": "magazine",
        "lunch_box": "box",
    },
    "clutter_learn_00": "box box",
    "clutter_learn_05": "box box",
    "clutter_learn_13": "box box box",
    "clutter_learn_18": "box box",
    "clutter_learn_22": "box box box",
    "clutter_learn_27": "box box",
    "clutter_learn_31": "can box",
    "clutter_learn_36": "tin bowl bowl",
    "clutter_learn_40": "tin can bowl",
    "clutter_test_46": "tin can box box box can",
    "clutter_test_51": "tin book box can box box can",
}
"""Capture -> what every thing is: by outline, by number of its label, or of the only one."""
KNOWN: dict[tuple[str, str], tuple[str, tuple[float, float, float]]] = {
    ("table_mustard", "1"): ("mustard bottle", (190, 95, 58)),
    ("table_sugar", "1"): ("sugar box", (175, 89, 38)),
    ("table_top_0", "mustard"): ("mustard bottle", (190, 95, 58)),
    ("table_top_0", "cracker_box"): ("cracker box", (210, 158, 60)),
    ("table_top_0", "soup_can"): ("soup can", (101, 66, 66)),
    ("table_top_0", "meat_can"): ("potted meat can", (82, 97, 50)),
    ("table_top_0", "drill"): ("cordless drill", (184, 187, 57)),
    ("table_top_2", "mustard"): ("mustard bottle", (190, 95, 58)),
    ("table_top_2", "cracker_box"): ("cracker box", (210, 158, 60)),
}
"""Capture and thing -> the YCB object, and its height, width and depth as it stands [mm]."""


@dataclass(frozen=True)
class Found:
    """A thing of a photograph and the instance that is paired with it."""

    capture: str
    thing: str
    word: str
    name: str  # of the instance; empty without one
    instance: Instance | None
    support: Support
    own: np.ndarray  # (H, W) bool, its outline or label in the photograph
    shown: np.ndarray  # (H, W) bool, the instance's mask; empty without one


def things(runner: RuleRunner, capture: str) -> Iterator[Found]:
    """Every thing of a photograph, with the instance whose mask has an IoU of at least .5 with it."""
    found, support = outlines.over_support(runner, capture)
    labels, names, words = _truth(capture, found)
    matrix = overlaps(labels, list(range(1, len(names) + 1)), found.map.labels, len(found.names))
    for row, (thing, word) in enumerate(zip(names, words, strict=True)):
        best = int(np.argmax(matrix[row]))
        name = found.names[best] if matrix[row, best] >= outlines.FOUND else ""
        shown = found.mask(name) if name else np.zeros(labels.shape, bool)
        own = labels == row + 1
        yield Found(capture, thing, word, name, found.items[name] if name else None, support, own, shown)


def outlined(found: Found) -> Found:
    """The same with the mask of its outline, as far as it is in the instance's crop."""
    assert found.instance is not None
    crop = found.instance.view.mask
    top, left = np.argwhere(found.shown).min(axis=0) - np.argwhere(crop).min(axis=0)
    mask = found.own[top : top + crop.shape[0], left : left + crop.shape[1]]
    return replace(found, instance=object_views.changed(found.instance, mask=mask))


def _truth(capture: str, found: Segmentation) -> tuple[np.ndarray, list[str], list[str]]:
    """Labels (H, W), 1 for the first thing, with names and words."""
    told = WORDS[capture]
    if isinstance(told, dict):
        return outlines.labels(capture, found.map.labels.shape), list(told), list(told.values())
    words = told.split()
    names = [str(number) for number in range(1, len(words) + 1)]
    if (outlines.CAPTURES / capture / "instances.png").exists():
        return np.asarray(Pillow.open(outlines.CAPTURES / capture / "instances.png")).astype(np.int32), names, words
    sizes = np.bincount(found.map.labels.ravel())[1:]
    return (found.map.labels == int(np.argmax(sizes)) + 1).astype(np.int32), names, words


def fitted(runner: RuleRunner, found: Found) -> tuple[Shape, tuple[float, float, float]]:
    """Body of a thing, and the 5 %, 50 % and 95 % quantile of its mass [g]."""
    assert found.instance is not None
    sights = object_views.sights(found.instance)
    shape: Shape = runner.run("factorize.mesh", **sights)
    assert shape.pose is not None
    body = Body(links={"base": Link(mesh=shape.mesh, walls=shape.walls)}, pose=shape.pose, hollow=shape.hollow)
    placement = runner.run("align.object", body=body, support=found.support, **sights)
    told = {"body": body, "traits": found.instance.traits, "placement": placement, "support": found.support}
    link = runner.run("factorize.physics", **told).links["base"]
    return shape, (1000.0 * link.mass_low_kg, 1000.0 * link.mass_kg, 1000.0 * link.mass_high_kg)


def _sizes(shape: Shape) -> np.ndarray:
    """Height, and long and short side of the smallest upright box (3,) [mm]."""
    assert shape.pose is not None
    corners = transforms.apply(shape.pose.matrix, shape.mesh.vertices.astype(np.float64))
    long, short, height = boxes.upright_box(corners)[0]
    return 1000.0 * np.array([height, long, short])


def _names(told: list[Found]) -> None:
    print("| what it is | things | found | named so | named otherwise |\n|---|---|---|---|---|")
    for word in dict.fromkeys(one.word for one in told):
        own = [one for one in told if one.word == word]
        seen = [one.name for one in own if one.name]
        right = [name for name in seen if word in name.split("_")]
        other = ", ".join(name.replace("_", " ") for name in seen if name not in right) or "-"
        print(f"| {word} | {len(own)} | {len(seen)} | {len(right)} | {other} |")
    right_ones = sum(one.word in one.name.split("_") for one in told)
    print(f"\n{right_ones} of {sum(bool(one.name) for one in told)} found things have the right word")


def _bodies(runner: RuleRunner, told: list[Found]) -> None:
    lines, errors, held = [], [], []
    print(
        "| capture | thing | true height, width, depth [mm] | body [mm] | errors [mm] | family |\n" + "|---" * 6 + "|"
    )
    for one in told:
        known = KNOWN.get((one.capture, one.thing))
        if known is None or one.instance is None:
            continue
        shape, (low, middle, high) = fitted(runner, one)
        true, size, grams = np.array(known[1]), _sizes(shape), PUBLISHED_G[known[0]]
        errors.append(size - true)
        held.append(low <= grams <= high)
        columns = [" x ".join(f"{side:.0f}" for side in true), " x ".join(f"{side:.1f}" for side in size)]
        columns.append(", ".join(f"{side:+.1f}" for side in errors[-1]))
        print(f"| {one.capture} | {known[0]} | {' | '.join(columns)} | {shape.hypothesis} |", flush=True)
        lines.append(
            f"| {one.capture} | {known[0]} | {one.name.replace('_', ' ')} | {grams:g} | {middle:.0f} | "
            f"{low:.0f} to {high:.0f}, {high / low:.1f} | {'yes' if held[-1] else 'no'} |"
        )
    mean = ", ".join(f"{side:+.1f}" for side in np.mean(errors, axis=0))
    print(f"\nmean errors of height, width and depth: {mean} mm\n")
    print(
        "| capture | thing | named | published [g] | mass [g] | 90 % interval [g], factor | inside |\n"
        + "|---" * 7
        + "|"
    )
    print("\n".join(lines) + f"\n\n{sum(held)} of {len(held)} published masses in the interval")


def main() -> None:
    """The tables."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--names", action="store_true", help="names alone")
    options.add_argument("--outlined", action="store_true", help="take the masks that are outlined by hand")
    options.add_argument("--known", action="store_true", help="only photographs of things of known size")
    given = options.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        runner = RuleRunner(Path(folder))
        captures = dict.fromkeys(capture for capture, _ in KNOWN) if given.known else WORDS
        told = [one for capture in captures for one in things(runner, capture)]
        _names(told)
        if not given.names:
            print()
            # Of a thing alone in its photograph, the mask is its outline.
            _bodies(runner, [outlined(one) if given.outlined and one.instance else one for one in told])


if __name__ == "__main__":
    main()
