"""Refuses a build that needs backends which this machine cannot run, or inputs that are not given."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from dextera_build.engine.graph import RuleFacts
from dextera_build.errors import DxbError, MachineError, UsageError


def refuse(rules: Iterable[RuleFacts]) -> None:
    """Refuse rules whose chosen backend is missing, all in one message.

    Raises:
        MachineError: A package, weights or a licence of a backend is missing.
    """
    lacking = _lacking(rules)
    if not lacking:
        return
    if len(lacking) == 1:
        (rule,) = lacking
        facts = {"needs": ", ".join(rule.missing), "chosen by": rule.chosen}
        message = f"backend `{rule.backend}` of {rule.path} is missing"
        raise MachineError(message, code="DXB-E301", facts=facts, hint=rule.hint)
    raise MachineError(
        f"{len(lacking)} backends are missing",
        code="DXB-E301",
        facts=_facts(lacking),
        hint="follow the next steps of each backend; `dxb doctor` checks them again",
    )


def refuse_incomplete(absent: Sequence[DxbError], rules: Iterable[RuleFacts]) -> None:
    """Refuse a plan without required inputs; missing backends are listed in the same message.

    Args:
        absent: An error for each input.
        rules: Rules of the nodes.

    Raises:
        DxbError: Always.
    """
    lacking = _lacking(rules)
    if len(absent) == 1 and not lacking:
        raise absent[0]
    message = absent[0].message if len(absent) == 1 else f"{len(absent)} inputs are not given"
    if lacking:
        message += f", and {len(lacking)} backend{'s are' if len(lacking) > 1 else ' is'} missing"
    facts = {
        error.message if len(absent) > 1 else "input": "\n".join([*error.facts.values(), f"at: {error.where}"])
        for error in absent
    }
    raise UsageError(message, code="DXB-U105", facts=facts | _facts(lacking), hint=absent[0].hint)


def _lacking(rules: Iterable[RuleFacts]) -> list[RuleFacts]:
    """Rules whose chosen backend is missing, each once."""
    return list({(rule.path, rule.backend): rule for rule in rules if rule.missing}.values())


def _facts(lacking: Iterable[RuleFacts]) -> dict[str, str]:
    """`factorize.mesh: trellis2` -> missing requirements of its backend, and the next step."""
    return {f"{rule.path}: {rule.backend}": f"needs {', '.join(rule.missing)}\nnext: {rule.hint}" for rule in lacking}
