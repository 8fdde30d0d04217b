"""The network, and how it is trained: several processes share each step, and end with the same weights."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import torch
from torch import distributed, nn
from torch.nn import functional

from rules.factorize.regions.affinities import COARSE, OFFSETS, PLANES

WIDTHS = (24, 48, 96, 128)
"""Channels at a half, a fourth, an eighth and a sixteenth of the picture's size."""
LAYERS = (2, 2, 3, 3)
"""Convolutions on the way down, and on the way up (the last but one first)."""
UP = (1, 2, 2)
STEPS, BATCH, RATE, DECAY = 1100, 4, 4e-3, 1e-2
"""Steps, pictures of each process in a step, largest learning rate, weight decay."""
CROP = (176, 224)
"""Height and width of what is cut out of a picture [px]."""
UNKNOWN = 255
"""Label of pixels outside the picture."""
APART, FIXTURE, OBJECT = 3.0, 0.25, 0.3
"""Weights of pairs of two objects, of an object and a fixture, and of what says which pixels are objects."""
NORMALS_X = 7
"""The plane that changes its sign in a mirror."""


def _block(channels: int, wider: int, step: int = 1) -> nn.Sequential:
    layer = nn.Conv2d(channels, wider, 3, step, 1, bias=False)
    return nn.Sequential(layer, nn.BatchNorm2d(wider), nn.ReLU(inplace=True))


class Network(nn.Module):
    """Down to a sixteenth of the size and up to a half of it; what has the same size is added.

    Lin, Dollar, Girshick, He, Hariharan, Belongie: Feature pyramid networks for object detection, CVPR 2017.
    """

    def __init__(self, planes: int = PLANES, widths: tuple[int, ...] = WIDTHS) -> None:
        super().__init__()
        self.planes = planes
        sizes = (planes, *widths)
        self.down = nn.ModuleList(
            nn.Sequential(_block(before, own, 2), *(_block(own, own) for _ in range(count - 1)))
            for before, own, count in zip(sizes[:-1], widths, LAYERS, strict=True)
        )
        pairs = list(zip(widths[::-1][:-1], widths[::-1][1:], strict=True))
        self.narrow = nn.ModuleList(nn.Conv2d(wide, own, 1) for wide, own in pairs)
        self.up = nn.ModuleList(
            nn.Sequential(*(_block(own, own) for _ in range(count))) for (_, own), count in zip(pairs, UP, strict=True)
        )
        self.last = nn.Conv2d(widths[0], len(OFFSETS) + 1, 1)

    def forward(self, picture: torch.Tensor) -> torch.Tensor:
        """Log odds (N, len(OFFSETS) + 1, h / 2, w / 2) of pictures (N, planes, h, w); the last: an object is here."""
        sizes = [picture]
        for stage in self.down:
            sizes.append(stage(sizes[-1]))
        found = sizes.pop()
        for narrow, stage in zip(self.narrow, self.up, strict=True):
            found = stage(sizes.pop() + functional.interpolate(narrow(found), scale_factor=2.0, mode="nearest"))
        return self.last(found)  # type: ignore[no-any-return]


