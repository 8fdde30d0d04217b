"""capture.list: all captures in a folder, for benchmarks that run one recipe over many."""

from __future__ import annotations

import fnmatch

from dextera_build.artifacts.base import Collection, Folder
from dextera_build.errors import listing
from dextera_build.rule import Context, Options, rule


class ListOptions(Options):
    """Options of capture.list."""

    pattern: str = "*"
    """Glob pattern of sub-folder names, such as `clutter_*`."""


@rule(version=1)
def list(ctx: Context, folder: Folder, *, options: ListOptions) -> Collection[Folder]:
    """Return one folder per direct sub-folder that contains a `capture.json` and matches the pattern."""
    trees: dict[str, dict[str, bytes]] = {}
    for path in sorted(folder.files):
        name, _, rest = path.partition("/")
        if rest:
            trees.setdefault(name, {})[rest] = folder.files[path]
    captures = {name: files for name, files in trees.items() if "capture.json" in files}
    found = {
        name: Folder(files=files) for name, files in captures.items() if fnmatch.fnmatchcase(name, options.pattern)
    }
    if not found:
        ctx.fail(
            f"no capture matches `{options.pattern}`",
            captures=listing(captures),
            folders=listing(trees),
            hint="each capture is a sub-folder with a `capture.json`; option `pattern` chooses among them",
        )
    ctx.say(f"{len(found)} captures")
    return Collection[Folder](items=found)
