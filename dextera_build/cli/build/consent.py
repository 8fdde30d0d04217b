"""Asks, after a build that lacked it, for consent to send data to services."""

from __future__ import annotations

import sys

from dextera_build.building.build import Built
from dextera_build.calls.consent import CODE
from dextera_build.project.project import Project
from dextera_build.project.terms import consents

_WORDS = {"y": False, "yes": False, "a": True, "always": True}
"""Answer -> whether it is for every project."""


def agreed(project: Project, built: Built) -> bool:
    """Ask on a terminal for every consent that the build lacked; return whether all were given, so it can go on."""
    lacked = {
        (error.facts["service"], error.facts["data"]): error.facts["request"]
        for error in built.result.errors.values()
        if error.code == CODE
    }
    if not lacked or project.console in ("none", "jsonl") or not (sys.stdin.isatty() and sys.stderr.isatty()):
        return False
    answers = [_ask(project, service, kind, size) for (service, kind), size in lacked.items()]
    return all(answers)


def _ask(project: Project, service: str, kind: str, size: str) -> bool:
    print(f"\nSend a {kind} of this project to `{service}` ({size})?", file=sys.stderr)
    print("[y]es, from this project; [a]lways, from any project; [N]o: ", end="", file=sys.stderr, flush=True)
    everywhere = _WORDS.get(sys.stdin.readline().strip().lower())
    if everywhere is None:
        return False
    consents(project).give(service, [kind], everywhere=everywhere)
    return True
