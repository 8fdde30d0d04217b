"""Completion of command lines, called by argcomplete on behalf of the shell.

No rule is imported and nothing is planned: recipes are listed, one is read, and nodes come from its past builds.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from dextera_build.cli.verbs import VERBS
from dextera_build.project.project import find


def answer() -> int:
    """Print the completions of the line in the environment and exit; return the exit code if that fails."""
    import argcomplete

    from dextera_build.cli.grammar import parser

    line = os.environ["COMP_LINE"][: int(os.environ["COMP_POINT"])]
    verb = next((word for word in line.split()[1:] if not word.startswith("-")), "")
    top = parser(verb)
    _equip(top)
    with suppress(Exception):  # an error of a recipe or setting would be printed into the line being typed
        argcomplete.autocomplete(top, always_complete_options=False)
    return 1


def _equip(parser: argparse.ArgumentParser) -> None:
    """Give every argument its completer, by its name or metavar."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for sub in set(action.choices.values()):
                _equip(sub)
        else:
            found = _COMPLETERS.get(action.dest) or _COMPLETERS.get(str(action.metavar))
            if found is not None:
                action.completer = found  # type: ignore[attr-defined]


def _targets(prefix: str, **_: Any) -> list[str]:
    recipe, colon, _rest = prefix.partition(":")
    return [f"{recipe}:{node}" for node in _nodes(recipe)] if colon else _recipes()


def _recipes() -> list[str]:
    return [address for address, _ in find().recipes()]


def _rules(**_: Any) -> list[str]:
    return [found.path for found in find().library.rules()]


def _nodes(address: str) -> list[str]:
    """Targets and nodes that a recipe declares, and its built nodes."""
    from dextera_build.session import Session

    project = find()
    recipe = project.recipe(address)
    if recipe is None:
        return []
    built = Session(project, address, last=True).history
    own = [name for name in built if name.split(".")[0].split("[")[0] in recipe.nodes]
    return list(dict.fromkeys((*recipe.targets, *recipe.nodes, *own)))


def _runs(**_: Any) -> dict[str, str]:
    from dextera_build.explain.runs import runs
    from dextera_build.report.wording import moment

    found = {row["run"]: f"{row['recipe']}, {moment(row['time'])}" for row in runs(find())}
    return found | dict.fromkeys(_recipes(), "the last run of this recipe")


def _in_run(parsed_args: argparse.Namespace, **_: Any) -> list[str]:
    from dextera_build.explain import runs

    # argcomplete also completes the second word of `dxb log` while the first is typed.
    events = runs.find(find(), parsed_args.run)[1] if parsed_args.run else []
    return [event["node"] for event in events if event["event"] == "node_finished"]


def _backends(prefix: str, **_: Any) -> list[str]:
    rule, equals, _name = prefix.partition("=")
    found = {file.path: file for file in find().library.rules()}
    if not equals:
        return [f"{path}=" for path in found]
    return [f"{rule}={name}" for name in found[rule].backends] if rule in found else []


def _options(parsed_args: argparse.Namespace, **_: Any) -> list[str]:
    """`body.mesh.primitives.wall_m=` for each option of the nodes of the recipe that is named."""
    from dextera_build.session import Session

    named = getattr(parsed_args, "targets", None) or [
        getattr(parsed_args, "target", "") or getattr(parsed_args, "node", "")
    ]
    found: dict[str, None] = {}
    for path, call in Session(find(), named[0].partition(":")[0]).plan(incomplete=True).graph.calls():
        for name, value in call.options.items():
            inner = [f"{name}.{each}" for each in value] if isinstance(value, dict) and value else [name]
            found |= dict.fromkeys(f"{'.'.join(path)}.{each}=" for each in inner)
    return list(found)


def _codes() -> list[str]:
    from dextera_build.explain import error_codes

    return error_codes.explained()


def _words(*words: str) -> Callable[..., list[str]]:
    return lambda **_: list(words)


def _or_targets(words: Callable[[], list[str]]) -> Callable[..., list[str]]:
    return lambda prefix, **_: _targets(prefix) if ":" in prefix else [*words(), *_recipes()]


_COMPLETERS: dict[str, Callable[..., object]] = {
    **dict.fromkeys(("RECIPE[:TARGET]", "RECIPE[:NODE]", "RECIPE:NODE", "A", "B"), _targets),
    "RECIPE[:NODE]|RULE|RUN|CALL": _or_targets(_rules),
    "WHAT": _or_targets(_words("recipes", "rules", "backends", "profiles", "runs", "divergent", "calls")),
    "VERB|CODE|RULE|TYPE": lambda **_: [*VERBS, *_codes(), *_rules()],
    "RUN|RECIPE": _runs,
    "NODE": _in_run,
    "RULE=NAME": _backends,
    "NODE.OPTION=VALUE": _options,
    "force": lambda parsed_args, **_: [node for text in parsed_args.targets for node in _nodes(text.partition(":")[0])],
    "calls": _words("record", "replay", "refresh", "replace", "off"),
    "console": _words("live", "plain", "jsonl", "none"),
    "executor": _words("local", "ray"),
    "profile": _words("stub", "cpu", "picture", "gpu", "cloud"),
}
"""Name or metavar of an argument -> its completer."""
