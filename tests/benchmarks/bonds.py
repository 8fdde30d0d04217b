"""Learn from drawn rooms which patches are one object, and write rules/factorize/regions/bond_weights.py.

    python -m tests.benchmarks.bonds

The rooms of `quick_scenes` hold things of `household` alone: no mesh of a reported table is among them. Samples are
pairs of groups that touch: the patches as found, and groups that patches of one true object grow into, so that both
are known to the network. Each picture is measured by a depth camera drawn at random, in a light and at a scale of its
own. Limits of `grouping` are chosen on scenes of `benchmark/learn`.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import torch

from dextera_build.artifacts.cameras.camera import Photograph
from dextera_build.artifacts.cameras.image import Image
from dextera_build.sim.render.sensor import measure_depth
from rules.factorize.measured import Workspace, without_dropout
from rules.factorize.regions import heights, patches, proposals
from rules.factorize.regions.bonds import NAMES, USUAL, Bonds
from rules.factorize.regions.partition import FEWEST, Grouping
from tests.benchmarks import catalogue, quick_scenes

FILE = catalogue.REPO / "rules/factorize/regions/bond_weights.py"
PURE = 0.8
"""Part of a patch that one true object covers at least."""
HIDDEN, STEPS, BATCH = 32, 4000, 512
NOISE, DECAY = 0.2, 0.2
"""Noise on the standardised features, and weight decay."""
ROOMS = (*range(18), *range(40, 57))
"""Seeds of the rooms."""
PICTURES = 5
"""Scenes of each room, with one picture each."""
APART_WEIGHT = 3.0
"""Weight of pairs of two objects: joining them loses both, and parting one object leaves two halves."""


def main() -> None:
    """Draw, learn, write."""
    rows = np.concatenate([np.stack(found) for seed in ROOMS if (found := samples(seed))])
    mean, scale = rows[:, :-1].mean(axis=0), rows[:, :-1].std(axis=0) + 1e-2
    network = learn(np.clip((rows[:, :-1] - mean) / scale, -USUAL, USUAL), rows[:, -1])
    write(network, mean, scale, f"Learned from {len(rows)} pairs of groups in {len(ROOMS)} rooms of `quick_scenes`")


def samples(seed: int) -> list[np.ndarray]:
    """Rows (features + 1,) of one room: features, then 1 for pairs of one object and 0 for others."""
    rng, found = np.random.default_rng([11, seed]), []
    room = quick_scenes.room(rng)
    for _ in range(PICTURES):
        if things := quick_scenes.scene(rng, room.half):
            shot = quick_scenes.photograph(things, room, rng)
            found += list(pairs(measured(shot, rng), shot.labels, rng))
    return found


def pairs(seen: Workspace, labels: np.ndarray, rng: np.random.Generator) -> Iterator[np.ndarray]:
    """Rows of one picture with true labels (H, W)."""
    from scipy import ndimage

    relief = heights.relief(seen)
    raised = ndimage.binary_opening(relief.raised & relief.over, np.ones((3, 3), bool))
    if seen.turns or not raised.any():
        return
    crop = patches.surfaces(relief, raised, seen, proposals.colour_lab(seen.pixels))
    found = patches.patches(crop)
    true = _true(crop, found.shape, labels)
    owners = {number: _owner(true[found == number]) for number in range(1, int(found.max()) + 1)}
    yield from _grown(Grouping(crop, found.copy()), dict(owners), rng)


def measured(shot: quick_scenes.Shot, rng: np.random.Generator) -> Workspace:
    """The scene in another light, larger or smaller as a whole, measured by a depth camera drawn at random."""
    depth = measure_depth(shot.depth, shot.rgb, shot.camera.matrix(), quick_scenes.sensor(rng), rng)
    light = shot.rgb * rng.uniform(0.6, 1.5) * rng.uniform(0.85, 1.15, 3)
    exact = 255.0 * np.clip(light, 0.0, 1.0) ** rng.uniform(0.8, 1.25)
    pixels = np.clip(exact + rng.normal(0.0, rng.uniform(1.0, 4.0), exact.shape), 0, 255).astype(np.uint8)
    scale = 2 ** rng.uniform(-0.6, 0.6)
    matrix = shot.support.camera_pose.matrix.copy()
    matrix[:3, 3] *= scale
    pose = shot.support.camera_pose.model_copy(update={"matrix": matrix})
    larger = shot.support.model_copy(update={"camera_pose": pose, "polygon": shot.support.polygon * scale})
    lit = Photograph(rgb=Image(pixels=pixels), camera=shot.camera)
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
    assert isinstance(first, torch.nn.Linear)
    assert isinstance(second, torch.nn.Linear)
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
