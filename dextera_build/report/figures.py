"""The figures of the paper (DEXTERA, figures 1 to 8), composed of the pictures that the nodes of a run made.

A run shows the figures for which it has nodes. Pictures from simulated worlds are labelled `simulated`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

from dextera_build.report import cotraining
from dextera_build.report.html import Html, tag
from dextera_build.report.layout import made_from, topological
from dextera_build.report.objects import foremost
from dextera_build.report.pictures import Pictures
from dextera_build.report.pieces import link
from dextera_build.report.run import Node, Run
from dextera_build.report.tasks import spec
from dextera_build.report.wording import STUB, count

MOST = 6
"""Pictures of a panel; the others stand with their nodes."""
_REFERENCE = "reference."
"""Rules of the world that replaces hardware."""
_TASKS = ("simulate.task", "simulate.perturbed", "reference.task")
_FIRST = ("factorize.segment", "align.robot_camera", *_TASKS)
"""Rules whose first picture is the figure's; of other rules it is the last."""
_ROWS = 4  # objects in the comparison of methods


@dataclass(frozen=True)
class Panel:
    """Pictures of one kind."""

    title: str
    rules: tuple[str, ...]
    """Rules whose nodes have them, in the order in which they are shown."""
    sight: bool = True
    """Whether they show what a camera saw, which is simulated if any node behind them is of the world that replaces
    hardware; else only they and the nodes that they read count."""
    alone: bool = True
    """Whether the figure is shown without pictures of other panels."""
    height: int = 165
    """Of its pictures [px]."""


_Picture: TypeAlias = tuple[Node, str, str]
"""Node, caption, digest."""
_CAMERAS = ("capture.folder", "capture.recorded_picture", "reference.photograph")
_PANELS: dict[tuple[int, str], tuple[Panel, ...]] = {
    (1, "Factorization of the photograph"): (
        Panel("(a) Elements", ("factorize.parse",)),
        Panel(
            "(b) Objects",
            ("factorize.segment", "factorize.complete", "factorize.mesh", "factorize.articulate"),
            height=130,
        ),
        Panel(
            "(c) Static scene", ("background.static", "background.panorama", "background.expand", "background.compose")
        ),
    ),
    (2, "Metric alignment"): (
        Panel("(d) Static scene", ("align.scene", "align.support")),
        Panel("(e) Robot", ("align.hand_eye", "align.robot_camera")),
        Panel("(f) Objects", ("align.object", "align.canonical")),
    ),
    (3, "Simulation and tasks"): (
        Panel("(g) Simulated scene", ("evaluate.overlay", "evaluate.room"), height=560),
        Panel("(h) Tasks", _TASKS, sight=False),
    ),
    (4, "Robots and their workspaces"): (
        Panel("Robots", ("simulate.robot", "simulate.mesh_robot", "simulate.imported_robot"), sight=False),
        Panel("Workspaces", _CAMERAS, alone=False),
    ),
    (5, "Twin and photograph: colours, masks, depth"): (Panel("", ("benchmark.modalities",), height=640),),
    (7, "The same task in both worlds"): (
        Panel("Replays", ("evaluate.replay",), sight=False, height=280),
        Panel(
            "Demonstrations and episodes", ("demonstrate.film", "demonstrate.recorded_film"), sight=False, height=140
        ),
        Panel("Policies", ("evaluate.rollouts",), sight=False),
    ),
}
_METHODS, _CO_TRAINING = (6, "Meshes by method"), (8, "Training in the twin alone, and in both worlds")


def figures(run: Run, pictures: Pictures) -> tuple[list[Html], set[str]]:
    """The figures of a run, by number, and the digests of the pictures in them.

    Args:
        run: The run.
        pictures: Pictures of the store.
    """
    shown = _Shown(run, pictures)
    found = {key: shown.figure(panels) for key, panels in _PANELS.items()}
    found[6, "Meshes by method"] = shown.methods()
    found[8, "Training in the twin alone, and in both worlds"] = cotraining.charts(run)
    return [_figure(*key, parts) for key, parts in sorted(found.items()) if parts], shown.digests


def _figure(number: int, title: str, parts: Sequence[Html]) -> Html:
    heading = tag("h3", None, title, " ", tag("span", {"class": "sub"}, f"figure {number} of the paper"))
    return tag("div", {"class": "card", "id": f"figure{number}"}, heading, tag("div", {"class": "panels"}, parts))


