"""`dxb completion`: a script for the shell that completes verbs, flags, recipes, nodes and runs."""

from __future__ import annotations

import argparse
import sys

from dextera_build.errors import UsageError, listing

_BASH = r"""# Completion of dxb for bash; load it with: eval "$(dxb completion bash)"
_dxb() {
    local line="${COMP_LINE:0:COMP_POINT}" IFS=$'\n'
    COMPREPLY=($(dxb completion bash --line "$line" 2>/dev/null))
    # A recipe alone may be followed by `:NODE`, a setting by its value.
    case "${COMPREPLY[*]}" in *[:=/]) compopt -o nospace ;; esac
}
complete -F _dxb dxb
"""

_ZSH = r"""#compdef dxb
# Completion of dxb for zsh; load it with: eval "$(dxb completion zsh)" after compinit
_dxb() {
    local -a values texts
    local value text
    while IFS=$'\t' read -r value text; do
        values+=("$value")
        texts+=("$value${text:+  -- $text}")
    done < <(dxb completion zsh --line "${(j: :)words[1,CURRENT]}" 2>/dev/null)
    (( $#values )) && compadd -S '' -l -d texts -- "${values[@]}"
}
compdef _dxb dxb
"""

_FISH = r"""# Completion of dxb for fish; load it with: dxb completion fish | source
function __dxb_complete
    dxb completion fish --line (commandline --cut-at-cursor | string collect) 2>/dev/null
end
complete --command dxb --no-files --arguments '(__dxb_complete)'
"""

SCRIPTS = {"bash": _BASH, "zsh": _ZSH, "fish": _FISH}


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    parser.add_argument("shell", metavar="SHELL", help="bash, zsh or fish")
    parser.add_argument("--line", help=argparse.SUPPRESS)


def run(args: argparse.Namespace) -> int:
    """Print the script; with `--line`, what may stand at the end of a command line."""
    if args.shell not in SCRIPTS:
        raise UsageError(
            f"`{args.shell}` is not a shell that dxb completes for",
            code="DXB-U175",
            facts={"shells": listing(SCRIPTS)},
        )
    if args.line is None:
        print(SCRIPTS[args.shell], end="")
        return 0
    from dextera_build.cli import complete

    try:
        lines = complete.answer(args.shell, args.line)
    except Exception:  # a broken recipe or setting must not write into the line that a person types
        return 1
    sys.stdout.write("".join(line + "\n" for line in lines))
    return 0
