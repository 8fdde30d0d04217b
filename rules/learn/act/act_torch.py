"""learn.act with torch on one core."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from dextera_build import digest
from dextera_build.learning import reproducible, weights
from dextera_build.learning.sampling import Mixed
from dextera_build.learning.training_state import Kept, restore, save
from dextera_build.rule import Backend, Context, Options

from . import network
from .trained import Trained

if TYPE_CHECKING:
    from dextera_build.learning.demonstrations import Demonstrations

    from .act_options import ActOptions

BACKEND = Backend(
    summary="torch on one core, deterministic; resumes after an interruption",
    profiles=("cpu",),
    packages=("torch", "safetensors"),
    extra="learn",
)

SAVE_EVERY_S = 20.0
"""Interval between checkpoints of the training state [s]."""
WARM_UP = 100
"""Steps of linear warm-up of the learning rate."""
POINTS = 100
"""Number of points of the loss curve."""
MEASURED = 512
"""Maximum number of held-out samples per error measurement."""


def train(ctx: Context, data: Demonstrations, common: ActOptions, options: Options) -> Trained:
    """Train, or resume an interrupted training."""
    with reproducible.one_thread():
        return Training(ctx, data, common).run()


class Training:
    """One training: network, optimiser, measurements.

    Randomness depends only on seed and step, so resuming needs no generator state.
    """

    def __init__(self, ctx: Context, data: Demonstrations, options: ActOptions) -> None:
        self._ctx, self._data, self._options = ctx, data, options
        self._network = network.of_contract(data.contract, options.seed)
        self._optimiser = torch.optim.AdamW(
            self._network.parameters(), lr=options.rate, weight_decay=options.decay, fused=True
        )
        self._inputs = {name: torch.from_numpy(field) for name, field in data.inputs.items()}
        self._actions, self._last = torch.from_numpy(data.actions), torch.from_numpy(data.last)
        self._places = torch.from_numpy(data.places) if data.places is not None else None
        sizes = [len(rows) for rows in data.train_rows]
        batch = min(options.batch, sizes[0]) if len(sizes) == 1 else options.batch
        self._mixed = Mixed(sizes, data.weights, batch, options.seed)
        self._kept = Kept(digest.of_value([data.contract.model_dump(mode="json"), options.model_dump(mode="json")]))
        self._stride = max(1, options.steps // POINTS)

    def run(self) -> Trained:
        """Run all remaining steps and return the result."""
        kept, file = self._kept, self._ctx.keep / "training.safetensors"
        if restore(file, kept, self._network, self._optimiser):
            self._ctx.log(f"resumes after step {kept.step:,}")
            for _ in range(kept.step):
                self._mixed.draw()
        saved = time.monotonic()
        while kept.step < self._options.steps:
            kept.sum += self._step(kept.step)
            kept.step += 1
            self._measure()
            if time.monotonic() - saved >= SAVE_EVERY_S:
                self._save(file)
                saved = time.monotonic()
            self._ctx.progress(kept.step, self._options.steps, self._what())
        return self._result()

    def _save(self, file: Path) -> None:
        try:
            save(file, self._kept, self._network, self._optimiser)
        except OSError as error:  # a full disk must not abort the training
            self._ctx.log(f"the state of the training could not be kept: {error.strerror or error}")

    def _step(self, step: int) -> float:
        options = self._options
        random = torch.Generator().manual_seed(options.seed * 1_000_003 + step)
        drawn = zip(self._data.train_rows, self._mixed.draw(), strict=True)
        rows = torch.from_numpy(np.concatenate([part[chosen] for part, chosen in drawn]))
        batch = self._samples(rows)
        inputs = dict(batch.inputs)
        if options.jitter:
            for name in self._inputs:
                inputs[name] = inputs[name] + options.jitter * torch.randn(inputs[name].shape, generator=random)
        if "rgb" in inputs and options.shift:
            inputs["rgb"] = shifted(inputs["rgb"], options.shift, random)
        noise = torch.randn(len(rows), options.latent, generator=random)
        loss, error = network.loss_of(self._network, replace(batch, inputs=inputs), noise, options.kl_weight)
        self._optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(self._network.parameters(), 1.0)
        self._optimiser.param_groups[0]["lr"] = rate_at(step, options.steps, options.rate)
        self._optimiser.step()
        return float(error.detach())

    def _samples(self, rows: Tensor) -> network.Batch:
        ahead = rows[:, None] + torch.arange(self._options.chunk)
        last = self._last[rows][:, None]
        inputs = {name: field[rows] for name, field in self._inputs.items()}
        if self._data.frames is not None:
            inputs["rgb"] = network.pixels(torch.from_numpy(self._data.frames.at(rows.numpy())))
        places = self._places[rows] if self._places is not None else None
        return network.Batch(inputs, self._actions[torch.minimum(ahead, last)], ahead <= last, places)

    def _measure(self) -> None:
        kept = self._kept
        if kept.step % self._stride and kept.step != self._options.steps:
            return
        count = kept.step - (kept.steps[-1] if kept.steps else 0)
        kept.steps.append(kept.step)
        kept.curve.append(kept.sum / count)
        if not math.isfinite(kept.sum):
            rate = self._options.rate
            self._ctx.fail(f"the training diverged before step {kept.step:,}", rate=rate, hint=f"rate: {rate / 3:.0e}")
        kept.sum = 0.0
        if len(kept.steps) % 10 == 0 or kept.step == self._options.steps:
            self._measure_held_out()

    def _measure_held_out(self) -> None:
        rows = self._data.held_out_rows
        if not len(rows):
            return
        rows = rows[:: -(-len(rows) // MEASURED)]
        total = np.zeros(2)
        scale = torch.tensor(self._data.contract.action.scale)
        self._network.eval()
        with torch.inference_mode():
            for first in range(0, len(rows), 64):
                batch = self._samples(torch.from_numpy(rows[first : first + 64]))
                keep = batch.keep
                error = (self._network(batch.inputs) - batch.actions).abs() * keep[:, :, None]
                parts = error.sum(), (error * scale).sum()
                total += np.array([float(part) for part in parts]) / float(keep.sum() * error.shape[2]) * len(keep)
        self._network.train()
        self._kept.held_steps.append(self._kept.step)
        self._kept.held_curve.append(float(total[0] / len(rows)))
        self._kept.error_rad = float(total[1] / len(rows))
        self._ctx.log(
            f"step {self._kept.step:,}: loss {self._kept.curve[-1]:.4f}, held out {self._kept.held_curve[-1]:.4f}"
            f" ({self._kept.error_rad * 1000:.1f} mrad)"
        )

    def _what(self) -> str:
        kept = self._kept
        return f"loss {kept.curve[-1]:.3f}" if kept.curve else "first steps"

    def _result(self) -> Trained:
        kept = self._kept
        return Trained(
            weights=weights.to_bytes(self._network.state_dict()),
            steps=np.array(kept.steps, np.int64),
            curve=np.array(kept.curve, np.float32),
            held_out=(np.array(kept.held_steps, np.int64), np.array(kept.held_curve, np.float32)),
            error_rad=kept.error_rad,
        )


def rate_at(step: int, steps: int, highest: float) -> float:
    """Learning rate: rising over `WARM_UP` steps, then cosine decay to 0."""
    rise = min(1.0, (step + 1) / WARM_UP)
    return highest * rise * 0.5 * (1 + math.cos(math.pi * step / steps))


def shifted(pixels: Tensor, most: int, random: torch.Generator) -> Tensor:
    """Shift each of (B, 3, H, W) images by up to `most` pixels, repeating its border."""
    height, width = pixels.shape[2:]
    wide = F.pad(pixels, (most,) * 4, mode="replicate")
    offsets = torch.randint(0, 2 * most + 1, (len(pixels), 2), generator=random).tolist()
    moved = [one[:, y : y + height, x : x + width] for one, (y, x) in zip(wide, offsets, strict=True)]
    return torch.stack(moved)
