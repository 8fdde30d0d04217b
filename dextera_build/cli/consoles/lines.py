"""The lines of a build log, as styled pieces that every console can print."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

from dextera_build.cli.errors import paint
from dextera_build.report.wording import MARKS, STATES, count, duration, parted, size, some, states
from dextera_build.runs.costs import Costs
from dextera_build.runs.events import (
    BytesMissed,
    Event,
    GroupOpened,
    NodeFinished,
    NodeLog,
    NodeRetried,
    RemoteGivenUp,
    RunFinished,
    RunStarted,
    Uploaded,
    Uploading,
)

Line: TypeAlias = list[tuple[str, str]]
"""(text, style) pieces; styles are the names in `STYLES`."""

STYLES: dict[str, str] = {
    "": "",
    "cached": "2",
    "ran": "32",
    "fetched": "36",
    "failed": "31;1",
    "waits": "33",
    "cancelled": "33",
    "name": "1",
    "dim": "2",
    "path": "36",
}
"""Style -> ANSI codes."""

_NAME, _BACKEND = 26, 10  # column widths [characters]

_FOLD = 4  # larger groups of nodes in one state are folded into one line


def line(event: Event, *, verbose: bool) -> Line | None:
    """The log line of an event; None if it is summarised later or not shown."""
    if isinstance(event, NodeFinished):
        return node(event) if event.status not in ("waits", "cancelled", "cached") else _still(event)
    if isinstance(event, NodeLog):
        return logged(event.node, event.text) if verbose else None
    say = _SAID.get(type(event))
    return say(event) if say is not None else None


def node(event: NodeFinished) -> Line:
    """`  +  body[mug].mesh   12.0 s   primitives   revolved, closed`, and below it the warnings of the rule."""
    time = duration(event.seconds) if event.status in ("ran", "fetched", "failed") else event.status
    said, warnings = parted(_first(event.line))
    if event.status == "failed" and event.error:
        said = _first(event.error.message)
    if event.status == "waits":
        said = f"for {some(event.blocked_by, 3)}"
    if event.status == "fetched":
        said = said or "remote"
    # For a fetched node, its remote is more informative than the backend that it ran with.
    row = _row(event.status, event.node, time, event.remote or event.backend or "", said)
    return [*row, *(piece for text in warnings for piece in (("\n       ", ""), (f"warning: {text}", "waits")))]


def _still(event: NodeFinished) -> Line | None:
    """The row of a known result, if it came with warnings."""
    return node(event) if event.status == "cached" and parted(event.line)[1] else None


def left_over(events: Sequence[NodeFinished]) -> list[Line]:
    """Lines for nodes that never ran: waiting ones by blocker, then cancelled ones; large groups are folded."""
    groups: dict[tuple[str, ...], list[NodeFinished]] = {}
    for event in sorted(events, key=lambda e: e.status != "waits"):
        groups.setdefault((event.status, *event.blocked_by), []).append(event)
    found: list[Line] = []
    for (status, *blockers), group in groups.items():
        if len(group) <= _FOLD:
            found += map(node, group)
        else:
            said = f"for {some(blockers, 3)}" if status == "waits" else some([e.node for e in group], 3)
            found.append(_row(status, count(len(group), "node"), STATES[status][1], "", said))
    return found


def _row(status: str, name: str, time: str, backend: str, said: str) -> Line:
    style = "failed" if status == "failed" else "dim"
    row: Line = [
        (f"  {MARKS[status]}  ", status),
        (f"{name:<{_NAME}}  ", ""),
        (f"{time:<10} ", style),
        (f"{backend:<{_BACKEND}}  ", "dim"),
        (said, style if status == "failed" else ""),
    ]
    while not row[-1][0].strip():
        row.pop()
    text, last = row.pop()
    return [*row, (text.rstrip(), last)]


def plain(line: Line, *, colour: bool = False) -> str:
    """The line's text, with ANSI codes if `colour` is true."""
    return "".join(paint(text, STYLES[style], colour and bool(STYLES[style])) for text, style in line)


def plan(event: RunStarted) -> Line:
    """`plan   17 calls, 1 open group`; the number of nodes is known once the group opens."""
    groups = f", {count(event.groups, 'open group')}" if event.groups else ""
    instead = "".join(f"\n       {line}" for line in event.instead)
    return [("plan   ", "name"), (f"{count(event.calls, 'call')}{groups}", ""), (instead, "failed")]


def opened(event: GroupOpened) -> Line:
    """`body opened: 3 copies (laptop, mug, box)`."""
    labels = f" ({some(event.labels)})" if event.labels else ""
    return [(f"       {event.group} opened: {count(len(event.labels), 'copy', 'copies')}{labels}", "dim")]


def logged(node: str, text: str) -> Line:
    """A line that a node logged."""
    return [(f"     {node} | ", "dim"), (printable(text.rstrip()), "")]


def missed(event: BytesMissed) -> Line:
    """Why a node with a known result is fetched or runs: `loud: its bytes are not here, and all reads them`."""
    because = "its bytes are requested" if event.reader == event.node else f"{event.reader} reads its bytes"
    return [(f"       {event.node}: its result is bare (bytes not in the store), and {because}", "dim")]


