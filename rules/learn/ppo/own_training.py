"""The course of an own PPO training: its curve, its curriculum, and its state on disk for resuming."""

from __future__ import annotations

import math
import time
from collections import deque
from typing import TYPE_CHECKING

import numpy as np
import torch

from dextera_build import digest
from dextera_build.artifacts.tasks.policy import PolicyContract
from dextera_build.errors import RuleError
from dextera_build.learning import kept_state, weights
from dextera_build.rule import Context, Options
from dextera_build.sim.runtime.seeds import seed_of
from dextera_build.sim.training.tensors.worlds import TensorWorlds

from .own_ppo import Learner, Rollout
from .practised import Practised

if TYPE_CHECKING:
    from .ppo_options import PpoOptions

SAVE_EVERY_S = 30.0
"""Minimum interval between checkpoints, which are taken between rollouts [s]."""
WINDOW, LEAST = 100, 30
"""Number of episodes in moving averages, and the fewest in a step of the curriculum."""


class Training:
    """One training. All randomness of a rollout and its update comes from the seed and the decisions before it.

    Args:
        ctx: The rule's context.
        learner: The policy, and how it learns.
        worlds: Where.
        contract: The policy's contract.
        common: The rule's options.
        options: The backend's.
    """

    def __init__(
        self,
        ctx: Context,
        learner: Learner,
        worlds: TensorWorlds,
        contract: PolicyContract,
        common: PpoOptions,
        options: Options,
    ) -> None:
        self._ctx, self._learner, self._worlds, self._options = ctx, learner, worlds, common
        self._file = ctx.keep / "practice_on_tensors.safetensors"
        parts = [each.model_dump(mode="json") for each in (contract, common, options)]
        self._of = digest.of_value([*parts, worlds.device.type])
        self._recent: deque[tuple[float, bool]] = deque(maxlen=WINDOW)
        self._curve: list[tuple[int, float, float]] = []
        self._made = self._episodes = 0
        """Decisions so far, and episodes that ended."""
        self._level = 1
        self._average: dict[str, torch.Tensor] = {}
        self._saved = time.monotonic()

    def run(self) -> Practised:
        """Practise and learn until the decisions of the options are made."""
        options, learner = self._options, self._learner
        if not self._restore():
            self._from_share()
            learner.seen = self._worlds.reset()
        random = torch.Generator(self._worlds.device)
        while self._made < options.steps:
            random.manual_seed(seed_of(options.seed, "rollout", self._made))
            if not learner.settings.kl:
                learner.rate = options.rate * (1.0 - 0.9 * self._made / options.steps)
            rollout = learner.collect(random)
            loss = learner.update(rollout, random)
            self._made += options.rollout * options.worlds
            self._check(loss)
            self._note(rollout)
            self._follow()
            self._ctx.progress(min(self._made, options.steps), options.steps, self._what())
            self._widen()
            if time.monotonic() - self._saved >= SAVE_EVERY_S:
                self.save()
        return self._practised()

    @property
    def _share(self) -> float:
        return self._level / self._options.curriculum

    def _from_share(self) -> None:
        """Draw the starts from a part of the ranges; worlds are made with those of the whole."""
        if self._share != 1.0:
            self._worlds.widen(self._share)

    def _check(self, loss: float) -> None:
        self._worlds.check()
        if not math.isfinite(loss):
            raise RuleError(
                f"the training diverged before decision {self._made:,}",
                code="DXB-B513",
                facts={"loss": "not a number"},
                hint=f"rate: {self._options.rate * 0.3:g}",
            )

    def _note(self, rollout: Rollout) -> None:
        """Add the episodes that ended, and a point of the curve."""
        earned, success = rollout.earned.cpu().numpy(), rollout.success.cpu().numpy()
        over = ~np.isnan(earned)
        self._recent.extend(zip(earned[over].tolist(), success[over].tolist(), strict=True))
        self._episodes += int(over.sum())
        rewards, successes = self._latest()
        self._curve.append((self._made, rewards, successes))

    def _latest(self) -> tuple[float, float]:
        """Mean reward of the latest episodes, of the running ones if none ended; and the share that succeeded."""
        if not self._recent:
            return float(self._learner.earned.mean()), 0.0
        rewards, successes = zip(*self._recent, strict=True)
        return float(np.mean(rewards)), float(np.mean(successes))

    def _follow(self) -> None:
        """Move the average of the actor's weights towards their current values, once per update."""
        updates = self._made / (self._options.rollout * self._options.worlds)
        # The average is short at first; otherwise the initial weights would persist in it.
        keep = min(self._options.average, updates / (9.0 + updates))
        for name, tensor in self._learner.policy.plain().items():
            self._average[name] = keep * self._average.get(name, tensor) + (1.0 - keep) * tensor

    def _widen(self) -> None:
        """Take the next step of the curriculum once enough episodes of this one succeed."""
        done = [success for _, success in self._recent]
        if self._level < self._options.curriculum and len(done) >= LEAST and np.mean(done) >= self._options.passing:
            self._level += 1
            self._recent.clear()
            self._worlds.widen(self._share)
            self._ctx.log(f"starts within {100 * self._share:.0f} % of the ranges from decision {self._made:,}")

    def _what(self) -> str:
        rewards, successes = self._latest()
        return f"reward {rewards:.1f}, success {100 * successes:.0f} %"

    def _practised(self) -> Practised:
        steps, reward, success = (np.array(each) for each in zip(*self._curve, strict=True))
        data = weights.to_bytes({name: tensor.cpu().contiguous() for name, tensor in self._average.items()})
        reward, success = reward.astype(np.float32), success.astype(np.float32)
        return Practised(data, steps.astype(np.int64), reward, success, self._episodes, self._share)

    def save(self) -> None:
        """Write the state to one file atomically."""
        learner = self._learner
        tensors = {f"weight.{name}": tensor for name, tensor in learner.policy.state_dict().items()}
        tensors |= kept_state.moments(learner.optimiser)
        tensors |= {f"world.{name}": tensor for name, tensor in self._worlds.state.items()}
        tensors |= {f"average.{name}": tensor for name, tensor in self._average.items()}
        tensors |= {"seen": learner.seen, "earned": learner.earned}
        plain = {name: tensor.detach().as_subclass(torch.Tensor).cpu().clone() for name, tensor in tensors.items()}
        notes = {
            "of": self._of,
            "made": self._made,
            "rate": learner.rate,
            "level": self._level,
            "recent": list(self._recent),
            "curve": self._curve,
            "episodes": self._episodes,
        }
        self._saved = time.monotonic()
        try:
            kept_state.write(self._file, plain, notes)
        except OSError as error:
            self._ctx.log(f"the state of the training could not be kept: {error.strerror}")

    def _restore(self) -> bool:
        """Restore an interrupted training; whether there was one."""
        found = kept_state.read(self._file)
        if found is None or found[0].get("of") != self._of:
            return False
        notes, tensors = found
        self._ctx.log(f"resumes after decision {notes['made']:,}")
        learner = self._learner
        learner.policy.load_state_dict(kept_state.under(tensors, "weight."))
        kept_state.take_moments(learner.optimiser, tensors)
        learner.rate = notes["rate"]
        self._level, self._made, self._episodes = notes["level"], notes["made"], notes["episodes"]
        self._from_share()
        self._worlds.restore(kept_state.under(tensors, "world."))
        device = self._worlds.device
        learner.seen, learner.earned = (tensors[name].to(device) for name in ("seen", "earned"))
        self._average = {name: tensor.to(device) for name, tensor in kept_state.under(tensors, "average.").items()}
        self._recent.extend((reward, done) for reward, done in notes["recent"])
        self._curve = [(step, reward, success) for step, reward, success in notes["curve"]]
        return True
