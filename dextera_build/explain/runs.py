"""Past runs, from their event logs."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from dextera_build.errors import UsageError
from dextera_build.project.planning import Added, refuse_unknown
from dextera_build.project.project import Project
from dextera_build.session import Session, notices, reading

Events = list[dict[str, Any]]


def runs(project: Project) -> Iterator[dict[str, Any]]:
    """One row per run of this project, newest first."""
    from dextera_build.project.workspace import workspace
    from dextera_build.runs import log, workspaces

    store = reading(project)
    for run in log.those(store, workspace=workspaces.mark(workspace(project))):
        events = log.read(store, run)
        start = next((event for event in events if event["event"] == "run_started"), None)
        end = next((event for event in events if event["event"] == "run_finished"), None)
        if start is not None:
            yield {
                "run": run,
                "time": start["time"],
                "recipe": start["recipe"],
                "ended": _ended(end),
                "seconds": end["seconds"] if end else None,
            }


def find(project: Project, text: str | None) -> tuple[str, Events]:
    """The events of a run named by its id, of the last run of a recipe, or of the last run.

    Raises:
        UsageError: There is none, or no recipe of this name.
    """
    from dextera_build.project.workspace import workspace
    from dextera_build.runs import log, workspaces

    store = reading(project)
    known = list(log.runs(store))
    run = text if text in known else log.latest(store, text, workspace=workspaces.mark(workspace(project)))
    if run is None:
        if text and not text.isdecimal():  # ids of runs are numbers
            refuse_unknown(project, text)
        what = f"of `{text}` " if text else ""
        raise UsageError(f"no run {what}is logged here", code="DXB-U112", hint="`dxb ls runs`, or `dxb build RECIPE`")
    return run, log.read(store, run)


def of_last_built(project: Project, text: str | None, added: Added) -> Events:
    """The events of a run named by its id, or of a recipe's last successful run, else of its last run.

    The recipe's own request counts, and if it was never built, the request that was built last; see `Session`.

    Args:
        project: The project.
        text: A run's id, a recipe, or None for the recipe of the last run.
        added: Changes to the recipe; if there are any, use the request with these changes.

    Raises:
        UsageError: There is none.
    """
    from dextera_build.runs import log, workspaces

    run, found = find(project, text)
    if run == text:
        return found
    recipe = next(event["recipe"] for event in found if event["event"] == "run_started")
    session = Session(project, recipe, added, last=True)
    of_request = session.last_run()
    if of_request is None:
        raise UsageError(
            f"no run of `{recipe}` with these flags is logged here", code="DXB-U112", hint=f"`dxb build {recipe}`"
        )
    mark = workspaces.mark(session.workspace)
    newest = log.latest(session.store, recipe, session.variant, workspace=mark)
    if newest not in (None, of_request):
        notices[f"run {newest} of `{recipe}` failed or was stopped; `dxb report {newest}` shows it"] = None
    return log.read(session.store, of_request)


def _ended(end: dict[str, Any] | None) -> str:
    if end is None:
        return "cut off"
    if end["interrupted"]:
        return "interrupted"
    return "done" if end["ok"] else "failed"
