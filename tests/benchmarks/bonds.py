"""Learn from drawn scenes which patches are one object, and write rules/factorize/regions/bond_weights.py.

    make meshes
    python -m tests.benchmarks.bonds --first 1000 --scenes 54 --held-out 18

The network learns from scenes of `benchmark/learn`, which hold the meshes of `benchmark/objects_learn` alone; the pairs
that are reported come from scenes of `benchmark/stage_one`, which hold the other meshes. Scenes are drawn by index;
those of the tables begin at 0. Samples are pairs of groups that touch: the patches as found, and groups that patches
of one true object grow into, so that both are known to the network. Each scene is measured by several depth cameras,
in several lights and at several scales, so that it knows more than one.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch

from dextera_build.api import Project
from dextera_build.artifacts.cameras.camera import Capture
from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.objects.object import Support
from dextera_build.artifacts.robots.noise import DepthNoise
from dextera_build.artifacts.scenes.scene import Truth
from dextera_build.sim.render.sensor import measure_depth
from rules.factorize.measured import Workspace, without_dropout
from rules.factorize.regions import heights, patches, proposals
from rules.factorize.regions.bonds import NAMES, USUAL, Bonds
from rules.factorize.regions.partition import FEWEST, Grouping
from tests.benchmarks import catalogue

FILE = catalogue.REPO / "rules/factorize/regions/bond_weights.py"
PURE = 0.8
"""Part of a patch that one true object covers at least."""
HIDDEN, STEPS, BATCH = 16, 4000, 512
NOISE, DECAY = 0.3, 0.3
"""Noise on the standardised features and weight decay; with less of both, held-out pairs were told apart worse."""
SENSORS = 4
"""Variants of each scene; the first is the photograph as drawn."""
APART_WEIGHT = 3.0
"""Weight of pairs of two objects: joining them loses both, and parting one object leaves two halves."""


def main() -> None:
    """Draw, learn, write."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--meshes", type=Path, default=catalogue.FOLDER, help="what `make meshes` wrote")
    options.add_argument("--first", type=int, default=1000, help="index of the first scene")
    options.add_argument("--scenes", type=int, default=54, help="number of scenes to learn from")
    options.add_argument("--held-out", type=int, default=18, help="number of scenes of other meshes to report")
    given = options.parse_args()
    train = np.concatenate(list(scenes("benchmark/learn", given.meshes, given.first, given.scenes)))
    test = np.concatenate(list(scenes("benchmark/stage_one", given.meshes, given.first, given.held_out)))
    mean, scale = train[:, :-1].mean(axis=0), train[:, :-1].std(axis=0) + 1e-2
    network = learn(np.clip((train[:, :-1] - mean) / scale, -USUAL, USUAL), train[:, -1])
    with torch.no_grad():
        usual = np.clip((test[:, :-1] - mean) / scale, -USUAL, USUAL)
        odds = network(torch.tensor(usual, dtype=torch.float32))[:, 0].numpy()
    told = {"one object": test[:, -1] > 0, "two objects": test[:, -1] == 0}
    right = {name: float(((odds > 0) == (name == "one object"))[rows].mean()) for name, rows in told.items()}
    facts = ", ".join(f"{share:.3f} of {int(told[name].sum())} pairs of {name}" for name, share in right.items())
    learned = f"Learned from {given.scenes} scenes of `benchmark/learn`, from index {given.first}"
    write(network, mean, scale, f"{learned}.\nOf other meshes, {given.held_out} scenes: right on {facts}")
    print(facts)


