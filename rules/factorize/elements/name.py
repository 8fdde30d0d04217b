"""factorize.name: assign the names of a recipe to segmented objects."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import NoReturn

import numpy as np
from pydantic import Field, NonNegativeInt

from dextera_build.artifacts.cameras.camera import Photograph
from dextera_build.artifacts.objects.view import Instance, Segmentation
from dextera_build.errors import RuleError
from dextera_build.geometry import pictures
from dextera_build.rule import Context, Options, rule

from ..masks.marking import named
from ..regions.proposals import colour_lab
from .naming import colour_word, unique


class LockedPoint(Options):
    """A point of an object in one photograph, from `dxb.lock`."""

    at_px: tuple[NonNegativeInt, NonNegativeInt]
    """Column and row [px]."""
    photograph: str = Field(pattern="^[0-9a-f]{64}$")
    """Digest of the photograph's pixels."""


class Binding(Options):
    """Identification of an object: by `at_px`, else by `locked` on its photograph, else by all other properties."""

    phrase: str = ""
    """Words that match its phrase, name, category, material and colour: `blue mug`. The whole phrase is matched
    first, then words."""
    category: str = ""
    """Category: `mug`."""
    material: str = ""
    """Material: `ceramic`."""
    colour: str = ""
    """Most frequent colour of its pixels: `blue`."""
    at_px: tuple[NonNegativeInt, NonNegativeInt] | None = None
    """Column and row of one of its pixels in the photograph [px]; independent of the phrase that parsing assigned."""
    locked: LockedPoint | None = None
    """Point found earlier, written to `dxb.lock` by `dxb bind`; ignored on another photograph."""

    @property
    def has_properties(self) -> bool:
        """Whether it has properties that identify an object on any photograph."""
        return bool(self.phrase or self.category or self.material or self.colour)


class NameOptions(Options):
    """Options of factorize.name."""

    names: dict[str, Binding] = Field({})
    """Name -> how the object is identified: `blue_mug: {phrase: blue mug}`."""


@dataclass(frozen=True)
class _Candidate:
    """An instance with the properties that bindings are matched with."""

    label: int
    name: str
    instance: Instance
    colour: str
    point: tuple[int, int]
    """Column and row of the pixel that is farthest from the mask's border [px]."""

    def fits(self, binding: Binding) -> int:
        """0: no match; 1: all given properties and the words of the phrase match; 2: the whole phrase, too."""
        traits = self.instance.traits
        said = (binding.category, traits.category), (binding.material, traits.material), (binding.colour, self.colour)
        if any(wanted and _words(wanted) != _words(own) for wanted, own in said):
            return 0
        wanted = _words(binding.phrase)
        if not wanted or wanted in (_words(self.name), _words(self.instance.view.phrase)):
            return 2
        known = " ".join((self.name, self.instance.view.phrase, traits.category, traits.material, self.colour))
        return int(set(wanted) <= set(_words(known)))

    def __str__(self) -> str:
        """The properties, for an error."""
        traits = self.instance.traits
        return (
            f"phrase `{self.instance.view.phrase}`, category {traits.category}, material {traits.material}, "
            f"colour {self.colour}, at_px [{self.point[0]}, {self.point[1]}]"
        )


@rule(version=1, packages=("opencv-python-headless",))
def name(
    ctx: Context, photograph: Photograph, objects: Segmentation, *, options: NameOptions | None = None
) -> Segmentation:
    """Return the segmentation with the objects under the names that `names` binds; pixels and map are unchanged.

    Each name is bound to exactly one object, whose phrase becomes the binding's, or else the words of the name; the
    phrase from parsing is dropped. Objects without a binding keep their names, with a number if the name is bound to
    another object.

    A point of `dxb.lock` applies only to the photograph it was found on. On another photograph the properties are
    matched instead, with a note in the log.

    Raises:
        RuleError: A name fits no object or several, or two names fit the same one (DXB-B383); a name has no more than
            a point on another photograph (DXB-B384).
    """
    bindings = (options or NameOptions()).names
    known = _candidates(photograph, objects)
    bindings, stale = _on(photograph, bindings, known)
    bound: dict[int, str] = {}
    for wanted, binding in bindings.items():
        found = _bind(wanted, binding, known, objects.map.labels)
        if found.label in bound:
            _refuse(
                f"`{bound[found.label]}` and `{wanted}` are bound to the same object",
                [found],
                "remove one of the two names, or bind it by `at_px`",
            )
        bound[found.label] = wanted
    taken = set(bindings)
    names = tuple(bound.get(one.label) or unique(one.name, taken) for one in known)
    items = {}
    for one, label in zip(known, names, strict=True):
        phrase = one.instance.view.phrase
        if one.label in bound:
            phrase = bindings[label].phrase or label.replace("_", " ")
        view = one.instance.view.model_copy(update={"phrase": phrase})
        items[label] = one.instance.model_copy(update={"view": view})
    renamed = [f"{one.name} is {label}" for one, label in zip(known, names, strict=True) if one.name != label]
    said = [", ".join(renamed) or f"{len(names)} as parsed"]
    if stale:
        said.append(
            f"not the photograph of `dxb.lock`, so by property: {', '.join(stale)}; `dxb bind` renews the points"
        )
    ctx.say("; ".join(said))
    points = {label: one.point for label, one in zip(names, known, strict=True)}
    ctx.preview(named(photograph.rgb.pixels, objects.map.labels, points), "names, each with a point for `at_px`")
    return objects.model_copy(update={"items": items, "names": names})


