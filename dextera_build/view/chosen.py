"""The part of a twin's panel about the object that was clicked last: its facts, its name, and corrections."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

import numpy as np

from dextera_build.errors import DxbError
from dextera_build.view.figure import Fact
from dextera_build.view.photo import Comparison

ASKED = "Click a pixel of **{label}** that belongs to its first part, then one of its second part."


class Mending(Protocol):
    """Names and corrects the objects of a twin; an answer is a message about what was done.

    Raises:
        DxbError: It cannot be done.
    """

    @property
    def names(self) -> tuple[str, ...]:
        """The objects in the photograph."""

    def mask(self, name: str) -> np.ndarray:
        """The pixels (H, W) bool of an object."""

    def bind(self, label: str, name: str) -> str:
        """Give an object a name."""

    def merge(self, label: str, other: str) -> str:
        """Make two objects one."""

    def split(self, label: str, points: Sequence[tuple[int, int]]) -> str:
        """Make an object two, with column and row of a pixel of each part [px]."""

    def rebuild(self, say: Callable[[str], None]) -> str:
        """Build, saying what runs, and show the new scene, which removes this panel; answers nothing."""


class Chosen:
    """Tells and mends the object that was clicked last.

    Args:
        server: From `view.server.start`.
        facts: Label -> facts.
        mending: Names and corrects objects; None: only the facts are told.
    """

    def __init__(self, server: Any, facts: Mapping[str, Fact], mending: Mending | None) -> None:
        self.comparison: Comparison | None = None
        """The photograph, in which the parts of an object are clicked; without it, none can be split."""
        self._facts, self._mending = facts, mending
        self._label = ""
        self._busy = threading.Lock()
        self._words = server.gui.add_markdown("Click an object for its mass, material and friction.")
        if mending is not None:
            self._add(server.gui, mending)

    def choose(self, label: str) -> None:
        """Tell the facts of an object, and offer to mend it; the one that was chosen before may be merged into it."""
        before, self._label = self._label, label
        self._words.content = self._facts[label].long(label)
        mending = self._mending
        if mending is None:
            return
        self._name.value, self._name.visible, self._bind.visible = label, True, True
        others = [name for name in mending.names if name != label]
        known = label in mending.names
        self._other.visible = self._merge.visible = known and bool(others)
        self._split.visible = known and self.comparison is not None
        if others:
            self._other.options = tuple(others)
            self._other.value = before if before in others else others[0]

    def _add(self, gui: Any, mending: Mending) -> None:
        self._name = gui.add_text("Name", "", visible=False)
        self._bind = gui.add_button("Bind", visible=False, hint="Keep this name in dxb.lock, independent of parsing")
        names = mending.names or ("",)
        self._other = gui.add_dropdown("Merge with", names, visible=False, hint="The object that was clicked before")
        self._merge = gui.add_button("Merge", visible=False, hint="Both are one object: written into scene.yaml")
        text = "It is two objects: click a pixel of each in the photograph, written into scene.yaml"
        self._split = gui.add_button("Split", visible=False, hint=text)
        self._rebuild = gui.add_button("Rebuild", visible=False, hint="Build with the corrections, and show the scene")
        self._bind.on_click(lambda _: self._tell(lambda: mending.bind(self._label, self._name.value)))
        self._merge.on_click(lambda _: self._correct(lambda: mending.merge(self._label, self._other.value)))
        self._split.on_click(lambda event: self._ask(mending, event.client))
        self._rebuild.on_click(lambda _: self._tell(lambda: mending.rebuild(self._say)))

    def _ask(self, mending: Mending, client: Any) -> None:
        label = self._label
        if self.comparison is not None:
            self._say(ASKED.format(label=label))
            self.comparison.ask(
                client, mending.mask(label), 2, lambda found: self._correct(lambda: mending.split(label, found))
            )

    def _correct(self, correct: Callable[[], str]) -> None:
        if self._tell(correct):
            self._rebuild.visible = True

    def _tell(self, act: Callable[[], str]) -> bool:
        """Do what takes a while, and say what came of it; what is clicked in the meantime is refused."""
        if not self._busy.acquire(blocking=False):
            return False
        try:
            self._say("Working ...")
            if answer := act():
                self._say(answer)
        except DxbError as error:
            self._say(told(error))
            return False
        except Exception as error:
            self._say(f"This failed unexpectedly, and the terminal says more: {type(error).__name__}")
            raise
        finally:
            self._busy.release()
        return True

    def _say(self, text: str) -> None:
        self._words.content = text


def told(error: DxbError) -> str:
    """An error as a paragraph of the panel."""
    where = f" ({error.where})" if error.where else ""
    facts = "".join(f"\n* {name}: {value}" for name, value in error.facts.items())
    return "\n\n".join(filter(None, (f"**{error.code}** {error.message}{where}", facts.strip(), error.hint)))
