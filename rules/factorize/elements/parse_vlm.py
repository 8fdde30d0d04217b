"""Elements from a vision-language model behind an OpenAI-compatible endpoint; answers are recorded."""

from __future__ import annotations

import base64
import io
import json
import os
from collections.abc import Callable, Sequence
from typing import Any, Literal
from urllib.parse import urlsplit

from pydantic import BaseModel, ConfigDict, Field

from dextera_build.artifacts.camera import Photograph
from dextera_build.artifacts.object import Element
from dextera_build.errors import MachineError, RuleError
from dextera_build.rule import Backend, Context, Options, Response

from ..measured import Measurements, Workspace

BACKEND = Backend(
    summary="a vision-language model names things and boxes; DXB_VLM_URL and DXB_VLM_API_KEY say which service",
    packages=("httpx", "pillow"),
    extra="share",
    licence="that of the service",
)
KEY = "DXB_VLM_API_KEY"
"""Name of the secret; a service on this machine needs none."""
LONGEST = 1024
"""Longer side of the uploaded image [px]."""
PROMPT = """The photograph shows a workspace: a support (a table, a desk) and what stands on it.
Name everything that stands on the support or behind it. The picture is {width} px wide and {height} px high.
- name: unique, lower case, words joined by _: red_mug
- phrase: a short noun phrase: red mug
- category: box, cylinder, bowl, mug, laptop, robot, room or object
- body_type: articulated if it has joints (a laptop, a box with a lid), else rigid
- interactive: true if a hand could pick it up or move a part of it, false for walls, furniture and robots
- material: wood, plastic, ceramic, metal, glass, cardboard, rubber or fabric
- box: left, top, right, bottom in pixels of this picture, tight around what is seen of it
Do not name the support itself."""
_TEXT = {"type": "string"}
_FIELDS: dict[str, Any] = {
    "name": _TEXT,
    "phrase": _TEXT,
    "category": {"enum": ["box", "cylinder", "bowl", "mug", "laptop", "robot", "room", "object"]},
    "body_type": {"enum": ["rigid", "articulated"]},
    "interactive": {"type": "boolean"},
    "material": {"enum": ["wood", "plastic", "ceramic", "metal", "glass", "cardboard", "rubber", "fabric"]},
    "box": {"type": "array", "items": {"type": "integer"}, "minItems": 4, "maxItems": 4},
}
_ITEM = {"type": "object", "properties": _FIELDS, "required": [*_FIELDS], "additionalProperties": False}
SCHEMA: dict[str, Any] = {
    "type": "object",
    "properties": {"elements": {"type": "array", "items": _ITEM}},
    "required": ["elements"],
    "additionalProperties": False,
}
"""JSON schema of the response; `Answer` validates it."""


class VlmOptions(Options):
    """Options of backend `vlm` of factorize.parse."""

    model: str = ""
    """Name of the model, for backends that query a service (`vlm`)."""


class Thing(BaseModel):
    """One element, in pixels of the uploaded image."""

    model_config = ConfigDict(extra="forbid", strict=True)

    name: str = Field(pattern=r"^[a-z][a-z0-9]*(_[a-z0-9]+)*$", max_length=60)
    phrase: str = Field(min_length=1, max_length=200)
    category: Literal["box", "cylinder", "bowl", "mug", "laptop", "robot", "room", "object"]
    body_type: Literal["rigid", "articulated"]
    interactive: bool
    material: Literal["wood", "plastic", "ceramic", "metal", "glass", "cardboard", "rubber", "fabric"]
    box: list[int] = Field(min_length=4, max_length=4)


class Answer(BaseModel):
    """The required response of a model."""

    model_config = ConfigDict(extra="forbid", strict=True)

    elements: list[Thing] = Field(min_length=1, max_length=64)