def _on(
    photograph: Photograph, bindings: dict[str, Binding], known: list[_Candidate]
) -> tuple[dict[str, Binding], list[str]]:
    """The bindings with `locked` points as `at_px`, and the names whose points belong to another photograph."""
    if not any(binding.locked for binding in bindings.values()):
        return bindings, []
    this, stale, found = pictures.digest_of(photograph.rgb.pixels), list[str](), dict[str, Binding]()
    for wanted, binding in bindings.items():
        point, found[wanted] = binding.locked, binding
        if point is None or binding.at_px is not None:
            continue
        if point.photograph == this:
            found[wanted] = binding.model_copy(update={"at_px": point.at_px})
        elif binding.has_properties:
            stale.append(wanted)
        else:
            raise RuleError(
                f"the name `{wanted}` is bound by a point on another photograph",
                code="DXB-B384",
                facts={"point": f"[{point.at_px[0]}, {point.at_px[1]}]"} | {one.name: str(one) for one in known},
                hint=f"`dxb bind TARGET {wanted} --at COLUMN,ROW` binds it on this photograph, `--phrase` on any",
            )
    return found, stale


def _bind(wanted: str, binding: Binding, known: list[_Candidate], labels: np.ndarray) -> _Candidate:
    if not re.fullmatch("[a-z_][a-z0-9_]*", wanted):
        raise RuleError(
            f"`{wanted}` is not a name",
            code="DXB-B383",
            hint="lower-case letters, digits and `_`, not starting with a digit",
        )
    if not (binding.has_properties or binding.at_px):
        _refuse(f"the name `{wanted}` has no property of its object", known, "give `phrase`, a property or `at_px`")
    if binding.at_px is not None:
        return _at(wanted, binding.at_px, known, labels)
    ranks = {one.label: one.fits(binding) for one in known}
    best = max(ranks.values())
    found = [one for one in known if best and ranks[one.label] == best]
    if not found:
        _refuse(f"no object fits the name `{wanted}`", known, "change the phrase or the property, or give `at_px`")
    if len(found) > 1:
        _refuse(
            f"{len(found)} objects fit the name `{wanted}`",
            found,
            "add a property, or give the `at_px` of the right one",
        )
    return found[0]


def _at(wanted: str, at: tuple[int, int], known: list[_Candidate], labels: np.ndarray) -> _Candidate:
    column, row = at
    height, width = labels.shape
    if column >= width or row >= height:
        raise RuleError(
            f"the point of the name `{wanted}` is outside the photograph",
            code="DXB-B383",
            facts={"at_px": f"[{column}, {row}]", "photograph": f"{width} x {height} px"},
            hint="`at_px` is [column, row] in the photograph",
        )
    label = int(labels[row, column])
    if not label:
        _refuse(
            f"no object is at the point [{column}, {row}] of the name `{wanted}`",
            known,
            "give the `at_px` of one of these; another photograph needs another point",
        )
    return known[label - 1]


def _refuse(message: str, known: list[_Candidate], hint: str) -> NoReturn:
    raise RuleError(message, code="DXB-B383", facts={one.name: str(one) for one in known}, hint=hint)


def _candidates(photograph: Photograph, objects: Segmentation) -> list[_Candidate]:
    lab = colour_lab(photograph.rgb.pixels)
    found = []
    for label, own in enumerate(objects.names, start=1):
        mask = objects.map.labels == label
        colour = colour_word(lab[mask])
        found.append(_Candidate(label, own, objects.items[own], colour, pictures.innermost(mask)))
    return found


def _words(text: str) -> list[str]:
    return re.findall("[a-z0-9]+", text.lower())