def retried(event: NodeRetried) -> Line:
    """A node that is retried: `~  film   try 2 in 1.4 s: worker died (signal 9)`."""
    message = _first(str(event.error.get("message", "")))
    return [
        ("  ~  ", "waits"),
        (event.node, ""),
        (f"  try {event.tries + 1} in {duration(event.wait_s)}: {message}", "waits"),
    ]


def summary(recipe: str, event: RunFinished) -> Line:
    """`built twin/laptop_scene   19 nodes: 9 ran, 9 cached   58.3 s (21 min saved)`."""
    total = sum(event.counts.values())
    nodes, seconds = count(total, "node"), duration(event.seconds)
    if event.ok and event.counts.get("cached", 0) == total:
        return [(recipe, "name"), (f" is up to date   {nodes}   {seconds}", "")]
    verb, style = ("built", "ran") if event.ok else ("failed", "failed")
    if event.interrupted:
        verb, style = "stopped", "waits"
    saved = f" ({duration(event.saved_seconds)} saved)" if event.saved_seconds >= 1 else ""
    became = f": {states(event.counts)}" if total else ""
    return [(verb, style), (f" {recipe}", "name"), (f"   {nodes}{became}   {seconds}{saved}", "")]


_GIVEN_UP = {
    "both": ("{} is not used for the rest of this build: {}", "`--cache local:rw` builds without remotes"),
    "read": ("nothing more is read from {} in this build: {}", "`--cache local:rw` builds without remotes"),
    "write": ("nothing more is sent to {} in this build: {}", "mode `r` stops uploads"),
}
"""Mode that is given up -> message and hint."""


def given_up(event: RemoteGivenUp) -> Line:
    """A remote that is no longer used, the reason, and a hint."""
    named = event.remote if event.remote == event.address else f"{event.remote} ({event.address})"
    said, todo = _GIVEN_UP[event.doing]
    return [("warning: ", "waits"), (f"{said.format(f'remote {named}', printable(event.reason))}; {todo}", "")]


_SAID: dict[type[Event], Callable[[Any], Line]] = {
    RunStarted: plan,
    GroupOpened: opened,
    BytesMissed: missed,
    NodeRetried: retried,
    RemoteGivenUp: given_up,
}


def uploading(event: Uploading) -> Line:
    """`uploading   3 of 12 results`."""
    return [("uploading   ", "name"), (f"{event.done:,} of {count(event.total, 'result')}", "")]


def uploaded(event: Uploaded) -> list[Line]:
    """The results uploaded to a remote, and those not uploaded, with the reason."""
    found: list[Line] = []
    if event.results:
        found.append([(f"  {event.remote}: {count(event.results, 'result')} uploaded, {size(event.octets)}", "dim")])
    if event.left:
        were = "was" if event.left == 1 else "were"
        said = f"{count(event.left, 'result')} {were} not uploaded to {event.remote}: {printable(event.reason)}"
        found.append([("warning: ", "waits"), (said, "")])
    return found


def unsent(recipe: str, event: Uploaded, before: int) -> Line:
    """How to upload the results that a build found in the store: it uploads only those of nodes that ran."""
    said = f"  {count(before, 'result')} from before this build not looked for there: "
    return [(said, "dim"), (f"dxb cache push {recipe} --to {event.remote}", "path")]


def costs(found: Costs) -> list[Line]:
    """`  cost: 0.0400 USD for 2 requests to forge`; nothing if no request had a price."""
    return [[("  cost: ", "dim"), (printable(str(found)), "")]] if str(found) else []


def pulled(recipe: str, event: RunFinished) -> Line:
    """`pulled twin/laptop_scene   19 nodes: 10 fetched, 9 cached   3.1 s`."""
    total = count(sum(event.counts.values()), "node")
    lacking = event.counts.get("failed", 0)
    kept = {state: number for state, number in event.counts.items() if state != "failed"}
    said = ", ".join(filter(None, [states(kept), f"{lacking:,} lacking" if lacking else ""]))
    return [("pulled", "fetched"), (f" {recipe}", "name"), (f"   {total}: {said}   {duration(event.seconds)}", "")]


def next_steps(recipe: str, twin: str = "", node: str = "") -> Line:
    """Commands that show the result of a build, and the one that gives a robot its first tasks.

    Args:
        recipe: The recipe that was built.
        twin: The recipe of a twin, in which the robot that was built may get its tasks; "" to leave that out.
        node: The node to show; "" if the recipe as a whole can be viewed.
    """
    verb, what = ("show", shlex.quote(f"{recipe}:{node}")) if node else ("view", recipe)
    shown: Line = [
        (f"  {verb}: ", "dim"),
        (f"dxb {verb} {what}", "path"),
        ("      report: ", "dim"),
        ("dxb report", "path"),
    ]
    if not (twin and recipe.startswith("robot/")):
        return shown
    return [*shown, ("      tasks: ", "dim"), (f"dxb new task {twin} {recipe}", "path")]


def _first(text: str) -> str:
    return printable(text.partition("\n")[0])


def printable(text: str) -> str:
    """`text` with unprintable characters as spaces: output of rules and libraries may hold control codes."""
    return "".join(char if char.isprintable() else " " for char in text)
