"""Provenance of the result: rules, backends, packages, licences, inputs; and the commands to reproduce it."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import dataclass

from dextera_build import digest as digests
from dextera_build.report.html import Child, Html, tag
from dextera_build.report.run import Node, Run
from dextera_build.report.wording import count, some


def provenance(run: Run, licences: Mapping[str, str]) -> list[Html]:
    """Tables of rules, of packages and of inputs from outside the graph.

    Args:
        run: The run.
        licences: `rule:backend` or distribution -> licence, if known to the caller.
    """
    return [table for table in (_rules(run, licences), _packages(run, licences), _inputs(run), _code(run)) if table]


def reproduce(run: Run) -> Html:
    """The commands that reproduce this result and show it."""
    argv = ["dxb", *run.argv] if run.argv else ["dxb", "build", run.recipe]
    commands = [
        (f"pip install 'dextera_build-{run.dxb}-py3-none-any.whl[twin]'", "the same program, from its wheel"),
        (shlex.join(argv), "the same build; cached nodes do not run"),
        (f"dxb plan {shlex.quote(run.recipe)}", "the plan of a build now"),
        (f"dxb view {shlex.quote(run.recipe)}", "the result in three dimensions"),
        (f"dxb report {shlex.quote(run.name)}", "this page"),
    ]
    width = max(len(command) for command, _ in commands)
    lines = [
        [command.ljust(width), tag("span", {"class": "remark"}, f"  # {words}"), "\n"] for command, words in commands
    ]
    return tag("pre", {"class": "commands", "tabindex": "0"}, lines)


@dataclass
class Sources:
    """The source files that one or several rules consist of."""

    name: str
    """Anchor in the page."""
    files: dict[str, object]
    """File -> definitions with their digests."""
    rules: set[str]
    """`rule` or `rule, backend`."""


def code_digest(node: Node) -> str:
    """Digest of a node's code; empty if the key document is not known."""
    code = node.document.get("code")
    return digests.of_value(code) if isinstance(code, Mapping) else ""


def sources_of(run: Run) -> dict[str, Sources]:
    """Code digest -> files: nodes of one rule share them, so they are written once."""
    found: dict[str, Sources] = {}
    for node in run.nodes:
        digest = code_digest(node)
        if digest:
            entry = found.setdefault(digest, Sources(f"c{len(found)}", dict(node.document["code"]), set()))
            entry.rules.add(f"{node.rule}, {node.backend}" if node.backend else node.rule)
    return found


def _rules(run: Run, licences: Mapping[str, str]) -> Html | None:
    found: dict[tuple[str, str], list[str]] = {}
    versions: dict[tuple[str, str], str] = {}
    for node in run.nodes:
        place = (node.rule, node.backend or "")
        found.setdefault(place, []).append(node.address)
        versions[place] = str(node.document.get("version", "")) or versions.get(place, "")
    known = any(licences.get(f"{rule}:{backend}") for rule, backend in found)
    rows: list[list[Child]] = [
        [
            rule,
            versions[rule, backend] or "–",
            backend or "–",
            run.chosen.get(f"{rule}: {backend}", "–"),
            str(len(nodes)),
            *_licence(licences, f"{rule}:{backend}", known),
        ]
        for (rule, backend), nodes in sorted(found.items())
    ]
    return _table(
        "Rules and backends",
        ["rule", "version", "backend", "chosen by", "nodes", *(["licence"] if known else [])],
        rows,
    )


def _packages(run: Run, licences: Mapping[str, str]) -> Html | None:
    found: dict[tuple[str, str], set[str]] = {}
    for node in run.nodes:
        packages = node.document.get("packages")
        for name, version in packages.items() if isinstance(packages, Mapping) else ():
            found.setdefault((str(name), str(version)), set()).add(node.rule)
    known = any(name in licences for name, _ in found)
    rows: list[list[Child]] = [
        [name, version, some(sorted(rules), 4), *_licence(licences, name, known)]
        for (name, version), rules in sorted(found.items())
    ]
    return _table("Packages", ["package", "version", "used by", *(["licence"] if known else [])], rows)


def _inputs(run: Run) -> Html | None:
    made = {node.output for node in run.nodes}
    found: dict[str, set[str]] = {}
    for node in run.nodes:
        # A projection (`$capture.camera`) has its own digest but is not an external input: its node depends on another.
        if node.depends_on:
            continue
        for slot, digest in node.inputs.items():
            if digest not in made:
                found.setdefault(digest, set()).add(f"{node.address}.{slot}")
    rows: list[list[Child]] = [
        [", ".join(sorted(slots)), tag("code", {"class": "long"}, digest)] for digest, slots in found.items()
    ]
    return _table("Inputs", ["taken as", "SHA-256"], rows)


def _licence(licences: Mapping[str, str], name: str, known: bool) -> list[Child]:
    return [licences.get(name, "–")] if known else []


def _code(run: Run) -> Html | None:
    """The files of every rule, folded."""
    folded = [
        tag(
            "details",
            {"id": sources.name},
            tag("summary", None, f"{some(sorted(sources.rules), 3)}: {count(len(sources.files), 'source file')}"),
            tag("dl", {"class": "facts wide"}, [_file(file, parts) for file, parts in sources.files.items()]),
        )
        for sources in sources_of(run).values()
    ]
    return tag("div", {"class": "card code"}, tag("p", None, tag("b", None, "Code")), folded) if folded else None


def _file(file: str, parts: object) -> Html:
    value = digests.of_value(parts)
    size = f" {count(len(parts), 'definition')}" if isinstance(parts, Mapping) else ""
    return tag("div", None, tag("dt", None, file), tag("dd", None, tag("code", {"title": value}, value[:12]), size))


def _table(title: str, head: list[str], rows: list[list[Child]]) -> Html | None:
    if not rows:
        return None
    table = tag(
        "table",
        None,
        tag("caption", None, tag("b", None, title)),
        tag("thead", None, tag("tr", None, [tag("th", {"scope": "col"}, name) for name in head])),
        tag("tbody", None, [tag("tr", None, [tag("td", None, cell) for cell in row]) for row in rows]),
    )
    return tag("div", {"class": "card"}, tag("div", {"class": "scroll", "tabindex": "0"}, table))
