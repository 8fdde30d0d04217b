"""FLUX.2 [klein] with tiny random weights in a folder, of the classes of the published one."""

from __future__ import annotations

from pathlib import Path

TEMPLATE = "{% for m in messages %}{{ m.content }}{% endfor %}"


def save(folder: Path) -> Path:
    """Random weights of a pipeline for inpainting."""
    import torch
    from diffusers import (
        AutoencoderKLFlux2,
        FlowMatchEulerDiscreteScheduler,
        Flux2KleinInpaintPipeline,
        Flux2Transformer2DModel,
    )
    from tokenizers import pre_tokenizers
    from transformers import Qwen2TokenizerFast, Qwen3Config, Qwen3ForCausalLM

    letters = {letter: number for number, letter in enumerate(sorted(pre_tokenizers.ByteLevel.alphabet()))}
    letters["<|endoftext|>"] = len(letters)
    tokenizer = Qwen2TokenizerFast(vocab=letters, merges=[], pad_token="<|endoftext|>")
    tokenizer.chat_template = TEMPLATE
    torch.manual_seed(0)
    encoder = Qwen3ForCausalLM(
        Qwen3Config(
            vocab_size=len(tokenizer),
            hidden_size=16,
            intermediate_size=16,
            num_hidden_layers=28,  # the pipeline reads layers 9, 18 and 27
            num_attention_heads=2,
            num_key_value_heads=1,
            head_dim=8,
        )
    )
    vae = AutoencoderKLFlux2(block_out_channels=(4, 4, 4, 4), layers_per_block=1, latent_channels=4, norm_num_groups=1)
    transformer = Flux2Transformer2DModel(
        in_channels=16,
        num_layers=1,
        num_single_layers=1,
        attention_head_dim=16,
        num_attention_heads=2,
        joint_attention_dim=48,
        timestep_guidance_channels=16,
        axes_dims_rope=(4, 4, 4, 4),
        guidance_embeds=False,
    )
    with torch.no_grad():  # small random weights would decode everything to the same grey
        vae.decoder.conv_out.weight.mul_(10.0)
    pipeline = Flux2KleinInpaintPipeline(FlowMatchEulerDiscreteScheduler(), vae, encoder, tokenizer, transformer)
    pipeline.save_pretrained(folder)
    return folder
