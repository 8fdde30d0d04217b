"""Qwen3-VL through transformers, without torchvision: tokenizer, picture, greedy decoding."""

from __future__ import annotations

import json
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import torch
from transformers import AutoTokenizer, GenerationConfig, Qwen3VLForConditionalGeneration
from transformers.models.qwen2_vl.image_processing_pil_qwen2_vl import Qwen2VLImageProcessorPil

from dextera_build.learning import reproducible

Chat: TypeAlias = list[tuple[str, str]]
"""(role, text) of each message; the picture belongs to the first."""
_PICTURE = "<|image_pad|>"


@dataclass(frozen=True)
class Speaker:
    """The model with tokenizer and image settings, because the processor class of transformers needs torchvision."""

    model: Any
    tokenizer: Any
    pictures: Any

    @classmethod
    def load(cls, folder: Path, device: str) -> Speaker:
        """Read a folder with weights, tokenizer and `preprocessor_config.json`."""
        model = Qwen3VLForConditionalGeneration.from_pretrained(folder, dtype="auto", local_files_only=True)
        tokenizer = AutoTokenizer.from_pretrained(folder, local_files_only=True)
        written = folder / "chat_template.json"
        if tokenizer.chat_template is None and written.is_file():
            tokenizer.chat_template = json.loads(written.read_text(encoding="utf-8"))["chat_template"]
        pictures = Qwen2VLImageProcessorPil.from_pretrained(folder, local_files_only=True)
        return cls(model.to(device).eval(), tokenizer, pictures)

    def answer(self, pixels: np.ndarray, chat: Chat, picture_tokens: int, answer_tokens: int) -> str:
        """The most likely next message, by greedy decoding.

        Args:
            pixels: (H, W, 3) uint8 sRGB, shown with the first message.
            chat: The conversation so far; ends with a message of the user.
            picture_tokens: Maximum number of tokens of the picture.
            answer_tokens: Maximum number of tokens of the answer.
        """
        inputs = self.inputs(pixels, chat, picture_tokens)
        stops = self.model.generation_config.eos_token_id
        pad = stops[0] if isinstance(stops, list) else stops
        greedy = GenerationConfig(do_sample=False, max_new_tokens=answer_tokens, eos_token_id=stops, pad_token_id=pad)
        placed = {name: value.to(self.model.device) for name, value in inputs.items()}
        # Sums are deterministic for one GPU model on CUDA; on the CPU their order depends on the threads.
        steady = reproducible.one_thread() if self.model.device.type == "cpu" else nullcontext()
        with torch.inference_mode(), steady:
            said = self.model.generate(**placed, generation_config=greedy)
        return str(self.tokenizer.decode(said[0, inputs["input_ids"].shape[1] :], skip_special_tokens=True))

    def inputs(self, pixels: np.ndarray, chat: Chat, picture_tokens: int) -> dict[str, torch.Tensor]:
        """Inputs of the model: token ids, their types (1: picture), patches and the grid of the patches."""
        side = self.pictures.patch_size * self.pictures.merge_size
        least = self.pictures.size["shortest_edge"]
        most = max(least, min(self.pictures.size["longest_edge"], picture_tokens * side**2))
        seen = self.pictures(images=[pixels], size={"shortest_edge": least, "longest_edge": most}, return_tensors="pt")
        count = int(seen["image_grid_thw"].prod()) // self.pictures.merge_size**2
        text = self.tokenizer.apply_chat_template(_messages(chat), tokenize=False, add_generation_prompt=True)
        # The template has one token for a picture; the model needs one per merged patch.
        ids = self.tokenizer(text.replace(_PICTURE, _PICTURE * count, 1), return_tensors="pt")["input_ids"]
        kinds = (ids == self.tokenizer.convert_tokens_to_ids(_PICTURE)).long()
        return {"input_ids": ids, "attention_mask": torch.ones_like(ids), "mm_token_type_ids": kinds, **seen}


def _messages(chat: Chat) -> list[dict[str, Any]]:
    messages = [{"role": role, "content": [{"type": "text", "text": text}]} for role, text in chat]
    messages[0]["content"] = [{"type": "image"}, *messages[0]["content"]]
    return messages
