"""The episode that `dxb run` replays, and as which `dxb robot simulate` begins."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from dextera_build.cli import built, options

if TYPE_CHECKING:
    from dextera_build.artifacts.tasks.episode import Episode
    from dextera_build.artifacts.tasks.task import TaskBundle


def number_argument(parser: argparse.ArgumentParser) -> None:
    """Add the argument that chooses one episode of several."""
    parser.add_argument(
        "--episode",
        type=options.number("--episode", 0, 10**9),
        default=0,
        metavar="N",
        help="number of the episode in its set, from 0 on (0)",
    )


def chosen(args: argparse.Namespace, target: str, bundle: TaskBundle) -> Episode:
    """An episode of a node that was built.

    Raises:
        UsageError: The node has no episodes, or fewer.
        RuleError: They are of another task or robot.
    """
    from dextera_build.artifacts.tasks.episode import Episodes
    from dextera_build.errors import UsageError
    from dextera_build.policy.contract import check_data

    found = built.artifact(args, target, Episodes)
    check_data(bundle, found)
    every = found.in_order()
    if not 0 <= args.episode < len(every):
        raise UsageError(
            f"`{target}` has no episode {args.episode}",
            code="DXB-U355",
            facts={"episodes": len(every)},
            hint=f"`--episode N`, 0 to {len(every) - 1}" if every else None,
        )
    return every[int(args.episode)][1]
