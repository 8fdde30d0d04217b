"""Elements from a vision-language model behind an OpenAI-compatible endpoint; answers are recorded."""

from __future__ import annotations

import base64
import io
import json
import os
from collections.abc import Callable, Sequence
from typing import Any
from urllib.parse import urlsplit

from pydantic import Field

from dextera_build.artifacts.cameras.camera import Photograph
from dextera_build.artifacts.objects.object import Elements
from dextera_build.errors import MachineError
from dextera_build.rule import Backend, Context, Options, Response

from ..measured import Measurements, Workspace
from . import questions

BACKEND = Backend(
    summary="a vision-language model names objects and boxes; DXB_VLM_URL and DXB_VLM_API_KEY choose the service",
    packages=("httpx", "pillow"),
    extra="share",
    licence="that of the service",
)
KEY = "DXB_VLM_API_KEY"
"""Name of the secret; a service on this machine needs none."""
LONGEST = 1024
"""Longer side of the uploaded image [px]."""


class VlmOptions(Options):
    """Options of backend `vlm` of factorize.parse."""

    model: str = Field(min_length=1)
    """Name of the model, passed to the service."""


def propose(ctx: Context, photograph: Photograph, measured: Measurements[Workspace], options: VlmOptions) -> Elements:
    """The elements named by the model, each with its box [px]."""
    picture, size = _picture(photograph)
    grid = questions.Grid(*size)
    request = {
        "model": options.model,
        "prompt": grid.prompt(),
        "picture": picture,
        "schema": questions.SCHEMA,
        "temperature": 0,
        "seed": 0,
    }

    def repair(body: bytes, why: str) -> Callable[[float], Response]:
        said = {"role": "assistant", "content": _said(body)}
        wrong = {"role": "user", "content": questions.correction(why)}
        return lambda seconds: _send(request, _key(ctx), seconds, [said, wrong])

    body = ctx.call(
        "openai-chat",
        request,
        lambda seconds: _send(request, _key(ctx), seconds),
        valid=lambda body: read(body, grid),
        repair=repair,
    )
    return Elements(elements=questions.elements(read(body, grid), grid, photograph.rgb.pixels.shape))


def read(body: bytes, grid: questions.Grid) -> questions.Answer:
    """Parse the body of a chat completion.

    Raises:
        RuleError: A value is impossible.
        ValueError: The response does not match the schema.
    """
    return questions.read(json.loads(body)["choices"][0]["message"]["content"], grid)


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
    """The text of an answer; the raw bytes if it is no chat completion."""
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
            "no vision-language model is configured: `DXB_VLM_URL` is not set",
            code="DXB-E362",
            hint="export DXB_VLM_URL=https://api.openai.com/v1 DXB_VLM_API_KEY=...",
        )
    if key and url.startswith("http://") and urlsplit(url).hostname not in ("localhost", "127.0.0.1", "::1"):
        raise MachineError(
            "the key of the vision-language model would be sent in the clear",
            code="DXB-E363",
            facts={"address": url},
            hint="export DXB_VLM_URL=https://..., or unset DXB_VLM_API_KEY if the service needs no key",
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
