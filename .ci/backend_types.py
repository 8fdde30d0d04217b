"""Print a module in which mypy compares backends with the `Protocol` of their rule, and `policy.py` with `Runner`.

Rules and backends are found, so that a new one is compared without being listed anywhere.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from dextera_build.code.companions import beside
from dextera_build.code.loader import Library, RuleFile


def module(found: RuleFile, file: Path) -> str:
    """Import name of a file beside a rule, from the root of the checkout."""
    return ".".join(("rules", *file.relative_to(found.root.path).with_suffix("").parts))


def compared() -> Iterator[tuple[str, str, str]]:
    """(module of the protocol, its name, module that must match it)."""
    for found in Library().rules():
        if protocol := found.rule.protocol:
            shared = protocol.__module__.startswith("dextera_build.")  # that of several rules
            place = protocol.__module__ if shared else module(found, found.file)
            for backend in found.backends.values():
                yield place, protocol.__name__, module(found, backend.file)
        policy = beside(found, "policy")
        if policy.file.is_file():
            yield "dextera_build.policy.running", "Runner", module(found, policy.file)


def main() -> None:
    """Print the module."""
    rows = sorted(set(compared()))
    for name in sorted({name for row in rows for name in (row[0], row[2])}):
        print(f"import {name}")
    for number, (place, protocol, name) in enumerate(rows):
        print(f"_{number}: {place}.{protocol} = {name}")


if __name__ == "__main__":
    main()