def scenes(recipe: str, meshes: Path, first: int, count: int) -> Iterator[np.ndarray]:
    """Rows (N, features + 1) of each scene: features, then 1 for pairs of one object and 0 for others."""
    project = Project.find(catalogue.REPO)
    settings = {"draws.scenes": count, "draws.first": first, "draws.views": 1}
    labels = [f"scene[{number:04d}_0]" for number in range(first, first + count)]
    wanted = [f"{label}.{node}" for label in labels for node in ("photo", "truth", "twin/support")]
    built = project.build(recipe, *wanted, inputs={"meshes": meshes}, settings=settings, keep_going=True)
    for label in labels:
        support = built.nodes.get(f"{label}.twin/support")
        if support is None or support.output is None:
            continue
        photo, truth, plane = (built.artifact(f"{label}.{node}") for node in ("photo", "truth", "twin/support"))
        assert isinstance(photo, Capture)
        assert isinstance(truth, Truth)
        assert isinstance(plane, Support)
        rows = [row for variant in range(SENSORS) for row in samples(photo, truth, plane, variant, int(label[6:10]))]
        if rows:
            yield np.stack(rows)


def samples(photo: Capture, truth: Truth, support: Support, variant: int, index: int) -> list[np.ndarray]:
    """Rows of one scene, measured by another sensor if `variant` is not 0."""
    from scipy import ndimage

    rng = np.random.default_rng([index, variant])
    seen = varied(photo, truth, support, rng) if variant else _as_drawn(photo, support)
    if seen.turns:
        return []
    relief = heights.relief(seen)
    raised = ndimage.binary_opening(relief.raised & relief.over, np.ones((3, 3), bool))
    if not raised.any():
        return []
    crop = patches.surfaces(relief, raised, seen, proposals.colour_lab(seen.pixels))
    labels = patches.patches(crop)
    true = _true(crop, labels.shape, truth.labels.labels)
    owners = {number: _owner(true[labels == number]) for number in range(1, int(labels.max()) + 1)}
    return list(_grown(Grouping(crop, labels.copy()), dict(owners), rng))


def _as_drawn(photo: Capture, support: Support) -> Workspace:
    assert photo.measured is not None
    return Workspace(photo.photograph, without_dropout(photo.measured.depth.depth), support)


def varied(photo: Capture, truth: Truth, support: Support, rng: np.random.Generator) -> Workspace:
    """The scene in another light, larger or smaller as a whole, measured by a depth camera drawn at random."""
    photograph = photo.photograph
    options = DepthNoise(
        subpixel_px=0.05 * 2 ** rng.uniform(-1.5, 1.5),
        correlation_px=int(rng.integers(1, 6)),
        edge_px=int(rng.integers(1, 4)),
        edge_loss=rng.uniform(0.1, 0.95),
        smear=rng.uniform(0.0, 1.0),
        dark_loss=rng.uniform(0.0, 0.7),
        shine_loss=rng.uniform(0.0, 0.8),
        step_m=float(rng.choice([0.0001, 0.001, 0.002])),
        dropout=float(rng.choice([0.002, 0.05])),
    )
    true = truth.depth.depth.astype(np.float64)
    depth = measure_depth(true, truth.rgb.pixels / 255.0, photograph.camera.matrix(), options, rng)
    light = photograph.rgb.pixels / 255.0 * rng.uniform(0.6, 1.5) * rng.uniform(0.85, 1.15, 3)
    pixels = (255.0 * np.clip(light, 0.0, 1.0) ** rng.uniform(0.8, 1.25)).astype(np.uint8)
    scale = 2 ** rng.uniform(-0.6, 0.6)
    matrix = support.camera_pose.matrix.copy()
    matrix[:3, 3] *= scale
    pose = support.camera_pose.model_copy(update={"matrix": matrix})
    larger = support.model_copy(update={"camera_pose": pose, "polygon": support.polygon * scale})
    lit = photograph.model_copy(update={"rgb": Image(pixels=pixels)})
    return Workspace(lit, without_dropout((depth * scale).astype(np.float32)), larger)


