"""Print what things in drawn photographs are called beside what they are.

    make meshes
    python -m tests.benchmarks.drawn_names                          # third-party meshes that the tables report
    python -m tests.benchmarks.drawn_names --recipe objects_learn   # the half on which limits are chosen
    python -m tests.benchmarks.drawn_names --recipe household       # procedural things

Things stand, lie, touch, hide and carry one another in random rooms, and each picture has a depth camera of its own. A
thing counts if a proposal of `factorize.parse` has a mask IoU of at least .5 with it.
"""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dextera_build.artifacts.cameras.camera import Photograph
from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.robots.noise import ColourNoise
from dextera_build.artifacts.scenes.world import Thing
from dextera_build.sim.render.sensor import measure_colour, measure_depth
from dextera_build.testing import RuleRunner
from rules.benchmark.instances import overlaps
from rules.factorize.elements import naming
from rules.factorize.measured import Workspace, without_dropout
from rules.factorize.regions.heights import Relief
from rules.factorize.regions.proposals import Proposal, colour_lab, scenery
from tests.benchmarks import catalogue, household, quick_scenes, sizes

WORDS = {
    "box": "butter cereal chocolate_pudding cookies cream_cheese cubelarge cubemedium gelatin_box macaroni_and_cheese "
    "milk_carton popcorn scanned_wood_block",
    "can": "alphabet_soup can tomato_sauce",
    "bottle": "bbq_sauce glass_bottle ketchup salad_dressing waterbottle wine_bottle",
    "drill": "scanned_power_drill",
    "bowl": "akita_black_bowl black_bowl bowl glazed_rim_porcelain_ramekin red_ramekin white_bowl",
    "mug": "coffeemug libero_mug porcelain_mug red_coffee_mug scanned_mug white_yellow_mug cup",
}
"""Word -> meshes that it fits, by eye; no word fits the others."""
OWN = {"carton": "box", "book": "box", "tray": "bowl", "plate": "bowl"}
"""The same of families of `household` whose name is another word."""
JUDGED = ("box", "can", "tin", "bottle", "drill")
"""Words that are counted where they are wrong."""


@dataclass(frozen=True)
class Named:
    """A thing that was found."""

    word: str
    """What it is."""
    called: str
    """What it is called."""


def called(word: str) -> str:
    """The word for a mesh or a family; its own name if none fits."""
    return next((name for name, meshes in WORDS.items() if word in meshes.split()), OWN.get(word, word))


def pieces(recipe: str, meshes: Path) -> Callable[[np.random.Generator], household.Piece]:
    """How to draw a thing of a recipe's meshes; of `household` if the recipe is called so."""
    if recipe == "household":
        return household.draw
    with tempfile.TemporaryDirectory() as folder:
        things = list(sizes.things(recipe, meshes, RuleRunner(Path(folder))).items())
    known = {word for names in WORDS.values() for word in names.split()}
    # Things with a word are drawn twice as often.
    weights = np.array([2.0 if name in known else 1.0 for name, _ in things])

    def draw(rng: np.random.Generator) -> household.Piece:
        return _piece(*things[int(rng.choice(len(things), p=weights / weights.sum()))])

    return draw


def _piece(name: str, thing: Thing) -> household.Piece:
    parts = tuple(part.mesh for part in thing.parts.values())
    points = np.concatenate([part.vertices for part in parts])
    level = called(name) in ("box", "can")
    return household.Piece(parts, top=float(points[:, 2].max()) if level else None, word=name)


def seen(
    draw: Callable[[np.random.Generator], household.Piece], seed: int, pictures: int
) -> Iterator[tuple[Relief, np.ndarray, np.ndarray, tuple[Proposal, ...], list[str]]]:
    """Relief, colours (H, W, 3), position (3,) of the camera, proposals, and the word of each; of one room."""
    rng = np.random.default_rng([43, seed])
    room = quick_scenes.room(rng)
    for _ in range(pictures):
        things = quick_scenes.named_scene(rng, room.half, draw)
        if not things:
            continue
        shot = quick_scenes.photograph([parts for _, parts in things], room, rng)
        pixels = measure_colour(shot.rgb, ColourNoise(), rng)
        depth = measure_depth(shot.depth, shot.rgb, shot.camera.matrix(), quick_scenes.sensor(rng), rng)
        photograph = Photograph(rgb=Image(pixels=pixels), camera=shot.camera)
        space = Workspace(photograph, without_dropout(depth.astype(np.float32)), shot.support).upright()
        if space.turns:
            continue
        found = scenery(space)
        matrix = overlaps(shot.labels, list(range(1, len(things) + 1)), found.labels, len(found.objects))
        owners = matrix.argmax(axis=0) if matrix.size else np.zeros(0, int)
        words = [things[n][0] if matrix[n, i] >= 0.5 else "" for i, n in enumerate(owners)]
        yield found.relief, colour_lab(space.pixels), space.world_from_camera[:3, 3], found.objects, words


def main() -> None:
    """One row per word, and how often a word is wrong."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--recipe", default=catalogue.REPORTED, help="objects, objects_learn or household")
    options.add_argument("--meshes", type=Path, default=catalogue.FOLDER, help="what `make meshes` wrote")
    options.add_argument("--first", type=int, default=0, help="first room")
    options.add_argument("--rooms", type=int, default=10)
    options.add_argument("--pictures", type=int, default=4, help="photographs of each")
    given = options.parse_args()
    draw, told = pieces(given.recipe, given.meshes), list[Named]()
    for seed in range(given.first, given.first + given.rooms):
        for relief, lab, eye, proposals, words in seen(draw, seed, given.pictures):
            for element, word in zip(naming.elements(proposals, relief, lab, eye), words, strict=True):
                if word and element.category != "room":
                    told.append(Named(called(word), element.phrase.split()[-1]))
    print("| what it is | things | named so | named otherwise |\n|---|---|---|---|")
    for word in sorted({one.word for one in told} & set(JUDGED) | {"bowl", "mug"}):
        own = Counter(one.called for one in told if one.word == word)
        other = ", ".join(f"{name} ({count})" for name, count in own.most_common() if name != word) or "-"
        print(f"| {word} | {own.total()} | {own[word]} | {other} |")
    for word in JUDGED:
        wrong = Counter(one.word for one in told if one.called == word and one.word != word)
        print(f"{word} for something else: {dict(wrong)}")


if __name__ == "__main__":
    main()
