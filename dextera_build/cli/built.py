"""What verbs take from a recipe that was built: its task, an artifact of a type, the code and terms of a policy."""

from __future__ import annotations

import argparse
import json
from typing import TYPE_CHECKING, TypeVar

from dextera_build.cli import options

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator

    from dextera_build.artifacts.base import Artifact
    from dextera_build.artifacts.tasks.policy import Checkpoint
    from dextera_build.artifacts.tasks.task import TaskBundle
    from dextera_build.artifacts.tasks.term import TermSpec
    from dextera_build.code.companions import Companion
    from dextera_build.policy.added import AddedTerm
    from dextera_build.policy.running import Runner
    from dextera_build.runs.events import NodeFinished
    from dextera_build.session import Session

T = TypeVar("T", bound="Artifact")
PARTS = ("Background", "Support", "Capture")
"""Artifacts that a twin's scene needs."""


def named(session: Session, node: str) -> str:
    """A node as it is typed."""
    return f"{session.recipe}:{node}"


def task(target: str, session: Session, node: str, verb: str) -> tuple[str, TaskBundle]:
    """The node of a recipe's task, and the task.

    Raises:
        UsageError: It is none, or was not built.
    """
    from dextera_build.artifacts.tasks.task import TaskBundle
    from dextera_build.building import fetch
    from dextera_build.errors import UsageError

    if node:
        fetch.bring(session, [node] if node in session.history else [])
        found = session.artifact(node)
        if isinstance(found, TaskBundle):
            return node, found
    elif (own := own_task(session)) is not None:
        return own
    raise UsageError(
        f"`{target}` is no task that was built" if not node else f"`{target}` is a {found.name()}, not a task",
        code="DXB-U333",
        hint=_task_hint(session, verb),
    )


def _task_hint(session: Session, verb: str) -> str:
    """The words to type for a task of a session's recipe."""
    from dextera_build.errors import listing

    if (own := own_task(session)) is not None:
        return f"`dxb {verb} {session.recipe}:{own[0]}`"
    found = [f"{session.recipe}:{name}" for name in declared(session, "TaskBundle")]
    if not found:
        return f"`{session.recipe}` has no task; `dxb ls` lists recipes, and those below `task/` have one"
    others = f"; also {listing(found[1:], most=5)}" if found[1:] else ""
    return f"`dxb build {found[0]}`, then `dxb {verb} {found[0]}`{others}"


def declared(session: Session, kind: str) -> list[str]:
    """Nodes of a recipe, built or not, whose rules return a type; those called `task` come first."""
    library, found = session.project.library, list[str]()
    for address, call in session.plan(incomplete=True).graph.calls():
        returns = library.find(call.rule.path).rule.returns
        if len(address) == 1 and ":" not in address[0] and getattr(returns, "__name__", "") == kind:
            found.append(address[0])
    return sorted(found, key=lambda name: (name.rpartition("/")[2] != "task", name.count("/")))


def own_task(session: Session) -> tuple[str, TaskBundle] | None:
    """The node of a recipe's own task, and the task; None if it was not built or there is none."""
    from dextera_build.artifacts.tasks.task import TaskBundle
    from dextera_build.building import fetch

    for node in by_type(session).get("TaskBundle", []):
        # Nodes of other recipes have those recipes' names; the nodes of a recipe itself are its subject.
        if ":" not in node:
            fetch.bring(session, [node])
            if isinstance(bundle := session.artifact(node), TaskBundle):
                return node, bundle
    return None


def by_type(session: Session) -> dict[str, list[str]]:
    """Artifact type -> the recipe's own nodes of the last build that returned one, with or without bytes."""
    found: dict[str, list[str]] = {}
    for node in session.last_nodes:
        result = session.store.actions.find(session.past(node).key)
        if result is not None:  # else it is no longer in the store
            found.setdefault(_type_of(session, result.result.output), []).append(node)
    return found


def _type_of(session: Session, output: str) -> str:
    """The name of a result's type."""
    from dextera_build.artifacts.core.identity import parse

    return parse(json.loads(session.store.blobs.get(output))["artifact"])[0]


def is_viewed(session: Session, nodes: Iterable[NodeFinished]) -> bool:
    """Whether `dxb view RECIPE` shows what a run made: its task, its robot, or a twin's scene."""
    # The results of a rule are of one type, so one of them is looked at.
    made = {(node.rule, ":" in node.node): node.output for node in nodes if node.output}
    kinds = {(_type_of(session, output), foreign) for (_, foreign), output in made.items()}
    own = {kind for kind, foreign in kinds if not foreign}
    return bool(own & {"TaskBundle", "RobotModel"}) or {*PARTS} <= {kind for kind, _ in kinds}


def artifact(args: argparse.Namespace, target: str, kind: type[T]) -> T:
    """The artifact of a node that was built.

    Raises:
        UsageError: It is of another type.
    """
    from dextera_build.building import fetch
    from dextera_build.errors import UsageError

    session, node = options.session(args, target, last=True)
    if node:
        fetch.bring(session, [node] if node in session.history else [])
        found = session.artifact(node)
        if isinstance(found, kind):
            return found
    raise UsageError(
        f"`{target}` is no {kind.name()}" if node else f"`{target}` names no node",
        code="DXB-U345",
        facts={"needed": kind.name()},
        hint=f"`dxb ls {session.recipe}` lists nodes and their types",
    )


def runner(session: Session, node: str, checkpoint: Checkpoint) -> Runner:
    """`policy.py` next to the rule that trained a policy."""
    from dextera_build.policy.running import Runner
    from dextera_build.running import called

    algorithm = checkpoint.contract.algorithm
    near = _companions(session, node, checkpoint.name(), "policy")
    found = [each for each in near if each.name == algorithm and each.file.is_file()]
    found_runner: Runner = called.running({"checkpoint": found})("checkpoint", algorithm, Runner)
    return found_runner


def terms(session: Session, node: str, checkpoint: Checkpoint) -> Iterator[TermSpec]:
    """Terms of a policy's inputs that do not come with dxb, from the episodes that it learned from."""
    from dextera_build.artifacts.tasks.episode import Episodes
    from dextera_build.explain import ancestors
    from dextera_build.policy.contract import CHANNELS

    wanted = {channel.name for channel in checkpoint.contract.inputs} - set(CHANNELS)
    for _, made in ancestors.found(session, node, Episodes) if wanted else ():
        if isinstance(made, Episodes):
            for name in sorted(wanted & made.terms.keys()):
                yield made.terms[name]
            wanted -= made.terms.keys()


def measured(session: Session, node: str, terms: Collection[TermSpec]) -> tuple[AddedTerm, ...]:
    """Terms with their functions, from the rules that declared them for what a policy learned from."""
    from dextera_build.artifacts.tasks.term import TermSpec
    from dextera_build.policy.added import of_specs
    from dextera_build.running import called

    return of_specs(terms, called.running({"terms": _companions(session, node, TermSpec.name(), "")}))


def _companions(session: Session, node: str, kind: str, stem: str) -> list[Companion]:
    """The files `stem` beside the rules that made the artifacts of a type from which a node was made."""
    from dextera_build.code.companions import beside
    from dextera_build.explain import ancestors

    rules = {event["rule"] for name, event in ancestors.behind(session, node) if name == kind}
    return [beside(session.project.library.find(rule), stem) for rule in sorted(rules)]
