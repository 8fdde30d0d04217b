"""Training of imitation learning: one loop for all algorithms, deterministic and resumable."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import torch
from torch import Tensor, nn
from torch.optim.swa_utils import AveragedModel

from dextera_build import digest
from dextera_build.learning import reproducible, weights
from dextera_build.learning.augmentation import augmented, ranged, swapped
from dextera_build.learning.compiling import compiled
from dextera_build.learning.samples import Batch, Samples, Window
from dextera_build.learning.sampling import Mixed
from dextera_build.learning.snapshots import Snapshots
from dextera_build.learning.trained import Trained
from dextera_build.learning.training_state import Kept, restore, save
from dextera_build.policy.cameras import camera_of
from dextera_build.policy.layout import WORLD
from dextera_build.rule import Context
from dextera_build.rule.pretrained import out_of_memory

if TYPE_CHECKING:
    from dextera_build.learning.demonstrations import Demonstrations
    from dextera_build.learning.options import ImitationOptions

SAVE_EVERY_S = 20.0
"""Interval between checkpoints of the training state [s]."""
POINTS = 100
"""Number of points of the loss curve."""
MEASURED = 512
"""Maximum number of held-out samples per error measurement."""


class Learner(Protocol):
    """What an algorithm adds to the loop."""

    @property
    def network(self) -> nn.Module:
        """Its initial weights depend only on the seed."""
        ...

    @property
    def window(self) -> Window:
        """The steps of a sample."""
        ...

    @property
    def betas(self) -> tuple[float, float]:
        """Decay of the moments of AdamW."""
        ...

    def loss(self, network: Any, batch: Batch, random: torch.Generator) -> tuple[Tensor, Tensor]:
        """(loss to minimise, loss for the curve); `random`, on the CPU, is the only source of noise."""
        ...

    def predicted(self, network: Any, batch: Batch) -> Tensor:
        """The actions (B, C, A) that the policy would take at run time, for the error of held-out episodes."""
        ...


def train(ctx: Context, data: Demonstrations, options: ImitationOptions, learner: Learner) -> Trained:
    """Train, or resume an interrupted training, on the device of the call."""
    with reproducible.one_thread():
        return Training(ctx, data, options, learner).run()


class Training:
    """One training: network, optimiser, measurements.

    Randomness depends only on seed and step, so resuming needs no generator state.
    """

    def __init__(self, ctx: Context, data: Demonstrations, options: ImitationOptions, learner: Learner) -> None:
        self._ctx, self._data, self._options, self._learner = ctx, data, options, learner
        self._network = learner.network.to(ctx.device)
        self._optimiser = torch.optim.AdamW(
            self._network.parameters(), lr=options.rate, betas=learner.betas, weight_decay=options.decay, fused=True
        )
        self._average = averaged(self._network, options.average) if options.average else None
        self._samples = Samples(data, learner.window, ctx.device)
        sizes = [len(rows) for rows in data.train_rows]
        batch = min(options.batch, sizes[0]) if len(sizes) == 1 else options.batch
        self._mixed = Mixed(sizes, data.weights, batch, options.seed)
        self._kept = Kept(digest.of_value([data.contract.model_dump(mode="json"), options.model_dump(mode="json")]))
        self._stride = max(1, options.steps // POINTS)
        self._snapshots = Snapshots(ctx, self._kept.of, options.snapshot_every)

    def run(self) -> Trained:
        """Run all remaining steps and return the result."""
        with compiled(self._network, self._ctx.scratch) if self._options.compiled else nullcontext():
            self._train()
        return self._result()

    def _train(self) -> None:
        kept, file = self._kept, self._ctx.keep / "training.safetensors"
        if restore(file, kept, self._network, self._optimiser, self._average, usable=self._snapshots.read):
            self._ctx.log(f"resumes after step {kept.step:,}")
            for _ in range(kept.step):
                self._mixed.draw()
        saved = time.monotonic()
        while kept.step < self._options.steps:
            kept.sum += self._tried(kept.step)
            kept.step += 1
            self._measure()
            if self._snapshots.due(kept.step, self._options.steps):
                self._snapshots.add(kept.step, self._weights())
            if time.monotonic() - saved >= SAVE_EVERY_S:
                self._save(file)
                saved = time.monotonic()
            self._ctx.progress(kept.step, self._options.steps, self._what())

    @property
    def _best(self) -> nn.Module:
        """The network whose weights are the result."""
        return self._average.module if self._average else self._network

    def _weights(self) -> bytes:
        return weights.to_bytes({name: tensor.cpu() for name, tensor in self._best.state_dict().items()})

    def _save(self, file: Path) -> None:
        try:
            save(file, self._kept, self._network, self._optimiser, self._average)
        except OSError as error:  # a full disk must not abort the training
            self._ctx.log(f"the state of the training could not be kept: {error.strerror or error}")

    def _tried(self, step: int) -> float:
        try:
            return self._step(step)
        except (MemoryError, RuntimeError) as error:
            told = out_of_memory(error, self._ctx.device)
            if told is None or self._options.batch == 1:
                raise
            told.hint = f"`batch: {self._options.batch // 2}`, or {told.hint}"
            raise told from error

    def _step(self, step: int) -> float:
        options = self._options
        random = torch.Generator().manual_seed(options.seed * 1_000_003 + step)
        drawn = zip(self._data.train_rows, self._mixed.draw(), strict=True)
        rows = np.concatenate([part[chosen] for part, chosen in drawn])
        batch, kept = self._samples.at(rows), self._samples.foreground(rows) if options.swap else {}
        batch = replace(batch, inputs=self._augmented(batch.inputs, kept, random))
        with torch.autocast(torch.device(self._ctx.device).type, torch.bfloat16, enabled=options.bf16):
            loss, shown = self._learner.loss(self._network, batch, random)
        self._optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(self._network.parameters(), 1.0)
        self._optimiser.param_groups[0]["lr"] = rate_at(step, options)
        self._optimiser.step()
        if self._average:
            self._average.update_parameters(self._network)
        return float(shown.detach())

    def _augmented(
        self, inputs: Mapping[str, Tensor], kept: Mapping[str, Tensor], random: torch.Generator
    ) -> dict[str, Tensor]:
        options, changed = self._options, dict(inputs)
        if options.jitter:
            for name in (each for each in self._samples.inputs if each != WORLD):  # a flag is no measurement
                noise = torch.randn(changed[name].shape, generator=random).to(changed[name].device)
                changed[name] = changed[name] + options.jitter * noise
        for channel in self._data.contract.seen:
            frames = changed[channel.name]
            flat = frames.flatten(0, -4)
            if channel.name in kept:
                behind = torch.from_numpy(self._data.sight[camera_of(channel.name)].behind)
                flat = swapped(flat, kept[channel.name], behind, options.swap, len(frames), random)
            if channel.encoding == "picture":
                flat = augmented(flat, options, random)
            else:
                flat = ranged(flat, 1 if channel.encoding == "depth" else 3, options, random)
            changed[channel.name] = flat.view(frames.shape)
        return changed

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
        scale = torch.tensor(self._data.contract.action.scale, device=self._ctx.device)
        self._best.eval()
        with torch.inference_mode():
            for first in range(0, len(rows), 64):
                batch = self._samples.at(rows[first : first + 64])
                keep = batch.keep
                error = (self._learner.predicted(self._best, batch) - batch.actions).abs() * keep[:, :, None]
                parts = error.sum(), (error * scale).sum()
                total += np.array([float(part) for part in parts]) / float(keep.sum() * error.shape[2]) * len(keep)
        self._best.train()
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
            weights=self._weights(),
            steps=np.array(kept.steps, np.int64),
            curve=np.array(kept.curve, np.float32),
            held_out=(np.array(kept.held_steps, np.int64), np.array(kept.held_curve, np.float32)),
            error_rad=kept.error_rad,
            snapshots=self._snapshots.found(kept.step),
        )


def rate_at(step: int, options: ImitationOptions) -> float:
    """Learning rate: linear warm-up, then cosine decay to 0."""
    rise = min(1.0, (step + 1) / options.warm_up)
    return options.rate * rise * 0.5 * (1 + math.cos(math.pi * step / options.steps))


def averaged(network: nn.Module, most: float) -> AveragedModel:
    """The exponential moving average of the weights of a network, with a decay that rises from 0 to `most`.

    The decay after n updates is 1 - (1 + n)^-0.75 (Chi et al. 2023, with their power), so that an average of few
    steps does not remember the initial weights.
    """

    def mean(average: Tensor, current: Tensor, count: Tensor | int) -> Tensor:
        decay = min(most, 1 - (1 + int(count)) ** -0.75)
        return average.lerp(current, 1 - decay)

    return AveragedModel(network, avg_fn=mean, use_buffers=True)
