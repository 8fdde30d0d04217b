"""The policy of `dxb run`: a node that was built, or a server of `dxb serve` on another machine."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from dextera_build.cli import built, options

if TYPE_CHECKING:
    from dextera_build.cli.robot.connected import Connected
    from dextera_build.policy.added import AddedTerm
    from dextera_build.policy.running import Policy

    Found = tuple[Policy, str, tuple[AddedTerm, ...]]

SOCKETS = ("ws://", "wss://")
"""Beginnings of addresses whose servers state what their policies take."""
FIRST_S = 120.0
"""Time limit of a server's first answer [s], in which it may compile a network; the robot does not move yet."""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that state the policy."""
    parser.add_argument(
        "--policy",
        metavar="RECIPE:NODE",
        required=True,
        help="a policy that was built, also one of learn.served, or the address of `dxb serve`, ws://HOST:PORT",
    )
    parser.add_argument(
        "--api-key", metavar="VARIABLE", help="environment variable that holds the key of the policy's server"
    )


def policy(args: argparse.Namespace, here: Connected) -> Found:
    """The policy, ready to run, the digest of its checkpoint, and the terms of its inputs that do not come with dxb.

    Raises:
        UsageError: It is no policy, or another program than `dxb serve` answers.
        MachineError: Nothing answers at the address.
        RuleError: It does not fit the task.
    """
    if args.policy.startswith(SOCKETS):
        return _asked(args, here)
    return _loaded(args, here)


def _loaded(args: argparse.Namespace, here: Connected) -> Found:
    from dextera_build.artifacts.tasks.policy import Checkpoint
    from dextera_build.policy import robot_run
    from dextera_build.sim.runtime import policies

    checkpoint = built.artifact(args, args.policy, Checkpoint)
    session, node = options.session(args, args.policy, last=True)
    terms = tuple(built.terms(session, node, checkpoint))
    runner = built.runner(session, node, checkpoint)
    bundle = robot_run.told(here.bundle, checkpoint.contract)
    loaded = policies.load(runner, checkpoint, bundle, here.seen, terms=terms)
    return loaded, session.output(node), built.measured(session, node, terms)


def _asked(args: argparse.Namespace, here: Connected) -> Found:
    """The policy behind an address; answers later than the guard allows end the run."""
    from dextera_build.deploying.cell import Safety
    from dextera_build.errors import UsageError
    from dextera_build.policy import robot_run
    from dextera_build.policy.wire import asked
    from dextera_build.policy.wire.said import connected
    from dextera_build.sim.runtime import policies

    key_in = args.api_key or ""
    link, said = connected(args.policy, key_in)
    link.close()
    if said.promise is None:
        raise UsageError(
            f"the server at `{args.policy}` does not state what its policy takes",
            code="DXB-U348",
            hint="a node of learn.served states it; give that node as `--policy RECIPE:NODE`",
        )
    settings = asked.promised(said.promise, args.policy, key_in, FIRST_S, Safety().answer_s)
    checkpoint = asked.elsewhere(asked.stated(said.promise, said.digest, settings))
    bundle = robot_run.told(here.bundle, checkpoint.contract)
    return policies.load(asked, checkpoint, bundle, here.seen), said.promise.policy, ()