def _true(crop: patches.Surfaces, shape: tuple[int, ...], labels: np.ndarray) -> np.ndarray:
    """True labels of the crop's blocks, (h, w)."""
    rows = np.minimum(crop.top + np.arange(shape[0]) * crop.stride + crop.stride // 2, labels.shape[0] - 1)
    columns = np.minimum(crop.left + np.arange(shape[1]) * crop.stride + crop.stride // 2, labels.shape[1] - 1)
    return np.asarray(labels[np.ix_(rows, columns)])


def _owner(true: np.ndarray) -> int | None:
    """The label that covers a patch, 0 for a fixture; None if it is mixed."""
    values, counts = np.unique(true, return_counts=True)
    best = int(counts.argmax())
    return int(values[best]) if counts[best] >= PURE * counts.sum() else None


def _grown(parts: Grouping, owners: dict[int, int | None], rng: np.random.Generator) -> Iterator[np.ndarray]:
    """Samples of the patches, then of groups after each of a few rounds of right joins."""
    bonds = Bonds(parts.surfaces)
    for _ in range(4):
        right = []
        for (a, b), contact in parts.contacts.items():
            one, other = owners.get(a), owners.get(b)
            if one is None or other is None or one == other == 0 or contact.pairs < FEWEST:
                continue
            yield np.append(bonds.features(parts.groups[a], parts.groups[b], contact), float(one == other))
            if one == other:
                right.append((a, b))
        rng.shuffle(right)
        for a, b in right[: max(1, len(right) // 2)]:
            if (a, b) in parts.contacts:
                parts.join(a, b)


def learn(features: np.ndarray, same: np.ndarray) -> torch.nn.Sequential:
    """A network of one hidden layer that gives the log odds of `same` (N,) from features (N, F) of unit variance."""
    torch.manual_seed(0)
    torch.set_num_threads(1)
    network = torch.nn.Sequential(
        torch.nn.Linear(features.shape[1], HIDDEN), torch.nn.Tanh(), torch.nn.Linear(HIDDEN, 1)
    )
    x, y = torch.tensor(features, dtype=torch.float32), torch.tensor(same, dtype=torch.float32)
    optimizer = torch.optim.AdamW(network.parameters(), lr=3e-3, weight_decay=DECAY)
    rate = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, STEPS)
    for _ in range(STEPS):
        batch = torch.randint(0, len(x), (BATCH,))
        odds = network(x[batch] + NOISE * torch.randn_like(x[batch]))[:, 0]
        weight = torch.where(y[batch] > 0, 1.0, APART_WEIGHT)
        loss = torch.nn.functional.binary_cross_entropy_with_logits(odds, y[batch], weight=weight)
        optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        optimizer.step()
        rate.step()
    return network


def write(network: torch.nn.Sequential, mean: np.ndarray, scale: np.ndarray, facts: str) -> None:
    """Write the weights as Python, so that they are part of the rule's code."""
    first, second = network[0], network[2]
    assert len(mean) == len(NAMES)
    values: dict[str, np.ndarray] = {
        "MEAN": mean,
        "SCALE": scale,
        "FIRST": first.weight.detach().numpy().T,
        "FIRST_BIAS": first.bias.detach().numpy(),
        "SECOND": second.weight.detach().numpy()[0],
        "SECOND_BIAS": second.bias.detach().numpy(),
    }
    FILE.write_text(module(values, facts))


def module(values: dict[str, np.ndarray], facts: str) -> str:
    """Python source of the weights; numbers are text, which formatters leave in rows."""
    told = f"Weights of `bonds.Bonds`, written by `python -m tests.benchmarks.bonds`.\n\n{facts}.\n"
    parts = [f'"""{told}"""\n\n# ruff: noqa: SIM905\nimport numpy as np\n']
    for name, value in values.items():
        numbers = [f"{number:.3f}" for number in np.ravel(value)]
        rows = "\n".join(" ".join(numbers[start : start + 16]) for start in range(0, len(numbers), 16))
        shape = f".reshape({value.shape[0]}, {value.shape[1]})" if np.ndim(value) == 2 else ""
        parts.append(f'{name} = np.array(\n    """\n{rows}\n""".split(),\n    np.float64,\n){shape}\n')
    return "\n".join(parts)


if __name__ == "__main__":
    main()