class _Shown:
    """The nodes of a run whose pictures are shown, those of stub backends left out."""

    def __init__(self, run: Run, pictures: Pictures) -> None:
        self.digests: set[str] = set()
        """Pictures in the figures so far."""
        self._pictures = pictures
        self._nodes = [node for node in topological(run.nodes) if node.previews and node.backend != STUB]
        reference = {node.address for node in run.nodes if node.rule.startswith(_REFERENCE)}
        self._read = {address for node in run.nodes for address in node.depends_on}
        self._of_sight = made_from(run, _REFERENCE)
        self._of_world = {
            node.address for node in run.nodes if reference.intersection([node.address, *node.depends_on])
        }

    def figure(self, panels: Sequence[Panel]) -> list[Html]:
        """The panels for which there are pictures; none if only those are left that do not stand alone."""
        found = [(panel, self._found(panel)) for panel in panels]
        if not any(any(pictures) and panel.alone for panel, pictures in found):
            return []
        return [self._panel(panel, pictures) for panel, pictures in found if any(pictures)]

    def methods(self) -> list[Html]:
        """A row per object that several backends of `factorize.mesh` made, and a column per backend."""
        made: dict[tuple[str, ...], dict[str, Node]] = {}
        for node in self._nodes:
            if node.rule == "factorize.mesh" and node.backend:
                made.setdefault(node.labels, {}).setdefault(node.backend, node)
        several = {labels: nodes for labels, nodes in made.items() if len(nodes) > 1}
        rows = sorted(several.items(), key=lambda item: -len(item[1]))[:_ROWS]
        if not rows:
            return []
        methods = list(dict.fromkeys(method for _, nodes in rows for method in nodes))
        head = tag("tr", None, tag("th"), [tag("th", {"scope": "col"}, method) for method in methods])
        body = []
        for labels, nodes in rows:
            cells = [self._cell(nodes.get(method)) for method in methods]
            body.append(tag("tr", None, tag("th", {"scope": "row"}, " ".join(labels)), cells))
        table = tag("table", {"class": "methods"}, tag("thead", None, head), tag("tbody", None, body))
        left = _left(len(several) - len(rows), "object")
        return [tag("div", None, tag("div", {"class": "scroll", "tabindex": "0"}, table), left)]

    def _found(self, panel: Panel) -> list[list[_Picture]]:
        """Per rule one picture per node; equal ones once, and one per copy: that which other nodes read, if any."""
        found: list[list[_Picture]] = []
        seen: set[str] = set()
        for rule in panel.rules:
            mine = sorted((n for n in self._nodes if n.rule == rule), key=lambda node: node.address not in self._read)
            first = {node.labels or node.address: node.address for node in reversed(mine)}
            found.append([])
            chosen = set(first.values())
            for node in (node for node in self._nodes if node.address in chosen):
                caption, digest = node.previews[0] if rule in _FIRST else foremost(node)
                if digest not in seen:
                    found[-1].append((node, caption, digest))
                seen.add(digest)
        return found

    def _panel(self, panel: Panel, found: Sequence[Sequence[_Picture]]) -> Html:
        simulated = self._of_sight if panel.sight else self._of_world
        figures = [self._picture(*each, simulated, note=_note(each[0])) for each in _few(found)]
        row = tag("div", {"class": "pictures", "style": f"--height:{panel.height}px"}, figures)
        title = tag("h4", None, panel.title) if panel.title else None
        return tag("div", None, title, row, _left(sum(map(len, found)) - len(figures), "picture"))

    def _cell(self, node: Node | None) -> Html:
        if node is None:
            return tag("td", {"class": "quiet"}, "–")
        caption, digest = foremost(node)
        return tag("td", None, self._picture(node, caption, digest, self._of_sight), link(node, node.name))

    def _picture(self, node: Node, caption: str, digest: str, simulated: set[str], note: str = "") -> Html:
        self.digests.add(digest)
        return self._pictures.figure(
            digest,
            caption,
            size="small" if node.labels else "large",
            note=note,
            name=node.address,
            simulated=node.address in simulated,
        )


def _few(found: Sequence[Sequence[_Picture]]) -> list[_Picture]:
    """At most `MOST` pictures: of each rule the first ones, as equally many as there are."""
    ranked = sorted((place, rule) for rule, pictures in enumerate(found) for place in range(len(pictures)))
    return [found[rule][place] for rule, place in sorted((rule, place) for place, rule in ranked[:MOST])]


def _left(number: int, noun: str) -> Html | None:
    return tag("p", {"class": "quiet"}, f"{count(number, f'more {noun}')} below") if number > 0 else None


def _note(node: Node) -> str:
    """The object or the task that a picture is of, and the node."""
    task = str(spec(node).get("name", "")) if node.artifact == "TaskBundle" else ""
    return " ".join(part for part in (*node.labels[-1:], task, node.name) if part)
