"""Attempts that are stored one by one, so that an interrupted build resumes after the finished ones."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

from dextera_build.artifacts.packed import pack, unpack
from dextera_build.artifacts.tasks.trials import Attempt
from dextera_build.rule import Context

Case = TypeVar("Case")


def resumed(ctx: Context, cases: Sequence[Case], make: Callable[[list[Case]], Iterator[Attempt]]) -> Iterator[Attempt]:
    """One attempt per case, in order; finished attempts of an interrupted call are read from disk.

    Args:
        ctx: Its `keep` holds a file per attempt.
        cases: Seeds of the starts, or other identifiers of the attempts.
        make: Makes attempts for cases, in order; each must be independent of the earlier ones.
    """
    folder = ctx.keep / "attempts"
    folder.mkdir(exist_ok=True)
    files = [folder / f"{number:05d}" for number in range(len(cases))]
    done = next((number for number, file in enumerate(files) if not file.exists()), len(files))
    if done:
        ctx.log(f"{done} attempts were made before the interruption")
    for file in files[:done]:
        yield unpack(Attempt, file.read_bytes())
    for attempt, file in zip(make(list(cases[done:])), files[done:], strict=True):
        fresh = file.with_suffix(".new")
        fresh.write_bytes(pack(attempt))
        os.replace(fresh, file)
        yield attempt
