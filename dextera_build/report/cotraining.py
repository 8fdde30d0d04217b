"""Success of policies that were trained in the twin alone and in both worlds, as bars; DEXTERA, figure 8."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from dextera_build.report.html import Attributes, Html, tag
from dextera_build.report.layout import made_from
from dextera_build.report.run import Node, Run
from dextera_build.report.tasks import rate_of, spec
from dextera_build.report.wording import STUB
from dextera_build.statistics import Rate

_MIXTURE = "demonstrate.mixture"
_TWIN, _REFERENCE = "twin", "reference"
_BAR, _GAP, _TOP, _FOOT = 26, 18, 40, 26
"""Width of a bar, between policies, above 100 % and below 0 % [px]."""
HIGH = 110
"""Height of 100 % [px]."""


@dataclass
class _Task:
    """Trials of one task on one robot."""

    rates: dict[tuple[str, str, bool], Rate] = field(default_factory=dict)
    """(algorithm, world, whether both worlds were trained on) -> its first trials in the run."""
    labels: dict[str, str] = field(default_factory=dict)
    """Algorithm -> its shortest name in tables."""

    @property
    def compared(self) -> list[str]:
        """Algorithms that were trained both ways and tried in one world."""
        both = [a for a, world, mixed in self.rates if mixed and (a, world, False) in self.rates]
        return list(dict.fromkeys(both))


def charts(run: Run) -> list[Html]:
    """A chart per task and robot on which policies were trained both ways, and what the bars are."""
    tasks: dict[tuple[str, str], _Task] = {}
    mixed = made_from(run, _MIXTURE)
    known = run.by_address()
    for node in run.nodes:
        learned = [known[address] for address in node.depends_on if address in known]
        learned = [each for each in learned if each.rule.startswith("learn.")]
        if node.artifact != "Trials" or node.backend == STUB or not learned:
            continue
        place = str(spec(node).get("name", "")), str(node.fields.get("robot", ""))
        _add(tasks.setdefault(place, _Task()), node, learned[0].address in mixed)
    found = [_chart(f"{name}, {robot}", task) for (name, robot), task in tasks.items() if task.compared]
    words = "Success [%]. Light: trained in the twin alone; dark: in both worlds. Lines are 95 % intervals (Wilson)."
    return [tag("div", {"class": "charts"}, found), tag("p", {"class": "quiet"}, words)] if found else []


def _add(task: _Task, node: Node, mixed: bool) -> None:
    algorithm, label = str(node.fields.get("algorithm", "")), str(node.fields.get("label", ""))
    rate = rate_of(node)
    if rate.trials:
        task.rates.setdefault((algorithm, str(node.fields.get("world", "")), mixed), rate)
        task.labels[algorithm] = min(label, task.labels.get(algorithm, label), key=len)


def _chart(title: str, task: _Task) -> Html:
    worlds = sorted({world for _, world, _ in task.rates}, key=lambda world: (world != _TWIN, world))
    wide = _GAP + len(task.compared) * (2 * _BAR + _GAP)
    parts = [_half(task, world, number * wide, wide) for number, world in enumerate(worlds)]
    width, height = len(worlds) * wide, _TOP + HIGH + _FOOT
    told = f"success of policies in {title}"
    view: Attributes = {
        "viewBox": f"0 0 {width} {height}",
        "width": width,
        "height": height,
        "role": "img",
        "aria-label": told,
    }
    return tag("figure", None, tag("svg", view, parts), tag("figcaption", None, tag("b", None, title)))


def _half(task: _Task, world: str, left: int, wide: int) -> list[Html]:
    """The bars of one world; all but the twin are shaded."""
    name = f"{world}, simulated" if world == _REFERENCE else world
    back: Attributes = {
        "x": left,
        "y": 0,
        "width": wide,
        "height": _TOP + HIGH + _FOOT,
        "class": f"lane l{int(world != _TWIN)}",
    }
    base = _TOP + HIGH
    parts = [
        tag("rect", back),
        tag("text", {"x": left + wide / 2, "y": 14, "text-anchor": "middle"}, name),
        tag("line", {"x1": left, "x2": left + wide, "y1": base, "y2": base, "class": "grid"}),
    ]
    for number, algorithm in enumerate(task.compared):
        x = left + _GAP + number * (2 * _BAR + _GAP)
        for place, mixed in enumerate((False, True)):
            rate = task.rates.get((algorithm, world, mixed))
            parts += [] if rate is None else _bar(rate, x + place * _BAR, mixed)
        words: Attributes = {"x": x + _BAR, "y": base + 17, "class": "sub", "text-anchor": "middle"}
        parts.append(tag("text", words, task.labels[algorithm]))
    return parts


def _bar(rate: Rate, x: int, mixed: bool) -> Sequence[Html]:
    low, high = (_height(each) for each in rate.interval())
    top, middle = _height(rate.value), x + _BAR / 2
    shape: Attributes = {
        "x": x + 2,
        "y": top,
        "width": _BAR - 4,
        "height": _TOP + HIGH - top,
        "class": f"success {'both' if mixed else 'one'}",
    }
    return [
        tag("rect", shape, tag("title", None, f"{rate.successes} of {rate.trials}")),
        tag("line", {"x1": middle, "x2": middle, "y1": high, "y2": low, "class": "interval"}),
        tag("text", {"x": middle, "y": high - 4, "class": "sub", "text-anchor": "middle"}, f"{100 * rate.value:.0f}"),
    ]


def _height(value: float) -> float:
    return _TOP + HIGH * (1 - value)
