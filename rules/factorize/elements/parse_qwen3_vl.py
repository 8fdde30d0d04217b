"""Elements from Qwen3-VL, run in this process with greedy decoding."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import PositiveInt

from dextera_build.artifacts.cameras.camera import Photograph
from dextera_build.artifacts.objects.object import Elements
from dextera_build.errors import RuleError
from dextera_build.rule import Backend, Context, Options

from ..measured import Measurements, Workspace
from . import questions

if TYPE_CHECKING:
    from dextera_build.learning.qwen3_vl import Chat, Speaker

BACKEND = Backend(
    summary="Qwen3-VL names objects and boxes; no service is called",
    profiles=("gpu",),
    packages=("numpy", "pillow", "tokenizers", "torch", "transformers"),
    extra="models",
    gpu_gb=24.0,
    cpu=True,
    weights=("qwen3_vl",),
)
GRID = questions.Grid(1000, 1000, "units", "these units")
"""Qwen3-VL gives boxes in thousandths of the picture's sides (its repository, cookbooks/2d_grounding.ipynb)."""


class Qwen3VlOptions(Options):
    """Options of backend `qwen3_vl` of factorize.parse."""

    picture_tokens: PositiveInt = 1280
    """Maximum number of tokens for the picture; one token is 32 × 32 px, larger pictures are reduced."""
    answer_tokens: PositiveInt = 4096
    """Maximum number of tokens of an answer."""
    attempts: PositiveInt = 3
    """Maximum number of queries; each repeated query contains the error of the previous answer."""


def propose(
    ctx: Context, photograph: Photograph, measured: Measurements[Workspace], options: Qwen3VlOptions
) -> Elements:
    """The elements named by the model, each with its box [px]."""
    speaker = ctx.load(_speaker, "qwen3_vl")
    pixels = photograph.rgb.pixels

    def say(chat: Chat) -> str:
        return speaker.answer(pixels, chat, options.picture_tokens, options.answer_tokens)

    return Elements(elements=questions.elements(ask(say, options.attempts), GRID, pixels.shape))


def ask(say: Callable[[Chat], str], attempts: int) -> questions.Answer:
    """Query the model until an answer is valid.

    Args:
        say: Function that returns the model's answer to a conversation, which begins with question and picture.
        attempts: Maximum number of queries.

    Raises:
        RuleError: No answer was valid.
    """
    chat: Chat = [("user", GRID.prompt() + "\n" + questions.form())]
    for _ in range(attempts):
        text = say(chat)
        try:
            return questions.read(questions.bare(text), GRID)
        except (ValueError, RuleError) as error:
            why = str(error)
        chat = [*chat[:1], ("assistant", text), ("user", questions.correction(why))]
    raise RuleError(
        f"the model gives no usable answer: {why}",
        code="DXB-B355",
        facts={"asked": f"{attempts} times", "it said": " ".join(text.split())[:200] or "nothing"},
        hint="list the objects in a `scene.yaml`, raise `answer_tokens` if the answer is cut, or take another backend",
    )


def _speaker(folder: Path, device: str) -> Speaker:
    from dextera_build.learning.qwen3_vl import Speaker

    return Speaker.load(folder, device)


def self_test(ctx: Context) -> None:
    """Check that the model answers on a grey picture."""
    import numpy as np

    grey = np.full((64, 64, 3), 128, np.uint8)
    ctx.load(_speaker, "qwen3_vl").answer(grey, [("user", "What is this?")], 16, 4)
