"""Refuses a build that needs backends which this machine cannot run."""

from __future__ import annotations

from collections.abc import Iterable

from dextera_build.engine.graph import RuleFacts
from dextera_build.errors import MachineError, listing


def refuse(rules: Iterable[RuleFacts]) -> None:
    """Refuse rules whose chosen backend is missing, all in one message.

    Raises:
        MachineError: A package, weights or a licence of a backend is missing.
    """
    lacking = {(rule.path, rule.backend): rule for rule in rules if rule.missing}
    if not lacking:
        return
    if len(lacking) == 1:
        (rule,) = lacking.values()
        message = f"backend `{rule.backend}` of {rule.path} is missing"
        facts = {"needs": listing(rule.missing), "chosen by": rule.chosen}
    else:
        message = f"{len(lacking)} backends are missing"
        facts = {f"{rule.path}: {rule.backend}": f"needs {listing(rule.missing)}" for rule in lacking.values()}
    hints = dict.fromkeys(rule.hint for rule in lacking.values() if rule.hint)
    raise MachineError(message, code="DXB-E301", facts=facts, hint="; ".join(hints) or None)
