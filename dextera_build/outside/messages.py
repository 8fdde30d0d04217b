"""The messages of dxb backend protocol 1: dxb writes `request.json`, a program `response.json`.

The forms of both are published as JSON Schemas in `protocol_1/`; docs/outside.md describes them in words.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any, Literal, NoReturn

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from dextera_build.errors import RuleError

PROTOCOL: Literal[1] = 1
REQUEST, RESPONSE = "request", "response"
"""Folders of an exchange; each holds a message of the same name, and the files that it names."""
SCHEMAS = Path(__file__).parent / "protocol_1"
_MOST = 64 << 20
"""Largest response without its files [bytes]."""


class _Message(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


class Request(_Message):
    """Request to a program."""

    protocol: Literal[1]
    """Version of the protocol."""
    rule: str
    """`factorize.mesh`."""
    backend: str
    """`trellis`."""
    function: str
    """Function of the calling backend; a program may implement several."""
    inputs: dict[str, Any]
    """Name -> value."""
    options: dict[str, Any] = {}
    """Name -> value, every option with its value."""
    weights: dict[str, str] = {}
    """Model -> its folder."""
    device: Literal["cpu", "cuda"] = "cpu"
    """`cuda` is the GPU granted to the call, the only visible one."""
    seed: int = 0
    """Of random numbers: the backend's option `seed`, if it has one."""


class Ok(_Message):
    """The output of a call that succeeded."""

    protocol: Literal[1]
    """Version of the protocol."""
    status: Literal["ok"]
    output: Any
    """The value; its files are named relative to the folder of the message."""
    line: str = Field("", max_length=1000)
    """The summary of the result in the build log."""
    metrics: dict[str, tuple[float, str]] = {}
    """Name -> number and its unit."""


class Refused(_Message):
    """A program's statement that it cannot work with these inputs."""

    protocol: Literal[1]
    """Version of the protocol."""
    status: Literal["refused"]
    message: str = Field(min_length=1, max_length=1000)
    """The fault in one sentence."""
    hint: str = Field("", max_length=1000)
    """The next step."""


class Response(BaseModel):
    """Response of a program."""

    root: Annotated[Ok | Refused, Field(discriminator="status")]


def schema(kind: type[BaseModel]) -> dict[str, Any]:
    """The JSON Schema of a message."""
    made = kind.model_json_schema()
    if kind is Response:
        made = {**made["properties"]["root"], "title": "Response", "$defs": made["$defs"]}
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **made}


def write(request: Request, folder: Path) -> None:
    """Write `request.json` into a folder."""
    text = json.dumps(request.model_dump(mode="json"), indent=1, allow_nan=False)
    (folder / f"{REQUEST}.json").write_text(text + "\n")


def read(folder: Path) -> Ok | Refused:
    """The response in a folder.

    Raises:
        RuleError: There is none (B374), or it is not one (B375).
    """
    path = folder / f"{RESPONSE}.json"
    try:
        if path.is_symlink() or not path.is_file():
            raise _none()
        if path.stat().st_size > _MOST:
            raise _malformed(f"it has {path.stat().st_size:,} bytes; large values belong in files")
        found = json.loads(path.read_bytes(), parse_constant=_constant)
        spoken = found.get("protocol", PROTOCOL) if isinstance(found, dict) else PROTOCOL
        if spoken is True or spoken != PROTOCOL:  # in Python `True` is 1
            raise _malformed(f"it speaks protocol {spoken!r:.40}, dxb speaks {PROTOCOL}")
        return Response.model_validate_json(json.dumps({"root": found})).root
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place = ".".join(str(part) for part in first["loc"][1:] if part not in ("ok", "refused"))
        raise _malformed(f"`{place or 'status'}`: {first['msg']}") from None
    except (ValueError, RecursionError) as error:
        raise _malformed(f"it is not JSON: {error}") from None
    except OSError as error:
        raise _malformed(f"it cannot be read: {error.strerror}") from None


def _constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is no JSON number")


def _none() -> RuleError:
    return RuleError(
        "the program ended without an answer",
        code="DXB-B374",
        facts={"missing": f"{RESPONSE}/{RESPONSE}.json"},
        hint="`dxb log` shows what it printed; its last step writes the response, see docs/outside.md",
    )


def _malformed(why: str) -> RuleError:
    return RuleError(
        f"the program's `{RESPONSE}.json` is no response of protocol {PROTOCOL}",
        code="DXB-B375",
        facts={"why": why},
        hint="write it with `dxb_backend`, which is on the program's search path; a copy next to the program hides it",
    )
