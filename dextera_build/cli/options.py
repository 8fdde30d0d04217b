"""Arguments that several verbs share, and their conversion."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

from dextera_build.errors import UsageError
from dextera_build.recipe.addresses import parse_target

if TYPE_CHECKING:
    from dextera_build.project.planning import Added
    from dextera_build.project.project import Project
    from dextera_build.session import Session


def by_recipe(texts: Iterable[str]) -> dict[str, list[str]]:
    """Recipe -> its targets, in the order given."""
    wanted: dict[str, list[str]] = {}
    for text in texts:
        named = parse_target(text)
        wanted.setdefault(named.recipe, []).append(named.node)
    return wanted


def build_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of verbs that build."""
    parser.add_argument(
        "-k", "--keep-going", action="store_true", help="continue with nodes that do not depend on a failed one"
    )
    parser.add_argument("-j", "--jobs", metavar="N", help="number of cores to use; most nodes take one (DXB_JOBS)")
    text = "refuse calls of services that could make the total cost of this command exceed this amount (DXB_MAX_COST)"
    parser.add_argument("--max-cost", metavar="USD", help=text)


def project_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that choose the store and the profile."""
    parser.add_argument(
        "--cache",
        metavar="DIR|LIST",
        help="the store's folder, or the stores to use, with modes: `local:rw,NAME:r,URL:w` (DXB_CACHE, DXB_REMOTES)",
    )
    parser.add_argument(
        "--profile",
        metavar="NAME",
        help="which backends to prefer: stub, cpu, picture, gpu, cloud, or a profile of the project (DXB_PROFILE)",
    )


def request_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that change a recipe."""
    group = parser.add_argument_group("changes to the recipe")
    group.add_argument("--input", metavar="NAME=PATH", action="append", default=[], help="bind an input of the recipe")
    group.add_argument(
        "--set",
        metavar="NODE.OPTION=VALUE",
        action="append",
        default=[],
        dest="settings",
        help="set an option: 'body[mug].mesh.primitives.wall_m=0.004'",
    )
    group.add_argument(
        "--backend", metavar="RULE=NAME", action="append", default=[], dest="backends", help="choose a rule's backend"
    )


def number(flag: str, least: float, most: float, *, above: bool = False) -> Callable[[str], float]:
    """What reads the value of a flag, a number from `least` to `most`, or with `above` only above `least`."""

    def read(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = float("nan")
        if not least <= value <= most or (above and value == least):
            start = f"above {least:g}" if above else f"from {least:g}"
            limits = start if most == float("inf") else f"{start} to {most:g}"
            raise UsageError(
                f"`{flag} {text}` is no number {limits}", code="DXB-U347", hint=f"without `{flag}`, its default applies"
            )
        return value

    return read


def port(text: str) -> int:
    """The value of `--port`: a TCP port, or 0 for a free one."""
    if not text.isdecimal() or int(text) > 65535:
        raise UsageError(
            f"`--port {text}` is no port from 0 to 65535", code="DXB-U347", hint="`--port 0` takes a free one"
        )
    return int(text)


def json_argument(parser: argparse.ArgumentParser) -> None:
    """Add `--json`."""
    parser.add_argument("--json", action="store_true", help="print one JSON document, with its name and version")


def project(args: argparse.Namespace) -> Project:
    """The project that the arguments name."""
    from dextera_build.cli import variables
    from dextera_build.project import project as module

    flags = {
        name: getattr(args, name, None)
        for name in ("cache", "profile", "jobs", "console", "resources", "calls", "executor", "max_cost")
    }
    found = module.find(flags=flags)
    variables.warn(found)
    return found


def session(
    args: argparse.Namespace, target: str, of: Project | None = None, *, last: bool = False, makes: bool = False
) -> tuple[Session, str]:
    """A session of the recipe in `RECIPE:NODE`, changed by the arguments, and the node; see `Session`."""
    from dextera_build.session import Session

    named = parse_target(target)
    return Session(of or project(args), named.recipe, added(args), last=last, node=named.node, makes=makes), named.node


def added(args: argparse.Namespace) -> Added:
    """The changes to a recipe that the arguments ask for."""
    from dextera_build.project.planning import Added

    inputs = dict(_pair(text, "--input NAME=PATH") for text in args.input)
    return Added(inputs, tuple(args.settings), dict(_pair(text, "--backend RULE=NAME") for text in args.backends))


def again(args: argparse.Namespace) -> list[str]:
    """The command-line words for the same changes to a recipe."""
    told = (("--input", args.input), ("--set", args.settings), ("--backend", args.backends))
    words = [word for flag, texts in told for text in texts for word in (flag, text)]
    return [*words, "--profile", args.profile] if args.profile else words


def _pair(text: str, form: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not (name and equals and value):
        raise UsageError(f"`{text}` is not of the form `{form}`", code="DXB-U102")
    return name, value
