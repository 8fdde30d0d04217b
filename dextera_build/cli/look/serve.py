"""`dxb serve`: serve a policy that was built to robots and evaluators, by openpi's protocol."""

from __future__ import annotations

import argparse
import os
import sys
from contextlib import suppress
from typing import TYPE_CHECKING

from dextera_build.cli import built, options, table

if TYPE_CHECKING:
    from collections.abc import Iterator

    from dextera_build.artifacts.tasks.policy import Checkpoint
    from dextera_build.artifacts.tasks.task import TaskBundle
    from dextera_build.serving.served import Served
    from dextera_build.session import Session

PORT = 8000


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    parser.add_argument("node", metavar="RECIPE:NODE", help="a policy that was built: task/close_laptop:act")
    parser.add_argument("--port", type=options.port, default=PORT, help=f"port to listen on ({PORT}; 0: any free one)")
    parser.add_argument(
        "--host",
        default="127.0.0.1",
        metavar="ADDRESS",
        help="address to listen on (127.0.0.1: this machine alone); any other needs --api-key",
    )
    parser.add_argument(
        "--api-key", metavar="VARIABLE", help="environment variable that holds the key which clients must send"
    )
    options.project_arguments(parser)
    options.request_arguments(parser)
    options.json_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Serve until interrupted; the address goes to stdout."""
    import asyncio

    from dextera_build.cli.build.shown import warn
    from dextera_build.running import called
    from dextera_build.serving.server import Server
    from dextera_build.view.server import shown

    key = _key(args)
    session, node = options.session(args, args.node, last=True)
    with called.shown(session.project.library):
        served = _served(session, node)

        def ready(port: int) -> None:
            url = f"ws://{shown(args.host)}:{port}"
            table.say("serve", {"url": url, **served.promise.message()}, url, as_json=args.json)
            for line in () if args.json else _lines(served):
                print(line, file=sys.stderr)

        warn()  # the server runs until it is stopped
        with suppress(KeyboardInterrupt):
            asyncio.run(Server(served, key).serve(args.host, args.port, ready))
    return 0


def _key(args: argparse.Namespace) -> str:
    """The key of the server, or "" for none.

    Raises:
        UsageError: The variable holds none, or other machines could use the policy without one.
    """
    from dextera_build.errors import UsageError
    from dextera_build.redact import hide
    from dextera_build.remotes.remote import is_loopback

    if args.api_key is None:
        if is_loopback(args.host):
            return ""
        raise UsageError(
            f"anyone who can reach `{args.host}` could use the policy",
            code="DXB-U342",
            hint="`export POLICY_KEY=$(openssl rand -hex 16)`, then `--api-key POLICY_KEY`",
        )
    key = os.environ.get(args.api_key, "")
    if not key:
        raise UsageError(
            "`--api-key` takes the name of an environment variable, and none of this name is set",
            code="DXB-U342",
            hint="`export POLICY_KEY=$(openssl rand -hex 16)`, then `--api-key POLICY_KEY`",
        )
    hide(args.api_key, key)
    return key


def _served(session: Session, node: str) -> Served:
    from dextera_build.artifacts.tasks.policy import Checkpoint
    from dextera_build.building import fetch
    from dextera_build.errors import UsageError
    from dextera_build.explain import stubs
    from dextera_build.serving.served import Served
    from dextera_build.session import notices

    if not node:
        hint = f"`dxb serve {session.recipe}:NODE`; `dxb ls {session.recipe}`"
        raise UsageError("a node is missing: `serve` takes RECIPE:NODE", code="DXB-U111", hint=hint)
    fetch.bring(session, [node] if node in session.history else [])
    found = session.artifact(node)
    if not isinstance(found, Checkpoint):
        hint = f"`dxb ls {session.recipe}` lists nodes; a policy is a Checkpoint"
        told = f"`{built.named(session, node)}` is a {found.name()}, not a policy"
        raise UsageError(told, code="DXB-U340", hint=hint)
    if told := stubs.told(session, node):
        notices[told] = None
    bundle = _bundle(session, node, found)
    runner, terms = built.runner(session, node, found), tuple(built.terms(session, node, found))
    return Served(runner, found, session.output(node), bundle, terms)


def _bundle(session: Session, node: str, checkpoint: Checkpoint) -> TaskBundle:
    """The nearest task behind a policy that it was trained for.

    Raises:
        RuleError: The store has none.
    """
    from dextera_build.artifacts.tasks.task import TaskBundle
    from dextera_build.errors import RuleError
    from dextera_build.explain import ancestors
    from dextera_build.policy.layout import embodiment

    for _, made in ancestors.found(session, node, TaskBundle):
        if isinstance(made, TaskBundle) and embodiment(made.robot) == checkpoint.contract.embodiment:
            return made
    raise RuleError(
        f"the task that `{node}` was trained for is not in the store",
        code="DXB-B404",
        hint=f"`dxb build --whole '{built.named(session, node)}'`",
    )


def _lines(served: Served) -> Iterator[str]:
    """What to tell the user."""
    promise = served.promise
    inputs = ", ".join(f"{each.name} {tuple(each.shape)}" for each in promise.inputs)
    yield f"{promise.algorithm} for {promise.task}, {promise.rate_hz:g} Hz; takes {inputs}"
    yield f"gives {promise.horizon} steps of {len(promise.joints)} joint targets, {promise.every} of them to carry out"
    yield "press Ctrl-C to stop"
