"""The command line's reference, from its parser."""

from __future__ import annotations

import argparse

from dextera_build.cli import grammar, variables

from .markdown import code, escaped, join, table


def page() -> str:
    """One section per verb: usage, arguments, their meaning."""
    top = grammar.parser()
    verbs = _verbs(top)
    overview = table(
        ["verb", "description"], [[f"[{code(name)}](#dxb-{name})", text] for name, (_, text) in verbs.items()]
    )
    return join(overview, *(_verb(name, parser) for name, (parser, _) in verbs.items()))


def variables_page() -> str:
    """One table of all variables of the environment."""
    known = variables.SETTINGS | variables.OTHERS
    return table(["variable", "meaning"], [[code(name), text] for name, text in known.items()])


def _verbs(top: argparse.ArgumentParser) -> dict[str, tuple[argparse.ArgumentParser, str]]:
    action = next(a for a in top._actions if isinstance(a, argparse._SubParsersAction))
    summaries = {choice.dest: choice.help or "" for choice in action._choices_actions}
    return {name: (parser, summaries.get(name, "")) for name, parser in action.choices.items()}


def _verb(name: str, parser: argparse.ArgumentParser) -> str:
    inner = _verbs(parser) if _has_verbs(parser) else {}
    arguments = [_row(action) for action in parser._actions if action.dest != "help"]
    return join(
        f"## dxb {name}",
        parser.description or "",
        f"```text\n{_usage(parser)}\n```",
        table(["argument", "meaning", "default"], arguments),
        *(_verb(f"{name} {verb}", sub) for verb, (sub, _) in inner.items()),
        parser.epilog or "",
    )


def _has_verbs(parser: argparse.ArgumentParser) -> bool:
    return any(isinstance(action, argparse._SubParsersAction) for action in parser._actions)


def _usage(parser: argparse.ArgumentParser) -> str:
    # The width would else be that of the terminal that the docs are built in.
    formatter = argparse.HelpFormatter(parser.prog, width=100)
    formatter.add_usage(parser.usage, parser._actions, parser._mutually_exclusive_groups, prefix="")
    return formatter.format_help().strip()


def _row(action: argparse.Action) -> list[str]:
    value = action.metavar if isinstance(action.metavar, str) else action.dest.upper()
    if not action.option_strings:
        name = code(action.metavar or action.dest)
    elif isinstance(action, argparse.BooleanOptionalAction):
        name = ", ".join(code(option) for option in action.option_strings)
    else:
        takes = "" if action.nargs == 0 else f" {value}"
        name = ", ".join(code(option + takes) for option in action.option_strings)
    chosen = f": {', '.join(code(choice) for choice in action.choices)}" if action.choices else ""
    default = "" if action.default in (None, False, [], argparse.SUPPRESS) else code(action.default)
    return [name, escaped(action.help or "") + chosen, default]
