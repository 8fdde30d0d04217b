"""What acts in `dxb run`: a policy that was built, a server of `dxb serve` on another machine, or an episode."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from typing import TYPE_CHECKING

from dextera_build.cli import built, options
from dextera_build.cli.robot import episodes

if TYPE_CHECKING:
    from dextera_build.cli.robot.connected import Connected
    from dextera_build.deploying.cell import RosCell
    from dextera_build.deploying.continuing import Continuing
    from dextera_build.deploying.driving import Acting
    from dextera_build.policy.added import AddedTerm
    from dextera_build.policy.running import Policy

SOCKETS = ("ws://", "wss://")
"""Beginnings of addresses whose servers state what their policies take."""
FIRST_S = 120.0
"""Time limit of a server's first answer [s], in which it may compile a network; the robot does not move yet."""


@dataclass(frozen=True)
class Found:
    """What acts, ready to run."""

    acting: Acting
    """The policy, or the episode that is replayed."""
    about: dict[str, str]
    """What recordings say of it: `policy`, a digest; `algorithm`; `origin`, `policy` or `replay`."""
    needed: tuple[str, ...] = ()
    """Channels that it takes."""
    terms: tuple[AddedTerm, ...] = ()
    """Terms of its inputs that do not come with dxb."""
    policy: Policy | None = None
    """The same, if it may be asked in a thread of its own; None for an episode."""
    continuing: Continuing | None = None
    """Tells it what its answers continue; None: nothing."""
    limit_s: float | None = None
    """How long it takes [s]; None: as long as the task allows."""

    def asked_by(self, cell: RosCell, asynchronous: bool) -> Acting:
        """What drives a robot: the policy in a thread of its own, or each time in between."""
        from dextera_build.deploying.ahead import Ahead

        if self.policy is None or not (asynchronous or self.continuing):
            return self.acting
        return Ahead.of(self.policy, cell, self.continuing)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that state what acts."""
    acts = parser.add_mutually_exclusive_group(required=True)
    acts.add_argument(
        "--policy",
        metavar="RECIPE:NODE",
        help="a policy that was built, also one of learn.served, or the address of `dxb serve`, ws://HOST:PORT",
    )
    acts.add_argument(
        "--replay", metavar="RECIPE:NODE", help="send the joint targets of an episode instead, whatever is measured"
    )
    episodes.number_argument(parser)
    parser.add_argument(
        "--api-key", metavar="VARIABLE", help="environment variable that holds the key of the policy's server"
    )


def found(args: argparse.Namespace, here: Connected) -> Found:
    """What the arguments state.

    Raises:
        UsageError: It is no policy, another program than `dxb serve` answers, or a server is to continue a plan.
        MachineError: Nothing answers at the address.
        RuleError: It does not fit the task.
    """
    if args.replay:
        return _replayed(args, here)
    if args.policy.startswith(SOCKETS):
        return _asked(args, here)
    return _loaded(args, here)


def _loaded(args: argparse.Namespace, here: Connected) -> Found:
    from dextera_build.artifacts.tasks.policy import Checkpoint
    from dextera_build.deploying.continuing import Continuing
    from dextera_build.policy import robot_run
    from dextera_build.sim.runtime import policies

    checkpoint = built.artifact(args, args.policy, Checkpoint)
    session, node = options.session(args, args.policy, last=True)
    terms = tuple(built.terms(session, node, checkpoint))
    runner = built.runner(session, node, checkpoint)
    bundle = robot_run.told(here.bundle, checkpoint.contract)
    continuing = Continuing(runner) if args.real_time_chunking else None
    loaded = policies.load(continuing or runner, checkpoint, bundle, here.seen, terms=terms)
    return _of_policy(loaded, session.output(node), built.measured(session, node, terms), continuing)


def _of_policy(
    policy: Policy, digest: str, terms: tuple[AddedTerm, ...] = (), continuing: Continuing | None = None
) -> Found:
    contract = policy.contract
    needed = [channel.name for channel in contract.inputs]
    needed += ["objects", "displacement"] if terms else []  # a term may be computed from each
    about = {"policy": digest, "algorithm": contract.algorithm, "origin": "policy"}
    return Found(policy, about, tuple(needed), terms, policy, continuing)


def _replayed(args: argparse.Namespace, here: Connected) -> Found:
    from dextera_build.deploying.replaying import LINGER_S, Replaying

    targets = episodes.chosen(args, args.replay, here.bundle).executed
    session, node = options.session(args, args.replay, last=True)
    about = {"policy": session.output(node), "algorithm": "", "origin": "replay"}
    return Found(Replaying(targets), about, limit_s=len(targets) / here.bundle.task.control_hz + LINGER_S)


def _asked(args: argparse.Namespace, here: Connected) -> Found:
    """The policy behind an address; answers later than the guard allows end the run."""
    from dextera_build.deploying.cell import Safety
    from dextera_build.errors import UsageError
    from dextera_build.policy import robot_run
    from dextera_build.policy.wire import asked
    from dextera_build.policy.wire.said import connected
    from dextera_build.sim.runtime import policies

    if args.real_time_chunking:
        raise UsageError(
            f"the server at `{args.policy}` is not told what its answer has to continue",
            code="DXB-U354",
            hint="give the node of the policy as `--policy RECIPE:NODE`, or `--asynchronous` instead",
        )
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
    return _of_policy(policies.load(asked, checkpoint, bundle, here.seen), said.promise.policy)
