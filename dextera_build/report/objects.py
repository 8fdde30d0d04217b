"""One card per copy of a group: its pictures in build order, the lines of its rules, its metrics."""

from __future__ import annotations

from dextera_build.report.html import Html, tag
from dextera_build.report.layout import topological
from dextera_build.report.pictures import Pictures
from dextera_build.report.pieces import link, metrics, state
from dextera_build.report.run import Node, Run

_MESHES = ("Asset", "Body", "Shape", "Mesh")  # artifacts whose preview represents the object, best first

_OBJECTS = (*_MESHES, "Instance", "ObjectView")

_MOST = 200  # cards; those with a failure first


def copies(run: Run) -> dict[tuple[str, str], list[Node]]:
    """(group, label) -> its nodes, inputs first."""
    found: dict[tuple[str, str], list[Node]] = {(g, label): [] for g, labels in run.groups.items() for label in labels}
    for node in topological(run.nodes):
        name, label = node.steps[0] if node.steps else ("", None)
        if label is not None:
            found.setdefault((name, label), []).append(node)
    return {place: nodes for place, nodes in found.items() if nodes}


def portrait(nodes: list[Node]) -> tuple[Node, str, str] | None:
    """The picture that represents an object: (node, caption, digest)."""
    shown = [node for node in nodes if node.previews]
    for kind in _MESHES:
        for node in reversed(shown):
            if node.artifact == kind:
                return (node, *foremost(node))
    return (shown[-1], *foremost(shown[-1])) if shown else None


def foremost(node: Node) -> tuple[str, str]:
    """The preview that represents a node: the last one that shows no failed attempt."""
    told = [preview for preview in node.previews if not preview[0].startswith("failed")]
    return (told or node.previews)[-1]


def groups(run: Run) -> set[str]:
    """The groups whose copies are objects: some node of them made a surface, or what the photograph shows of one."""
    return {group for (group, _), nodes in copies(run).items() if any(node.artifact in _OBJECTS for node in nodes)}


def cards(run: Run, pictures: Pictures, *, objects: bool) -> list[Html]:
    """The cards, in the order in which the groups found their copies.

    Args:
        run: The run.
        pictures: Pictures of the store.
        objects: Whether those of objects; else those of other groups, shards of a data set for example.
    """
    known = groups(run)
    found = [(place, nodes) for place, nodes in copies(run).items() if (place[0] in known) == objects]
    shown = (
        sorted(found, key=lambda item: not any(node.error for node in item[1]))[:_MOST] if len(found) > _MOST else found
    )
    left = len(found) - len(shown)
    made = [_card(group, label, nodes, pictures) for (group, label), nodes in shown]
    return [*made, tag("p", {"class": "quiet"}, f"{left} more are not shown")] if left else made


def _card(group: str, label: str, nodes: list[Node], pictures: Pictures) -> Html:
    seen: set[str] = set()
    figures = []
    for node in nodes:
        for caption, digest in node.previews:
            if digest not in seen:
                seen.add(digest)
                figures.append(pictures.figure(digest, caption, note=node.name, name=node.address))
    lines = [
        tag("tr", None, tag("th", {"scope": "row"}, link(node, node.name)), tag("td", None, state(node)), _said(node))
        for node in nodes
    ]
    numbers = {name: value for node in nodes for name, value in node.metrics.items()}
    return tag(
        "article",
        {"class": "card object"},
        tag("h3", None, label, " ", tag("span", {"class": "sub"}, group)),
        tag("div", {"class": "pictures"}, figures) if any(figures) else None,
        tag("div", {"class": "columns"}, tag("table", {"class": "chain"}, tag("tbody", None, lines)), metrics(numbers)),
    )


def _said(node: Node) -> Html:
    if node.error:
        return tag("td", {"class": "bad"}, str(node.error.get("message", "")))
    if node.status == "waits":
        return tag("td", {"class": "quiet"}, f"for {', '.join(node.blocked_by)}")
    return tag("td", None, node.line)
