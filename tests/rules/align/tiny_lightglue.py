"""SuperPoint and LightGlue with random weights, small enough for tests, as one checkpoint."""

from __future__ import annotations

from pathlib import Path


def lightglue(folder: Path) -> Path:
    """A folder of weights as the published one, whose matcher holds its detector."""
    import torch
    from transformers import LightGlueConfig, LightGlueForKeypointMatching, SuperPointConfig

    torch.manual_seed(0)
    detector = SuperPointConfig(
        encoder_hidden_sizes=[8, 8, 8, 8], decoder_hidden_size=16, descriptor_decoder_dim=32, keypoint_threshold=0.0
    )
    config = LightGlueConfig(
        keypoint_detector_config=detector.to_dict(), descriptor_dim=32, num_hidden_layers=2, num_attention_heads=2
    )
    LightGlueForKeypointMatching(config).save_pretrained(folder, safe_serialization=True)
    return folder
