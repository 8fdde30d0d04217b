"""A result that is one text: printed, or written where `--out` says."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from dextera_build.errors import UsageError
from dextera_build.project.project import Project


def give(project: Project, text: str, out: str | None) -> int:
    """Print `text`, or write it to `out` and print the path; the exit code.

    Raises:
        UsageError: The file cannot be written.
    """
    if out is None:
        print(text)
        return 0
    path = Path(out)
    with writing(path):
        path.write_text(text + "\n", encoding="utf-8")
    print(project.shown(path.absolute()))
    return 0


@contextmanager
def writing(path: Path, hint: str | None = None) -> Iterator[None]:
    """Say well what goes wrong while `path` is written.

    Raises:
        UsageError: The file cannot be written.
    """
    try:
        yield
    except OSError as error:
        place = error.filename or path
        raise UsageError(f"`{place}` cannot be written: {error.strerror}", code="DXB-U177", hint=hint) from None
