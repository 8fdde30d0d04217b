"""The top of the page: the targets, their picture, the checks, and a strip of key pictures."""

from __future__ import annotations

import time

from dextera_build.report.html import Html, tag
from dextera_build.report.layout import topological
from dextera_build.report.objects import copies, foremost, portrait
from dextera_build.report.pictures import Pictures, Size
from dextera_build.report.pieces import failure, link, metrics, state
from dextera_build.report.run import Node, Run
from dextera_build.report.tables import passed
from dextera_build.report.wording import STUB, count, duration, parted, some, states, stubs

_MOST = 3  # pictures of one node in the strip
_LISTED = 6  # lines next to the picture; the others are folded


def title(run: Run) -> Html:
    """Recipe, verdict, date, duration, number of nodes."""
    verdict = ("ok", "✓ built") if run.ok else ("bad", "✗ failed")
    if run.interrupted:
        verdict = ("warn", "- stopped")
    # Stub backends give meaningless shapes: such a page must not be mistaken for a result.
    results = [node.backend for node in run.nodes if node.output]
    warnings = [text for text in [stubs(results.count(STUB), len(results))] if text]
    if any(node.artifact == "Scene" and node.fields.get("scale") == "unknown" for node in run.nodes):
        warnings.append("scale unknown")
    doubtful = sum(len(parted(node.line)[1]) for node in run.nodes)
    if doubtful:
        warnings.append(count(doubtful, "warning"))
    made = {str(node.fields.get("asset_source", "")) for node in run.nodes if node.artifact == "Asset"}
    when = time.strftime("%Y-%m-%d %H:%M UTC", time.gmtime(run.started))
    facts = [
        ("run", run.name),
        ("when", when),
        ("profile", run.profile),
        ("assets made from", " and ".join(sorted(filter(None, made)))),
        ("dxb", run.dxb),
        ("time", duration(run.seconds)),
        ("saved", duration(run.saved) if run.saved >= 1 else ""),
        ("cost of calls", str(run.costs)),
        (count(sum(run.counts.values()), "node"), states(run.counts)),
    ]
    listed = [tag("div", None, tag("dt", None, name), tag("dd", None, value)) for name, value in facts if value]
    marks = [tag("span", {"class": "verdict warn"}, text) for text in warnings]
    return tag(
        "header",
        None,
        tag("h1", None, run.recipe or "a run", " ", tag("span", {"class": f"verdict {verdict[0]}"}, verdict[1]), marks),
        tag("dl", {"class": "strip"}, listed),
    )


def failures(run: Run) -> Html | None:
    """Failed nodes and the nodes that wait for them."""
    found = []
    for node in run.nodes:
        if node.status == "failed":
            waiting = [n.address for n in run.nodes if node.address in n.blocked_by]
            found.append(tag("h3", None, link(node), " ", tag("span", {"class": "sub"}, node.rule)))
            found.append(failure(node.error or {"message": "it ended without a result"}))
            if waiting:
                found.append(
                    tag(
                        "p",
                        {"class": "quiet"},
                        f"{count(len(waiting), 'node waits', 'nodes wait')}: {some(waiting, 8)}",
                    )
                )
    return tag("div", {"class": "card failures"}, tag("h2", None, "What failed"), found) if found else None


def hero(run: Run, pictures: Pictures) -> tuple[Html | None, str]:
    """The picture at the top and its digest: the result that is an image, else the last preview."""
    found = _hero(run)
    if found is None:
        return None, ""
    node, caption, digest = found
    figure = pictures.figure(digest, caption, size="hero", note=node.address, name=node.address)
    return (figure, digest) if figure else (None, "")


def outcome(run: Run) -> Html:
    """Lines of the nodes outside groups, latest results first, with their numbers and checks."""
    rows = []
    for node in reversed(topological([n for n in run.nodes if not n.labels])):
        verdict = passed(node)
        check = None
        if verdict is not None:
            check = tag("span", {"class": "yes" if verdict else "no"}, "✓ passed" if verdict else "✗ did not pass")
        said = str(node.error.get("message", "")) if node.error else node.line
        rows.append(
            tag(
                "li",
                None,
                tag("div", None, link(node), " ", check or state(node)),
                tag("p", None, said),
                metrics(node.metrics),
            )
        )
    first = tag("ol", {"class": "outcome"}, rows[:_LISTED])
    if len(rows) <= _LISTED:
        return first
    words = tag("summary", None, count(len(rows) - _LISTED, "earlier step"))
    return tag(
        "div", None, first, tag("details", {"class": "more"}, words, tag("ol", {"class": "outcome"}, rows[_LISTED:]))
    )


def strip(run: Run, pictures: Pictures, without: set[str]) -> Html | None:
    """Key pictures that stand nowhere else: those of the nodes outside groups, and one per object."""
    found: list[tuple[Node, str, str, str]] = []
    for node in topological([n for n in run.nodes if not n.labels]):
        found += [(node, node.name, caption, digest) for caption, digest in node.previews[:_MOST]]
    for (_, label), nodes in copies(run).items():
        best = portrait(nodes)
        if best is not None:
            found.append((best[0], label, best[1], best[2]))
    figures = []
    seen = set(without)
    for node, note, caption, digest in found:
        if digest not in seen:
            seen.add(digest)
            size: Size = "small" if node.labels else "large"
            figures.append(pictures.figure(digest, caption, size=size, note=note, name=node.address))
    return tag("div", {"class": "pictures key"}, figures) if any(figures) else None


def _hero(run: Run) -> tuple[Node, str, str] | None:
    needed = {address for node in run.nodes for address in node.depends_on}
    images = [n for n in run.nodes if n.artifact == "Image" and not n.labels and n.previews]
    # Prefer targets, then nodes that no other node reads.
    images.sort(key=lambda n: (n.address in run.targets, n.address not in needed, n.ended))
    shown = images or [n for n in topological(run.nodes) if n.previews and not n.labels]
    shown = shown or [n for n in topological(run.nodes) if n.previews]
    return (shown[-1], *foremost(shown[-1])) if shown else None
