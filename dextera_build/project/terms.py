"""The terms on which a project's builds call services: its settings, the user's consents, the account of costs."""

from __future__ import annotations

import os
from weakref import WeakKeyDictionary

from dextera_build.calls import spending
from dextera_build.calls.consent import Consents
from dextera_build.calls.terms import written
from dextera_build.project import settings
from dextera_build.project.project import Project

_ledgers: WeakKeyDictionary[Project, str] = WeakKeyDictionary()


def terms(project: Project) -> str:
    """The terms for worker processes; see `calls.terms.Terms`."""
    limit = project.max_cost
    account = _ledger(project) if limit is not None else ""
    return written(project.config["services"].value, limit, account, consents(project).here())


def consents(project: Project) -> Consents:
    """The user's consents to send data of this project to services."""
    return Consents(settings.user_folder() / "consents.json", str(project.root.absolute()))


def _ledger(project: Project) -> str:
    """The account of one command: that of the command which started this process, or one of this project."""
    if spending.LEDGER in os.environ:
        return os.environ[spending.LEDGER]
    if project not in _ledgers:
        _ledgers[project] = spending.open_ledger()[1]
    return _ledgers[project]
