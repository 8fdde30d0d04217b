"""Details of every node, folded; the graph and the timeline link here."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from dextera_build.report.films import Films, player
from dextera_build.report.html import Child, Html, tag
from dextera_build.report.pictures import Pictures
from dextera_build.report.pieces import failure, link, metrics, state, took
from dextera_build.report.provenance import Sources, code_digest, sources_of
from dextera_build.report.run import Node, Run
from dextera_build.report.wording import count, used

_LOG_LINES = 40  # the last ones
_LOG_CHARACTERS = 8000
_FULL = 1200  # nodes with full details; about 1.5 kB each
_LISTED = 4000  # nodes with a line at all; about 0.7 kB each


def details(run: Run, pictures: Pictures, films: Films | None = None) -> Html:
    """The list of all nodes, with a filter field if scripts are enabled; without `films`, no film is shown."""
    producers: dict[str | None, Node] = {node.output: node for node in run.nodes if node.output}
    field = tag(
        "input",
        {"type": "search", "id": "filter", "placeholder": "address, rule, state …", "autocomplete": "off"},
    )
    bar = tag("p", {"class": "filter", "hidden": True}, tag("label", {"for": "filter"}, "Show only "), field)
    known = _Known(run.by_address(), producers, sources_of(run), films)
    listed = _first(run.nodes, _LISTED)
    full = {node.index for node in _first(listed, _FULL)}
    left = len(run.nodes) - len(listed)
    note = tag("p", {"class": "quiet"}, f"{count(left, 'node')} more: `dxb log {run.name}` lists all of them")
    rows = [_node(node, known, pictures, full=node.index in full) for node in listed]
    return tag("div", {"class": "nodes"}, bar, rows, note if left else None)


@dataclass(frozen=True)
class _Known:
    """Targets of links in the details."""

    by_address: Mapping[str, Node]
    producers: Mapping[str | None, Node]
    sources: Mapping[str, Sources]
    films: Films | None


def _first(nodes: list[Node], most: int) -> list[Node]:
    """The most relevant nodes of a huge run: those that failed, then those that did something."""
    if len(nodes) <= most:
        return nodes
    order = ("failed", "ran", "fetched")
    ranked = sorted(nodes, key=lambda node: order.index(node.status) if node.status in order else len(order))
    return sorted(ranked[:most], key=lambda node: node.index)


def _node(node: Node, known: _Known, pictures: Pictures, *, full: bool) -> Html:
    summary = tag(
        "summary",
        None,
        state(node),
        tag("span", {"class": "address"}, node.address),
        tag("span", {"class": "time"}, took(node)),
        tag("span", {"class": "said"}, str(node.error.get("message", "")) if node.error else node.line),
    )
    return tag(
        "details",
        {"id": f"n{node.index}", "class": "node"},
        summary,
        _body(node, known, pictures) if full else _short(node),
    )


def _short(node: Node) -> Html:
    rows = [tag("div", None, tag("dt", None, "rule"), tag("dd", None, node.rule))]
    rows.append(tag("div", None, tag("dt", None, "key"), tag("dd", None, _digest(node.key))))
    return tag("div", {"class": "body"}, tag("dl", {"class": "facts"}, rows))


def _call(call: Mapping[str, Any]) -> str:
    """`openai gpt-x, asked, cost 0.002, 3f2a...`: the parts of this that the run knows."""
    service = f"{call.get('service', '')} {call.get('model', '')}".strip()
    cost = f"cost {call['cost']:g}" if "cost" in call else ""
    return " ".join(part for part in (service, call.get("how", ""), cost, str(call["call"])[:12]) if part)


def _body(node: Node, known: _Known, pictures: Pictures) -> Html:
    facts: list[tuple[str, Child]] = [
        ("rule", f"{node.rule}{_version(node)}"),
        ("backend", node.backend),
        ("state", [state(node), " ", took(node)]),
        ("used", used(node.usage)),
        ("tries", str(node.tries) if node.tries > 1 else ""),
        ("key", _digest(node.key)),
        ("output", [node.artifact, " " if node.artifact else "", _digest(node.output)]),
        ("a later run gave", [[_digest(output), " "] for output in node.again] or None),
        ("waits for", _links(node.blocked_by, known.by_address)),
        ("depends on", _links(node.depends_on, known.by_address)),
        ("packages", ", ".join(f"{n} {v}" for n, v in _mapping(node, "packages").items())),
        ("calls", ", ".join(_call(call) for call in node.calls)),
        ("weights", ", ".join(str(w) for w in node.document.get("weights") or ())),
    ]
    rows = [tag("div", None, tag("dt", None, name), tag("dd", None, value)) for name, value in facts if _any(value)]
    previews = [
        pictures.figure(digest, caption, size="small" if digest in pictures.large else "large", name=node.address)
        for caption, digest in node.previews
    ]
    return tag(
        "div",
        {"class": "body"},
        failure(node.error) if node.error else None,
        tag("dl", {"class": "facts"}, rows),
        tag("div", {"class": "pictures"}, previews) if any(previews) else None,
        _film(node, known.films),
        metrics(node.metrics),
        _rows("options", [(name, _json(value)) for name, value in _mapping(node, "options").items()]),
        _rows("inputs", [(slot, _input(digest, known.producers)) for slot, digest in node.inputs.items()]),
        _code(known.sources.get(code_digest(node))),
        _log(node.log),
    )


def _film(node: Node, films: Films | None) -> Html | None:
    """The film of a node whose result is a small MP4 file."""
    source = films.mp4(node.fields) if films is not None and node.artifact == "Video" else ""
    if not source:
        return None
    return tag("figure", {"class": "film"}, player(source, f"film of {node.address}"))


def _rows(title: str, rows: list[tuple[str, Child]]) -> Html | None:
    if not rows:
        return None
    listed = [tag("div", None, tag("dt", None, name), tag("dd", None, value)) for name, value in rows]
    return tag("div", None, tag("h4", None, title), tag("dl", {"class": "facts"}, listed))


def _log(log: str) -> Html | None:
    if not log:
        return None
    lines = log.splitlines()
    tail = "\n".join(lines[-_LOG_LINES:])[-_LOG_CHARACTERS:]
    title = "log" if len(lines) <= _LOG_LINES else f"log, last {_LOG_LINES} of {len(lines):,} lines"
    return tag("div", None, tag("h4", None, title), tag("pre", {"tabindex": "0"}, tail))


def _links(addresses: list[str], by_address: Mapping[str, Node]) -> list[Child]:
    out: list[Child] = []
    for address in addresses:
        out += [", " if out else None, link(by_address[address]) if address in by_address else address]
    return out


def _input(digest: str, producers: Mapping[str | None, Node]) -> Child:
    source = producers.get(digest)
    return [_digest(digest), [" from ", link(source)] if source else None]


def _digest(value: str | None) -> Html | None:
    return tag("code", {"title": value}, value[:12]) if value else None


def _version(node: Node) -> str:
    version = node.document.get("version")
    return f", version {version}" if version is not None else ""


def _mapping(node: Node, name: str) -> dict[str, Any]:
    value = node.document.get(name)
    return dict(value) if isinstance(value, Mapping) else {}


def _code(sources: Sources | None) -> Html | None:
    """A link to the files; the panel shows the files themselves."""
    if sources is None:
        return None
    words = count(len(sources.files), "source file")
    anchor = tag("a", {"href": f"#{sources.name}", "data-code": True}, words)
    return tag("div", None, tag("h4", None, "code"), tag("p", None, anchor))


def _json(value: Any) -> Html:
    return tag("code", None, json.dumps(value, ensure_ascii=False))


def _any(value: Child) -> bool:
    if value is None or isinstance(value, str | int):
        return bool(value)
    return any(_any(part) for part in value)
