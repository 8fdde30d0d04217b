"""Runs the call of a node again, bypassing the cache."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from dextera_build.building.executors import local
from dextera_build.code.companions import of_paths
from dextera_build.recipe.backends import Choice
from dextera_build.recipe.calls import facts_of
from dextera_build.workers.admission import Admission, lacks
from dextera_build.workers.protocol import Ended

if TYPE_CHECKING:
    from dextera_build.project.project import Project


def again(project: Project, document: Mapping[str, Any]) -> Mapping[str, Any]:
    """The reply of a worker of this machine to the call that a key document describes, by the code as it is now.

    A worker, because results also depend on the environment that a build gives to its workers.

    Raises:
        DxbError: The call failed, or this machine lacks what it needs.
    """
    found, name = project.library.find(document["rule"]), document["backend"]
    companions = of_paths(project.library, document.get("companions", {}))
    rule = facts_of(project.library, found, Choice(found.backends[name], "") if name else None, companions)
    with local(project) as ready:
        workers = ready([rule])
        if lacking := rule.needs.lacks(workers.capacity):
            raise lacks(lacking)
        admission = Admission[str](workers.capacity)
        admission.wait(rule.path, rule.needs)
        admission.next()
        task = rule.task(
            document["options"],
            dict(document["inputs"]),
            ticket=0,
            store=str(project.cache),
            project=str(project.root),
            profile=project.profile,
            devices=admission.devices(rule.path),
        )
        workers.submit(task)
        while True:
            for report in workers.poll(None):
                if isinstance(report, Ended):
                    return _reply(report)


def _reply(report: Ended) -> Mapping[str, Any]:
    if report.reply is not None:
        return report.reply
    print(report.log.decode(errors="replace"), end="", file=sys.stderr)
    assert report.error is not None
    raise report.error