def propose(
    ctx: Context, photograph: Photograph, measured: Measurements[Workspace], options: VlmOptions
) -> tuple[Element, ...]:
    """The elements named by the model, each with its box [px]."""
    if not options.model:
        hint = "`--set NODE.vlm.model=NAME`, or `vlm: {model: NAME}` at the node"
        ctx.fail("no model is named for the backend `vlm`", hint=hint)
    picture, (width, height) = _picture(photograph)
    request = {
        "model": options.model,
        "prompt": PROMPT.format(width=width, height=height),
        "picture": picture,
        "schema": SCHEMA,
        "temperature": 0,
        "seed": 0,
    }

    def repair(body: bytes, why: str) -> Callable[[float], Response]:
        said = {"role": "assistant", "content": _said(body)}
        wrong = {
            "role": "user",
            "content": f"This answer cannot be used: {why}\nAnswer again, with all of it corrected.",
        }
        return lambda seconds: _send(request, _key(ctx), seconds, [said, wrong])

    body = ctx.call(
        "openai-chat",
        request,
        lambda seconds: _send(request, _key(ctx), seconds),
        valid=lambda body: read(body, width, height),
        repair=repair,
    )
    rows, columns = photograph.rgb.pixels.shape[:2]
    scale = columns / width, rows / height
    return tuple(_element(thing, scale) for thing in read(body, width, height).elements)


def read(body: bytes, width: int, height: int) -> Answer:
    """Parse the body of a chat completion for an image of this size [px].

    Raises:
        RuleError: A value is impossible.
        ValueError: The response does not match the schema.
    """
    answer = Answer.model_validate_json(json.loads(body)["choices"][0]["message"]["content"])
    names = [thing.name for thing in answer.elements]
    for thing in answer.elements:
        left, top, right, bottom = thing.box
        if not (0 <= left < right <= width and 0 <= top < bottom <= height):
            raise RuleError(
                f"the box of `{thing.name}` is {thing.box}, outside of the picture of {width} × {height} px",
                code="DXB-B347",
            )
        if names.count(thing.name) > 1 or thing.name == "support":
            raise RuleError(f"the name `{thing.name}` is taken", code="DXB-B347")
    return answer


def _element(thing: Thing, scale: tuple[float, float]) -> Element:
    left, top, right, bottom = thing.box
    x, y = scale
    box = (int(left * x), int(top * y), round(right * x), round(bottom * y))
    return Element(**{**thing.model_dump(), "box": box})


def _picture(photograph: Photograph) -> tuple[bytes, tuple[int, int]]:
    """The photograph as JPEG with sides of at most `LONGEST`, and its size [px]."""
    from PIL import Image

    picture = Image.fromarray(photograph.rgb.pixels)
    picture.thumbnail((LONGEST, LONGEST), Image.Resampling.LANCZOS)
    data = io.BytesIO()
    picture.save(data, "JPEG", quality=90)
    return data.getvalue(), picture.size


def _key(ctx: Context) -> str:
    """The key; "" for a service that needs none."""
    try:
        return ctx.secret(KEY)
    except MachineError:
        return ""


def _said(body: bytes) -> str:
    """The text of an answer; its bytes if it is no chat completion."""
    try:
        return str(json.loads(body)["choices"][0]["message"]["content"])
    except (ValueError, KeyError, TypeError, IndexError):
        return body.decode(errors="replace")[:4000]


def _send(request: dict[str, Any], key: str, timeout_s: float, more: Sequence[dict[str, str]] = ()) -> Response:
    """Query an OpenAI-compatible service; its address and credentials are never recorded. `more`: further messages."""
    import httpx

    url = os.environ.get("DXB_VLM_URL", "")
    if not url:
        raise MachineError(
            "no vision-language model can be asked: `DXB_VLM_URL` is not set",
            code="DXB-E362",
            hint="export DXB_VLM_URL=https://api.openai.com/v1 DXB_VLM_API_KEY=...",
        )
    if key and url.startswith("http://") and urlsplit(url).hostname not in ("localhost", "127.0.0.1", "::1"):
        raise MachineError(
            "the key of the vision-language model would be sent in the clear",
            code="DXB-E363",
            facts={"address": url},
            hint="export DXB_VLM_URL=https://..., or unset DXB_VLM_API_KEY where the service wants no key",
        )
    picture = "data:image/jpeg;base64," + base64.b64encode(request["picture"]).decode()
    content = [{"type": "text", "text": request["prompt"]}, {"type": "image_url", "image_url": {"url": picture}}]
    schema = {"name": "elements", "strict": True, "schema": request["schema"]}
    asked = {
        "model": request["model"],
        "temperature": request["temperature"],
        "seed": request["seed"],
        "messages": [{"role": "user", "content": content}, *more],
        "response_format": {"type": "json_schema", "json_schema": schema},
    }
    headers = {"Authorization": f"Bearer {key}"} if key else {}
    answer = httpx.post(f"{url.rstrip('/')}/chat/completions", json=asked, headers=headers, timeout=timeout_s)
    return Response(answer.content, answer.status_code, dict(answer.headers))