@dataclass(frozen=True)
class Pictures:
    """What is learned from."""

    seen: np.ndarray  # (N, PLANES, h, w) int8, 60 per unit
    labels: np.ndarray  # (N, h / 2, w / 2) uint8 at the pixels of the answer, 0 for fixtures

    def cut(self, number: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """A picture with other colours, mirrored at random, larger or smaller, around one of its objects."""
        seen, labels = self.seen[number].astype(np.float32) / UNIT, self.labels[number].astype(np.uint8)
        if rng.uniform() < 0.5:
            # The answer's pixel is the second one of both that it covers.
            seen, labels = np.roll(seen[:, :, ::-1], 1, axis=2), labels[:, ::-1].copy()
            seen[NORMALS_X] *= -1.0
        seen, labels = _placed(seen, labels, rng)
        lightness = (seen[0] + 1.0) * 50.0 * rng.uniform(0.8, 1.2) + rng.normal(0.0, 5.0)
        seen[0] = np.clip(lightness, 0.0, 100.0) / 50.0 - 1.0 + rng.normal(0.0, rng.uniform(0.0, 0.04), seen[0].shape)
        turn = rng.uniform(0.0, 2.0 * np.pi) if rng.uniform() < 0.5 else rng.normal(0.0, 0.2)
        gain = rng.uniform(0.5, 1.4)
        a, b = gain * np.cos(turn), gain * np.sin(turn)
        seen[1], seen[2] = a * seen[1] - b * seen[2], b * seen[1] + a * seen[2]
        seen[1:3] += rng.normal(0.0, 0.03, (2, 1, 1))
        return seen, labels


UNIT = 60.0
"""Steps of `Pictures.seen` per unit."""


def _placed(seen: np.ndarray, labels: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    height, width = seen.shape[1:]
    scale = rng.uniform(0.8, 1.4)
    rows, columns = np.nonzero(labels)
    pick = int(rng.integers(len(rows))) if len(rows) else -1
    middle = np.array([columns[pick], rows[pick]]) * COARSE if pick >= 0 else np.array([width, height]) / 2
    middle = middle + rng.uniform([-70, -50], [70, 50])
    spare = np.array([CROP[1] - scale * width, CROP[0] - scale * height])
    shift = np.clip(np.array([CROP[1], CROP[0]]) / 2 - scale * middle, np.minimum(spare, 0), np.maximum(spare, 0))
    move = np.array([[scale, 0.0, shift[0]], [0.0, scale, shift[1]]], np.float32)
    size = (CROP[1], CROP[0])
    planes = [cv2.warpAffine(plane, move, size, flags=cv2.INTER_NEAREST) for plane in seen]
    move[:, 2] = move[:, 2] / COARSE + (scale - 1.0) / 2
    half = (CROP[1] // COARSE, CROP[0] // COARSE)
    moved = cv2.warpAffine(labels, move, half, flags=cv2.INTER_NEAREST, borderValue=UNKNOWN)  # type: ignore[call-overload]
    return np.stack(planes), moved


def loss(odds: torch.Tensor, labels: torch.Tensor) -> torch.Tensor:
    """Mean over the outputs (N, C, h, w) of the weighted cross entropy with labels (N, h, w)."""
    true, weight = torch.zeros_like(odds), torch.zeros_like(odds)
    height, width = labels.shape[1:]
    for number, (down, right) in enumerate(OFFSETS):
        rows, columns = slice(0, height - down), slice(max(0, -right), width - max(0, right))
        one = labels[:, rows, columns]
        other = labels[:, down:, max(0, right) : width + min(0, right)]
        both, any_ = (one > 0) & (other > 0), (one > 0) | (other > 0)
        same = both & (one == other)
        known = (one != UNKNOWN) & (other != UNKNOWN)
        pair = torch.where(both, torch.where(same, 1.0, APART), FIXTURE * any_)
        true[:, number, rows, columns], weight[:, number, rows, columns] = same.float(), pair * known
    true[:, -1], weight[:, -1] = (labels > 0).float(), OBJECT * (labels != UNKNOWN)
    each = functional.binary_cross_entropy_with_logits(odds, true, reduction="none") * weight
    return (each.sum((0, 2, 3)) / (weight.sum((0, 2, 3)) + 1.0)).mean()


def train(rank: int, processes: int, pictures: Pictures, file: Path, steps: int = STEPS) -> None:
    """One of the processes that train together; the first one saves the weights."""
    os.environ.setdefault("MASTER_ADDR", "127.0.0.1")
    os.environ.setdefault("MASTER_PORT", "29641")
    distributed.init_process_group("gloo", rank=rank, world_size=processes)
    torch.manual_seed(0)
    torch.set_num_threads(1)
    rng = np.random.default_rng(rank)
    network = Network().to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    optimizer = torch.optim.AdamW(network.parameters(), RATE, weight_decay=DECAY)
    rate = torch.optim.lr_scheduler.OneCycleLR(optimizer, RATE, steps, pct_start=0.1)
    for step in range(steps):
        cuts = [pictures.cut(int(rng.integers(len(pictures.seen))), rng) for _ in range(BATCH)]
        seen, labels = (torch.from_numpy(np.stack(each)) for each in zip(*cuts, strict=True))
        with torch.autocast("cpu", torch.bfloat16):
            odds = network(seen.to(memory_format=torch.channels_last))
        error = loss(odds.float(), labels.long())
        optimizer.zero_grad()
        error.backward()  # type: ignore[no-untyped-call]
        _average(network, processes)
        optimizer.step()
        rate.step()
        if rank == 0 and step % 20 == 0:
            print(f"{step} of {steps}: {error.item():.3f}", flush=True)
    if rank == 0:
        torch.save(network.state_dict(), file)
    distributed.barrier()
    distributed.destroy_process_group()


def _average(network: Network, processes: int) -> None:
    gradients = [weight.grad for weight in network.parameters() if weight.grad is not None]
    whole = torch.cat([gradient.flatten() for gradient in gradients])
    distributed.all_reduce(whole)
    for gradient, mean in zip(gradients, whole.split([g.numel() for g in gradients]), strict=True):
        gradient.copy_((mean / processes).view_as(gradient))
