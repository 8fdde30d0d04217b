"""The task gallery: one card per task with its picture and film, its goal, and its success rates."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from dextera_build.report.films import Films, player
from dextera_build.report.html import Html, tag
from dextera_build.report.pictures import Pictures
from dextera_build.report.pieces import link
from dextera_build.report.run import Node, Run
from dextera_build.report.sources import plain
from dextera_build.statistics import Rate

_BUNDLE, _OPERATE = "TaskBundle", "demonstrate.operate"


def cards(run: Run, pictures: Pictures, films: Films | None) -> list[Html]:
    """A card per task, by name; its worlds share one.

    Args:
        run: The run.
        pictures: Pictures of the store.
        films: Films of the store; None leaves them out.
    """
    worlds: dict[str, list[Node]] = {}
    for node in run.nodes:
        if node.artifact == _BUNDLE and node.output:
            worlds.setdefault(str(spec(node).get("name", node.name)), []).append(node)
    return [_card(run, pictures, films, name, nodes) for name, nodes in sorted(worlds.items())]


def _card(run: Run, pictures: Pictures, films: Films | None, name: str, bundles: list[Node]) -> Html:
    # The twin first: it is the task, and the others are where it is tried.
    bundles = sorted(bundles, key=lambda node: node.fields.get("kind") != "twin")
    first = bundles[0]
    task = spec(first)
    goal = plain(task.get("goal", {}))
    facts = [
        ("primitive", str(goal.get("primitive", ""))),
        ("object", str(task.get("object", ""))),
        ("robot", _robot(run, first)),
        ("time limit", f"{task['timeout_s']:g} s" if "timeout_s" in task else ""),
        ("worlds", ", ".join(str(node.fields.get("kind", "")) for node in bundles)),
    ]
    listed = [tag("div", None, tag("dt", None, word), tag("dd", None, text)) for word, text in facts if text]
    rates = list(_rates(run, bundles))
    rows = [_row(*each) for each in rates]
    return tag(
        "article",
        {"class": "card task"},
        _shown(run, pictures, films, bundles, float(task.get("control_hz", 20.0))),
        tag("h3", None, link(first, name)),
        tag("dl", {"class": "facts"}, listed),
        tag("table", {"class": "rates"}, tag("tbody", None, rows)) if rows else None,
    )


def _shown(run: Run, pictures: Pictures, films: Films | None, bundles: list[Node], rate_hz: float) -> Html | None:
    """The film of the task's episodes, else the picture of the task."""
    outputs = {node.output for node in bundles}
    filmed = [node for node in run.nodes if node.artifact == "Film" and outputs & set(node.inputs.values())]
    for node in sorted(filmed, key=lambda node: -int(node.fields.get("width", 0))):
        if (found := _film(node, films, rate_hz)) is not None:
            return found
    for node in bundles:
        for caption, digest in node.previews[:1]:
            return tag("div", {"class": "shot"}, pictures.figure(digest, caption, note=node.name, name=node.address))
    return None


def _film(node: Node, films: Films | None, rate_hz: float) -> Html | None:
    index, source = ("", "") if films is None else films.uri(node.fields, rate_hz)
    if not source:
        return None
    about = f"film of episode {index} of {node.address}"
    video = player(source, about, int(node.fields.get("width", 0)))
    words = tag("figcaption", None, tag("b", None, node.name), f" episode {index}")
    return tag("figure", {"class": "shot film"}, video, words)


def _rates(run: Run, bundles: list[Node]) -> Iterator[tuple[Node, str, str, Rate, float | None]]:
    """Node, actor, world, successes and, if known, mean progress of every expert and policy that tried the task."""
    kinds = {node.output: str(node.fields.get("kind", "")) for node in bundles}
    for node in run.nodes:
        here = [digest for digest in node.inputs.values() if digest in kinds]
        if not here or not node.output:
            continue
        if node.rule == _OPERATE:
            done = len(plain(node.fields.get("items", {})))
            who = "operator's hands" if "recording" in node.inputs else "scripted operator"
            yield node, who, kinds[here[0]], Rate(done, int(node.fields.get("attempts", done))), None
        elif node.artifact == "Trials":
            trials = _trials(node)
            steps = len(trials) * len(plain(node.fields.get("stages", [])))
            progress = sum(int(trial.get("stage", 0)) for trial in trials) / steps if steps else None
            tracked = ", tracked" if node.fields.get("poses") == "tracked" else ""
            yield (
                node,
                str(node.fields.get("label", "")) + tracked,
                str(node.fields.get("world", "")),
                rate_of(node),
                progress,
            )


def rate_of(node: Node) -> Rate:
    """Successes of `Trials`, by their header."""
    trials = _trials(node)
    return Rate(sum(bool(trial.get("success")) for trial in trials), len(trials))


def _trials(node: Node) -> list[dict[str, Any]]:
    return [trial for trial in plain(node.fields.get("items", [])) if isinstance(trial, dict)]


def _row(node: Node, who: str, world: str, rate: Rate, progress: float | None) -> Html:
    low, high = (100 * each for each in rate.interval())
    span = tag("i", {"style": f"left:{low:.1f}%;width:{high - low:.1f}%"})
    point = tag("b", {"style": f"left:{100 * rate.value:.1f}%"})
    words = f"{rate.successes}/{rate.trials}"
    return tag(
        "tr",
        None,
        tag("th", {"scope": "row"}, link(node, who), tag("span", {"class": "sub"}, f" {world}")),
        tag("td", {"class": "number"}, words),
        tag("td", None, tag("span", {"class": "rate", "aria-hidden": "true"}, span, point)),
        tag("td", {"class": "number sub", "title": "95 % interval (Wilson)"}, f"{low:.0f}–{high:.0f} %"),
        tag(
            "td",
            {"class": "number sub", "title": "mean fraction of the stages that trials reached"},
            "" if progress is None else f"progress {100 * progress:.0f} %",
        ),
    )


def spec(node: Node) -> dict[str, Any]:
    """The task of a `TaskBundle` or of `Trials`, by its header."""
    found = plain(node.fields.get("task", {}))
    return found if isinstance(found, dict) else {}


def _robot(run: Run, bundle: Node) -> str:
    """Name of the recipe that the robot comes from, or of its node."""
    value = bundle.fields.get("robot")
    digest = value.get("$ref") if isinstance(value, dict) else None
    made = next((node for node in run.nodes if node.output and node.output == digest), None)
    if made is None:
        return ""
    recipe, _, name = made.address.rpartition(":")
    return recipe.rpartition("/")[2] or name
