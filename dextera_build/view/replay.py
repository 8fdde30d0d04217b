"""Recorded episodes in the viewer: their states move the bodies; nothing is simulated."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from dextera_build.artifacts.tasks.episode import Episode, Episodes
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.sim.render.filming import Replica
from dextera_build.view.figure import Figure, about, look_from
from dextera_build.view.switches import switches
from dextera_build.view.task import SPEEDS, facts_of_task
from dextera_build.view.transport import Transport


class ReplayView:
    """Shows one episode at a time.

    Args:
        server: From `view.server.start`.
        name: Scene node of the whole.
        bundle: The task of the episodes.
        episodes: Replayed episodes, successes before failures.
        materials: Root body -> row of the material table, where known.

    Raises:
        RuleError: The episodes belong to another model.
    """

    def __init__(
        self, server: Any, name: str, bundle: TaskBundle, episodes: Episodes, materials: Mapping[str, str]
    ) -> None:
        self._server, self.rate_hz = server, episodes.rate_hz
        self._replica = Replica(bundle, episodes)
        facts = facts_of_task(bundle, self._replica.model, materials)
        self.figure = Figure(server, name, self._replica.model, self._replica.data, facts)
        self.episodes = titles(episodes)
        """Title -> episode."""
        self.transport = Transport(1.0 / episodes.rate_hz, self.forward, self.show)
        look_from(server, self._replica.data.xpos[1:])
        server.gui.add_markdown(f"**{episodes.task}** · {len(episodes.items)} episodes, {bundle.kind}")
        self._controls()
        switches(server, self.figure)
        about(server, self.figure, facts)
        self.choose(next(iter(self.episodes), ""))

    def choose(self, title: str) -> None:
        """Show an episode from its start."""
        if title not in self.episodes:
            return
        with self.transport.lock:
            self.episode = self.episodes[title]
            positions = self._replica.positions(self.episode)
            # An episode without steps still has a start.
            self.positions = positions if len(positions) else self.episode.start.qpos[None]
            self.figure.resize(self.episode.start.size_scale)
            self.at, self._slider.max = 0, self.duration_s
            self.show()

    @property
    def duration_s(self) -> float:
        """Time from the first to the last state [s]."""
        return max(len(self.positions) - 1, 1) / self.rate_hz

    def forward(self) -> bool:
        """The next state; after the last one comes the first if it loops. False at the end."""
        last = len(self.positions) - 1
        if self.at >= last and self._loop.value:
            self.at = 0
            return True
        self.at = min(self.at + 1, last)
        return self.at < last or bool(self._loop.value)

    def show(self) -> None:
        """Move the bodies to the present state."""
        self._replica.show(self.positions[self.at])
        self.figure.update(self._replica.data)
        self._slider.value = self.at / self.rate_hz
        self._status.content = self.words()

    def recording(self) -> Iterator[float]:
        """Go through the episode from its start; each item is the time that the state before it lasts [s]."""
        for at in range(1, len(self.positions)):
            yield 1.0 / self.rate_hz
            self.at = at
            self.show()

    def words(self) -> str:
        """Time, segment and forces at the present state, and the verdict."""
        episode = self.episode
        parts = [f"t = {self.at / self.rate_hz:.2f} s"]
        parts += [each.name for each in episode.segments if each.first <= self.at < each.last]
        if len(episode.contact):
            force = np.linalg.norm(episode.contact[min(self.at, len(episode.contact) - 1)], axis=-1).max(initial=0.0)
            parts.append(f"largest fingertip force {force:.1f} N")
        parts.append("success" if episode.success else f"failed: {episode.reason}")
        return " · ".join(parts)

    def _seek(self) -> None:
        # While it plays, the slider shows the time and calls back, too: under the lock both are of one step.
        with self.transport.lock:
            at = round(self._slider.value * self.rate_hz)
            if at != self.at:
                self.at = min(max(at, 0), len(self.positions) - 1)
                self.show()

    def _controls(self) -> None:
        gui = self._server.gui
        with gui.add_folder("Replay"):
            chosen = gui.add_dropdown("Episode", tuple(self.episodes) or ("none",))
            self._status = gui.add_markdown("")
            self._slider = gui.add_slider("Time [s]", min=0.0, max=1.0, step=1.0 / self.rate_hz, initial_value=0.0)
            play = gui.add_button_group("Motion", ("Play", "Pause", "Step"))
            speed = gui.add_dropdown("Speed", SPEEDS, initial_value="1")
            self._loop = gui.add_checkbox("Loop", initial_value=False)
        chosen.on_update(lambda _: self.choose(chosen.value))
        self._slider.on_update(lambda _: self._seek())
        moves = {"Play": self._play, "Pause": self.transport.pause, "Step": self.transport.step}
        play.on_click(lambda _: moves[play.value]())
        speed.on_update(lambda _: setattr(self.transport, "speed", float(speed.value)))

    def _play(self) -> None:
        if self.at >= len(self.positions) - 1:
            self.at = 0
        self.transport.play()


def titles(episodes: Episodes) -> dict[str, Episode]:
    """Title -> episode: those that count in order, then the failures, `17 · failed: dropped`."""
    failed = sorted(episodes.failures.items(), key=lambda item: (len(item[0]), item[0]))
    return {
        f"{index} · {'success' if episode.success else f'failed: {episode.reason}'}": episode
        for index, episode in [*episodes.in_order(), *failed]
    }


def is_asked(index: str, asked: str) -> bool:
    """Whether `asked` names the episode `index`; `17` names `00017`."""
    return index == asked or (index.isdecimal() and asked.isdecimal() and int(index) == int(asked))
