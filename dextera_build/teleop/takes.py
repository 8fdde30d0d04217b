"""Takes of a live session, and the recording that holds them."""

from __future__ import annotations

import io
from pathlib import Path
from typing import NamedTuple

import numpy as np

from dextera_build.artifacts.robots.hand_stream import LOST, HandStream, Take, Workplace
from dextera_build.errors import StoreError
from dextera_build.formats import hand_stream
from dextera_build.sim.experts.live_operator import TICKS_HZ, Message
from dextera_build.sim.retarget.motion import BASE
from dextera_build.store import files

BETWEEN_S = 1
"""Time between two takes in the recording [s]; the real time between them is not kept."""


class Kept(NamedTuple):
    """A take that did the task."""

    seed: int
    """Seed of its start."""
    rows: list[tuple[int, Message]]
    """Its messages, and their times in ticks."""
    lengths_m: np.ndarray
    """(2, 5) lengths of the operator's fingers, left and right [m]."""
    sides: list[int]
    """Hands that drove the robot; the clutch of others is open in the recording."""


class Takes:
    """Takes in order, written anew after every change: the file always holds whole takes.

    Args:
        path: The recording, an `.mcap` file.
        synthetic: Whether a program moves the hands.
        workplace: The task and its robot; None: not stated.
    """

    def __init__(self, path: Path, *, synthetic: bool, workplace: Workplace | None = None) -> None:
        self.path, self._synthetic, self._workplace = path, synthetic, workplace
        self.device = "not known"
        """What the operator holds or wears."""
        self.kept: list[Kept] = []
        self.unsaved = ""
        """Why the file lacks the last change; empty if it does not. The takes stay in memory."""

    def add(self, take: Kept) -> None:
        """Keep a take and write the recording."""
        self.kept.append(take)
        self.save()

    def undo(self) -> Kept | None:
        """Drop the last take and write the recording; None if there is none."""
        if not self.kept:
            return None
        last = self.kept.pop()
        self.save()
        return last

    def save(self) -> None:
        """Write the recording in one piece, or remove it if no take is left; a failure is told in `unsaved`."""
        try:
            if self.kept:
                data = io.BytesIO()
                hand_stream.write(self.stream(), data)
                files.write(str(self.path), data.getvalue(), 0o644)
            else:
                self.path.unlink(missing_ok=True)
            self.unsaved = ""
        except StoreError as error:
            self.unsaved = str(error.facts.get("system says", error.message))
        except OSError as error:
            self.unsaved = error.strerror or str(error)

    def stream(self) -> HandStream:
        """All takes as one recording, each with its messages only."""
        ticks: list[int] = []
        rows: list[Message] = []
        clutches: list[np.ndarray] = []
        takes: list[Take] = []
        for kept in self.kept:
            begin = ticks[-1] + BETWEEN_S * TICKS_HZ if ticks else 0
            ticks += [begin + tick for tick, _ in kept.rows]
            rows += [message for _, message in kept.rows]
            drives = np.isin([0, 1], kept.sides)
            clutches += [message.clutch & drives for _, message in kept.rows]
            lengths = tuple(tuple(row) if np.isfinite(row).all() else None for row in kept.lengths_m.tolist())
            first = takes[-1].last if takes else 0
            takes.append(Take(first=first, last=len(rows), seed=kept.seed, finger_lengths_m=lengths))
        heads = np.array([row.head for row in rows])
        return HandStream(
            frame=BASE,
            device=self.device,
            synthetic=self._synthetic,
            workplace=self._workplace,
            stamps=np.array(ticks, np.float64) / TICKS_HZ,
            positions=np.array([row.positions for row in rows]),
            rotations=np.array([row.rotations for row in rows]),
            tracking=np.array([row.tracking for row in rows]),
            head=heads if np.isfinite(heads).all(axis=1).any() else None,
            pinch=np.array([row.pinch for row in rows]),
            clutch=np.array(clutches),
            takes=tuple(takes),
        )


def seen(kept: Kept) -> list[int]:
    """Hands of a take that were seen at some time."""
    states = np.array([message.tracking for _, message in kept.rows])
    return [hand for hand in kept.sides if (states[:, hand] > LOST).any()]
