"""Backend qwen3_vl of align.canonical: the model is shown the body in each orientation and selects one."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from pydantic import PositiveInt

from dextera_build.artifacts.objects.canonical import Open
from dextera_build.errors import RuleError
from dextera_build.geometry import canonical as geometry
from dextera_build.geometry import thumbnail
from dextera_build.rule import Backend, Context, Options

from .bodies import Surface
from .chosen import Chosen

if TYPE_CHECKING:
    from dextera_build.learning.qwen3_vl import Chat, Speaker

BACKEND = Backend(
    summary="Qwen3-VL chooses among pictures of the candidates; no service is called",
    profiles=("gpu",),
    packages=("numpy", "open3d", "pillow", "tokenizers", "torch", "transformers"),
    extra="models",
    gpu_gb=24.0,
    cpu=True,
    weights=("qwen3_vl",),
)
UP = (
    "The picture shows one object in {count} orientations, numbered 1 to {count}. In which of them does it stand as it "
    "is used on a table? Answer with the number alone, or 0 if it cannot be told."
)
FRONT = (
    "The picture shows one object from {count} sides, numbered 1 to {count}. In which of them does its front face to "
    "the right? A handle or a spout counts as the front. Answer with the number alone, or 0 if it cannot be told."
)
COLUMNS = 3
"""Number of pictures per row."""


class Qwen3VlOptions(Options):
    """Options of backend `qwen3_vl` of align.canonical."""

    picture_tokens: PositiveInt = 1280
    """Maximum number of tokens for the sheet of pictures."""
    attempts: PositiveInt = 3
    """Maximum number of queries; each repeated query contains the error of the previous answer."""


def choose(ctx: Context, surface: Surface, seen_up: np.ndarray | None, options: Qwen3VlOptions) -> Chosen:
    """Up, and then front, as selected by the model; 0 leaves a choice undecided."""
    speaker = ctx.load(_speaker, "qwen3_vl")

    def asked(question: str, turns: list[np.ndarray]) -> int:
        sheet = _sheet(surface, turns)
        ctx.preview(sheet, "the candidates that the model chose among")
        return ask(lambda chat: speaker.answer(sheet, chat, options.picture_tokens, 8), question, len(turns), options)

    undecided: list[Open] = []
    level = [geometry.DIRECTIONS[np.abs(geometry.DIRECTIONS @ up) < 0.5] for up in geometry.DIRECTIONS]
    number = asked(UP, [geometry.rotation(up, side[0]) for up, side in zip(geometry.DIRECTIONS, level, strict=True)])
    if number == 0:
        undecided.append("up")
    chosen = max(number - 1, 0)
    up, sides = geometry.DIRECTIONS[chosen], level[chosen]
    number = asked(FRONT, [geometry.rotation(up, side) for side in sides])
    if number == 0:
        undecided.append("front")
    return Chosen(
        up, sides[max(number - 1, 0)], tuple(undecided), "up and front named by Qwen3-VL", by_colour=number > 0
    )


def ask(say: Callable[[Chat], str], question: str, count: int, options: Qwen3VlOptions) -> int:
    """The number in the model's answer, 0 to `count`.

    Raises:
        RuleError: No answer was such a number.
    """
    chat: Chat = [("user", question.format(count=count))]
    for _ in range(options.attempts):
        text = say(chat)
        numbers = re.findall(r"\d+", text)
        if len(numbers) == 1 and int(numbers[0]) <= count:
            return int(numbers[0])
        chat = [*chat[:1], ("assistant", text), ("user", f"Answer with one number from 0 to {count} and nothing else.")]
    raise RuleError(
        f"the model names no number from 0 to {count}",
        code="DXB-B357",
        facts={"asked": f"{options.attempts} times", "it said": " ".join(text.split())[:200] or "nothing"},
        hint="take the backend `geometry`, which leaves uncertain axes undecided",
    )


def _sheet(surface: Surface, turns: list[np.ndarray]) -> np.ndarray:
    """The surface rotated by each of (3, 3) `turns`, numbered, (H, W, 3) uint8."""
    from PIL import Image, ImageDraw

    tiles = []
    for number, turn in enumerate(turns, start=1):
        pixels = thumbnail.thumbnail([((surface.vertices @ turn.T)[surface.faces], surface.paint)])
        picture = Image.fromarray(pixels)
        ImageDraw.Draw(picture).text((8, 4), str(number), fill=(200, 0, 0), font_size=36)
        tiles.append(np.asarray(picture))
    blank = np.full_like(tiles[0], 255)
    tiles += [blank] * (-len(tiles) % COLUMNS)
    rows = [np.concatenate(tiles[k : k + COLUMNS], axis=1) for k in range(0, len(tiles), COLUMNS)]
    return np.concatenate(rows)


def _speaker(folder: Path, device: str) -> Speaker:
    from dextera_build.learning.qwen3_vl import Speaker

    return Speaker.load(folder, device)


def self_test(ctx: Context) -> None:
    """Check that the model answers on a grey picture."""
    grey = np.full((64, 64, 3), 128, np.uint8)
    ctx.load(_speaker, "qwen3_vl").answer(grey, [("user", "What is this?")], 16, 4)
