"""Success of policies that were trained in the twin alone and in both worlds, as bars; DEXTERA, figure 8."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from dextera_build.report.html import Attributes, Html, tag
from dextera_build.report.run import Node, Run
from dextera_build.report.sources import plain
from dextera_build.report.tasks import rate_of, spec
from dextera_build.report.wording import STUB
from dextera_build.statistics import Rate

_MIXTURE = "demonstrate.mixture"
_WORLD = "world"
"""Channel of the kind of the world, which policies of both worlds have alone."""
_TWIN, _REFERENCE = "twin", "reference"
_BAR, _GAP, _TOP, _FOOT = 26, 18, 40, 26
"""Width of a bar, between policies, above 100 % and below 0 % [px]."""
HIGH = 110
"""Height of 100 % [px]."""


@dataclass
class _Trained:
    """A policy of one task on one robot, and its trials."""

    node: Node
    sets: frozenset[str]
    """Digests of the sets that it was trained on: those of a mixture, or one."""
    mixed: bool
    channels: frozenset[str]
    """Its inputs but the kind of the world."""
    label: str
    """Its shortest name in tables."""
    rates: dict[str, Rate] = field(default_factory=dict)
    """World -> its first trials in the run."""

    def without(self, other: _Trained) -> bool:
        """Whether `other` was tried in the same world, and differs only in that it learned one part of the mixture."""
        alike = (self.node.rule, self.channels) == (other.node.rule, other.channels)
        part = self.mixed and not other.mixed and bool(other.sets) and other.sets <= self.sets
        return alike and part and bool(self.rates.keys() & other.rates.keys())


@dataclass
class _Pair:
    """A training in both worlds, and the one in the twin alone to which it is compared."""

    both: _Trained
    alone: _Trained

    @property
    def label(self) -> str:
        """Its shortest name in tables."""
        return min(self.both.label, self.alone.label, key=len)


def charts(run: Run) -> list[Html]:
    """A chart per task and robot on which policies were trained both ways, and what the bars are."""
    tasks: dict[tuple[str, str], dict[str, _Trained]] = {}
    known = run.by_address()
    for node in run.nodes:
        learned = [known[address] for address in node.depends_on if address in known]
        learned = [each for each in learned if each.rule.startswith("learn.")]
        if node.artifact != "Trials" or node.backend == STUB or not learned:
            continue
        place = str(spec(node).get("name", "")), str(node.fields.get("robot", ""))
        _add(tasks.setdefault(place, {}), node, learned[0], known)
    pairs = {place: _pairs(list(policies.values())) for place, policies in tasks.items()}
    found = [_chart(f"{name}, {robot}", compared) for (name, robot), compared in pairs.items() if compared]
    words = "Success [%]. Light: trained in the twin alone; dark: in both worlds. Lines are 95 % intervals (Wilson)."
    return [tag("div", {"class": "charts"}, found), tag("p", {"class": "quiet"}, words)] if found else []


def _add(policies: dict[str, _Trained], node: Node, learned: Node, known: Mapping[str, Node]) -> None:
    label, rate = str(node.fields.get("label", "")), rate_of(node)
    if not rate.trials:
        return
    policy = policies.setdefault(learned.address, _trained(learned, label, known))
    policy.rates.setdefault(str(node.fields.get("world", "")), rate)
    policy.label = min(label, policy.label, key=len)


def _trained(learned: Node, label: str, known: Mapping[str, Node]) -> _Trained:
    data = learned.inputs.get("episodes", "")
    mixture = next((each for each in known.values() if each.rule == _MIXTURE and data and each.output == data), None)
    parts = [known[address].output for address in mixture.depends_on if address in known] if mixture else [data]
    contract = plain(learned.fields.get("contract", {}))
    channels = frozenset(str(channel["name"]) for channel in contract.get("inputs", ())) - {_WORLD}
    return _Trained(learned, frozenset(filter(None, parts)), mixture is not None, channels, label)


def _pairs(policies: Sequence[_Trained]) -> list[_Pair]:
    """Every policy of both worlds beside the first one of the twin alone that is the same otherwise."""
    found = ((one, next((other for other in policies if one.without(other)), None)) for one in policies)
    return [_Pair(both, alone) for both, alone in found if alone is not None]


def _chart(title: str, pairs: Sequence[_Pair]) -> Html:
    tried = {world for pair in pairs for world in (*pair.alone.rates, *pair.both.rates)}
    worlds = sorted(tried, key=lambda world: (world != _TWIN, world))
    wide = _GAP + len(pairs) * (2 * _BAR + _GAP)
    parts = [_half(pairs, world, number * wide, wide) for number, world in enumerate(worlds)]
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


def _half(pairs: Sequence[_Pair], world: str, left: int, wide: int) -> list[Html]:
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
    for number, pair in enumerate(pairs):
        x = left + _GAP + number * (2 * _BAR + _GAP)
        for place, policy in enumerate((pair.alone, pair.both)):
            rate = policy.rates.get(world)
            parts += [] if rate is None else _bar(rate, x + place * _BAR, policy.mixed)
        words: Attributes = {"x": x + _BAR, "y": base + 17, "class": "sub", "text-anchor": "middle"}
        parts.append(tag("text", words, pair.label))
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
