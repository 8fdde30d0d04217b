"""Grounding DINO and SAM 3 with random weights, small enough for tests."""

from __future__ import annotations

import json
from pathlib import Path

WORDS = ["[PAD]", "[UNK]", "[CLS]", "[SEP]", "[MASK]", ".", "red", "blue", "thing"]


def grounding_dino(folder: Path) -> Path:
    """A detector whose picture is 64 px wide."""
    import torch
    from transformers import BertTokenizer, GroundingDinoConfig, GroundingDinoForObjectDetection, GroundingDinoProcessor
    from transformers.models.grounding_dino.image_processing_pil_grounding_dino import GroundingDinoImageProcessorPil

    folder.mkdir()
    (folder / "vocab.txt").write_text("\n".join(WORDS))
    swin = {"embed_dim": 16, "depths": [1] * 4, "num_heads": [2] * 4, "window_size": 2, "out_indices": [2, 3, 4]}
    bert = {"hidden_size": 16, "num_hidden_layers": 1, "num_attention_heads": 2, "intermediate_size": 32}
    torch.manual_seed(0)
    config = GroundingDinoConfig(
        backbone_config={"model_type": "swin", "image_size": 64, **swin},
        text_config={"model_type": "bert", "vocab_size": len(WORDS), "max_position_embeddings": 64, **bert},
        d_model=64,
        encoder_layers=1,
        decoder_layers=2,
        encoder_ffn_dim=32,
        decoder_ffn_dim=32,
        encoder_attention_heads=2,
        decoder_attention_heads=2,
        num_queries=8,
        max_text_len=32,
    )
    GroundingDinoForObjectDetection(config).save_pretrained(folder)
    images = GroundingDinoImageProcessorPil(size={"shortest_edge": 48, "longest_edge": 64})
    GroundingDinoProcessor(images, BertTokenizer(str(folder / "vocab.txt"))).save_pretrained(folder)
    return folder


def sam3(folder: Path) -> Path:
    """A segmenter whose input is 56 px wide."""
    import torch
    from transformers import BertTokenizer, Sam3Config, Sam3Model

    folder.mkdir()
    small = {"hidden_size": 32, "intermediate_size": 64, "num_attention_heads": 2}
    sizes = {"image_size": 56, "patch_size": 14, "window_size": 2, "pretrain_image_size": 56}
    vit = {"model_type": "sam3_vit_model", "num_hidden_layers": 2, "global_attn_indexes": [1], **sizes, **small}
    text = {"vocab_size": len(WORDS), "projection_dim": 32, "num_hidden_layers": 1, "max_position_embeddings": 32}
    torch.manual_seed(0)
    config = Sam3Config(
        vision_config={
            "backbone_config": vit,
            "fpn_hidden_size": 32,
            "backbone_feature_sizes": [[16, 16], [8, 8], [4, 4]],
        },
        text_config={"model_type": "clip_text_model", **text, **small},
        geometry_encoder_config={"num_layers": 1, **small},
        detr_encoder_config={"num_layers": 1, **small},
        detr_decoder_config={"num_layers": 1, "num_queries": 5, **small},
        mask_decoder_config={"hidden_size": 32, "num_attention_heads": 2},
    )
    Sam3Model(config).save_pretrained(folder)
    (folder / "vocab.txt").write_text("\n".join(WORDS))
    BertTokenizer(str(folder / "vocab.txt")).save_pretrained(folder)
    numbers = {"size": {"height": 56, "width": 56}, "image_mean": [0.5] * 3, "image_std": [0.5] * 3}
    (folder / "processor_config.json").write_text(json.dumps({"image_processor": numbers}))
    return folder
