"""How calls of services are treated; alone in its file because every build asks, and few make a call."""

from __future__ import annotations

from typing import Literal, TypeAlias, get_args

from dextera_build.errors import UsageError, listing

Mode: TypeAlias = Literal["record", "replay", "refresh", "replace", "off"]
"""`record`: what is recorded is replayed, the rest is asked. `replay`: nothing is asked. `refresh`: all is asked again
and compared; the first answer stays. `replace`: all is asked again; the new answer stays. `off`: no call is made."""


def mode(text: str, origin: str = "") -> Mode:
    """The mode that a setting names.

    Raises:
        UsageError: There is none of that name.
    """
    for known in get_args(Mode):
        if text == known:
            return known  # type: ignore[no-any-return]
    raise UsageError(
        f"`{text}` is not a way to treat calls",
        code="DXB-U180",
        facts={"modes": listing(get_args(Mode))} | ({"from": origin} if origin else {}),
    )
