"""Records the discovered inputs of one call."""

from __future__ import annotations

import posixpath
import threading
from collections.abc import Callable

from dextera_build import digest as digests
from dextera_build.errors import DxbError, RuleError
from dextera_build.store.traces.look import Look
from dextera_build.store.traces.steps import NONE, YES, Steps


class Recording:
    """Answers the questions of one call, each once, and keeps them in order.

    Args:
        look: Answers them.
    """

    def __init__(self, look: Look) -> None:
        self._look = look
        self._guard = threading.RLock()
        self.listings: dict[str, list[str]] = {}
        """Pattern -> what matched."""
        self._answers: dict[tuple[str, str], str] = {}
        self.error: DxbError | None = None
        """Why a question had no answer; such a call fails, even if it catches the error."""
        self.closed = False
        """Whether the call saved progress, which depends on what was read so far."""

    @property
    def steps(self) -> Steps:
        """Questions and answers."""
        return tuple((kind, name, answer) for (kind, name), answer in self._answers.items())

    @property
    def digest(self) -> str:
        """Digest of what was read so far."""
        return digests.of_value([list(step) for step in self.steps])

    def file(self, path: str) -> str:
        """Digest of the `File` at `path`.

        Raises:
            DxbError: There is none, it cannot be read, or it is not in the project.
        """
        name = posixpath.normpath(path)
        answer = self._ask("file", name, lambda: self._look.answer("file", name))
        if answer == NONE:
            raise self._fail(
                RuleError(
                    f"there is no file `{name}` in the project's folder",
                    code="DXB-B352",
                    hint=f"`ctx.exists({name!r})` checks first, `ctx.glob` lists files",
                )
            )
        return answer

    def exists(self, path: str) -> bool:
        """Whether there is a file or folder at `path`."""
        name = posixpath.normpath(path)
        return self._ask("there", name, lambda: self._look.answer("there", name)) == YES

    def names(self, pattern: str) -> list[str]:
        """Files that match a pattern, sorted."""
        name = posixpath.normpath(pattern)

        def listed() -> str:
            self.listings[name] = self._look.names(name)
            return digests.of_value(self.listings[name])

        self._ask("names", name, listed)
        return list(self.listings[name])

    def _ask(self, kind: str, name: str, answer: Callable[[], str]) -> str:
        with self._guard:
            if (kind, name) in self._answers:
                return self._answers[kind, name]
            if self.closed:
                raise self._fail(_late(name))
            try:
                told = answer()
            except DxbError as error:
                raise self._fail(error) from None
            self._answers[kind, name] = told
            return told

    def _fail(self, error: DxbError) -> DxbError:
        self.error = self.error or error
        return error


def _late(name: str) -> RuleError:
    return RuleError(
        f"`{name}` is read after `ctx.keep` was used",
        code="DXB-B353",
        hint="read files first: saved progress may depend only on files read before",
    )
