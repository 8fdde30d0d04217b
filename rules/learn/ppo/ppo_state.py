"""Monitor a PPO training: its curve, and its state on disk for resuming."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback

from dextera_build import digest
from dextera_build.artifacts.tasks.policy import PolicyContract
from dextera_build.learning import kept_state, weights
from dextera_build.rule import Context
from dextera_build.sim.runtime.seeds import seed_of
from dextera_build.sim.training.practice import Place

from .ppo_worlds import Worlds
from .practised import Practised

if TYPE_CHECKING:
    from .ppo_options import PpoOptions

SAVE_EVERY_S = 30.0
"""Minimum interval between checkpoints, which are taken between rollouts [s]."""
WINDOW = 100
"""Number of episodes in moving averages."""
LEAST = 30
"""Minimum number of episodes in a step of the curriculum."""


class Watch(BaseCallback):
    """Callback for stable-baselines3.

    All randomness of a rollout and the following update is derived from the seed and the number of previous decisions,
    and an environment's state from its decisions since the start of the episode. So neither generator nor simulator
    states are saved, and a resumed training is bit-identical to an uninterrupted one.

    Args:
        ctx: The rule's context.
        worlds: The environments.
        contract: The policy's contract.
        options: The rule's options.
    """

    def __init__(self, ctx: Context, worlds: Worlds, contract: PolicyContract, options: PpoOptions) -> None:
        super().__init__()
        self._ctx, self._worlds, self._options = ctx, worlds, options
        self._file = ctx.keep / "practice.safetensors"
        self._of = digest.of_value([contract.model_dump(mode="json"), options.model_dump(mode="json")])
        self._earned = np.zeros(options.worlds)
        self._recent: deque[tuple[float, bool]] = deque(maxlen=WINDOW)
        self._curve: list[tuple[int, float, float]] = []
        self._episodes = 0
        self._level = 1
        """Steps of the curriculum that were taken."""
        self._saved = time.monotonic()
        self._average: dict[str, torch.Tensor] = {}
        self._averaged = -1

    @property
    def _share(self) -> float:
        """Fraction of the task's ranges from which starts are drawn."""
        return self._level / self._options.curriculum

    def _widen(self) -> None:
        """Take the next step of the curriculum once enough episodes of this one succeed."""
        done = [success for _, success in self._recent]
        if self._level < self._options.curriculum and len(done) >= LEAST and np.mean(done) >= self._options.passing:
            self._level += 1
            self._recent.clear()
            self._worlds.practices.share = self._share
            self._ctx.log(f"starts within {100 * self._share:.0f} % of the ranges from decision {self.num_timesteps:,}")

    def _on_rollout_start(self) -> None:
        self._tell()
        self._note()
        self._widen()
        self._follow()
        if time.monotonic() - self._saved >= SAVE_EVERY_S:
            self.save()
        random = seed_of(self._options.seed, "rollout", self.model.num_timesteps)
        torch.manual_seed(random)
        np.random.seed(random % 2**32)  # stable-baselines3 draws its batches from it

    def _on_step(self) -> bool:
        self._earned += self.locals["rewards"]
        for number in np.flatnonzero(self.locals["dones"]):
            self._recent.append((float(self._earned[number]), bool(self.locals["infos"][number]["is_success"])))
            self._earned[number] = 0.0
            self._episodes += 1
        self._ctx.progress(min(self.model.num_timesteps, self._options.steps), self._options.steps, self._what())
        return True

    def _on_training_end(self) -> None:
        if not self._recent:
            self._recent.append((float(self._earned.mean()), False))
        self._tell()
        self._note()
        self._follow()

    def practised(self) -> Practised:
        """The result; its weights are the running average, which performs better than those after the last update."""
        data = weights.to_bytes(self._average)
        steps, reward, success = zip(*self._curve, strict=True) if self._curve else ((), (), ())
        return Practised(
            data,
            np.array(steps, np.int64),
            np.array(reward, np.float32),
            np.array(success, np.float32),
            self._episodes,
            self._share,
        )

    def save(self) -> None:
        """Write the state to one file atomically."""
        model: Any = self.model
        tensors = {f"weight.{name}": tensor for name, tensor in model.policy.state_dict().items()}
        tensors |= kept_state.moments(model.policy.optimizer)
        places = self._worlds.practices.places
        for number, place in enumerate(places):
            tensors[f"place.{number}"] = torch.from_numpy(np.array(place.decisions, np.float32))
        tensors |= {f"average.{name}": tensor for name, tensor in self._average.items()}
        notes = {
            "of": self._of,
            "decisions": model.num_timesteps,
            "episode": [place.episode for place in places],
            "share": [place.share for place in places],
            "level": self._level,
            "first": [bool(first) for first in model._last_episode_starts],
            "earned": self._earned.tolist(),
            "recent": list(self._recent),
            "curve": self._curve,
            "episodes": self._episodes,
        }
        self._saved = time.monotonic()
        try:
            kept_state.write(self._file, tensors, notes)
        except OSError as error:
            self._ctx.log(f"the state of the training could not be kept: {error.strerror}")

    def restore(self, model: PPO) -> None:
        """Restore `model` and the environments from an interrupted training, or reset them."""
        found = kept_state.read(self._file)
        if found is None or found[0].get("of") != self._of:
            self._worlds.practices.share = self._share
            model._last_obs = self._worlds.reset()
            model._last_episode_starts = np.ones(self._options.worlds, bool)
            return
        notes, tensors = found
        self._ctx.log(f"resumes after decision {notes['decisions']:,}")
        model.policy.load_state_dict(kept_state.under(tensors, "weight."))
        kept_state.take_moments(model.policy.optimizer, tensors)
        model.num_timesteps = notes["decisions"]
        made = [tuple(tensors[f"place.{number}"].numpy()) for number in range(self._options.worlds)]
        places = [Place(*each) for each in zip(notes["episode"], notes["share"], made, strict=True)]
        self._level = notes["level"]
        self._worlds.practices.share = self._share
        model._last_obs = self._worlds.practices.go_to(places)
        model._last_episode_starts = np.array(notes["first"])
        self._earned = np.array(notes["earned"])
        self._recent.extend((reward, done) for reward, done in notes["recent"])
        self._curve = [(step, reward, success) for step, reward, success in notes["curve"]]
        self._episodes = notes["episodes"]
        self._average = kept_state.under(tensors, "average.")
        self._averaged = notes["decisions"]

    def _follow(self) -> None:
        """Move the average of the actor's weights towards their current values, once per update."""
        if self._averaged == self.model.num_timesteps:
            return
        self._averaged = self.model.num_timesteps
        # The average is short at first; otherwise the initial weights would persist in it.
        updates = self._averaged / (self._options.rollout * self._options.worlds)
        keep = min(self._options.average, updates / (9.0 + updates))
        for name, tensor in actor_tensors(self.model.policy).items():
            old = self._average.get(name, tensor)
            self._average[name] = (keep * old + (1.0 - keep) * tensor).clone()

    def _note(self) -> None:
        """Add a point to the curve, once per rollout."""
        step = self.model.num_timesteps
        if self._recent and (not self._curve or self._curve[-1][0] < step):
            rewards, successes = zip(*self._recent, strict=True)
            self._curve.append((step, float(np.mean(rewards)), float(np.mean(successes))))

    def _tell(self) -> None:
        """Log the starts that were replaced since the last call."""
        replaced = self._worlds.practices.replaced
        for world, episode in sorted(replaced):
            self._ctx.log(
                f"world {world}, episode {episode}: no start was found with its seed, a later one replaces it"
            )
        replaced.clear()

    def _what(self) -> str:
        if not self._recent:
            return "first episodes"
        rewards, successes = zip(*self._recent, strict=True)
        return f"reward {np.mean(rewards):.1f}, success {100 * np.mean(successes):.0f} %"


def actor_tensors(policy: Any) -> dict[str, torch.Tensor]:
    """The actor of a policy, with the names of `network.Actor`."""
    tensors = {f"body.{name}": tensor for name, tensor in policy.mlp_extractor.actor.state_dict().items()}
    return tensors | {f"head.{name}": tensor for name, tensor in policy.action_net.state_dict().items()}


@contextmanager
def own_generators(seed: int) -> Iterator[None]:
    """Seed the global generators of torch and NumPy within the block and restore them afterwards."""
    kept = torch.get_rng_state(), np.random.get_state()
    torch.manual_seed(seed)
    np.random.seed(seed % 2**32)
    try:
        yield
    finally:
        torch.set_rng_state(kept[0])
        np.random.set_state(kept[1])
