"""SAM 3 for videos with random weights, small enough for tests, as one checkpoint of detector and tracker."""

from __future__ import annotations

import json
from pathlib import Path

SIDE = 56
"""Width and height of the model's input [px]."""
WIDTH, MEMORY = 128, 64
"""Of all features and of a memory; the tracker of transformers 5 takes only memories of 64, and wider features."""


def sam3_video(folder: Path) -> Path:
    """A folder of weights as the published one: detector and tracker share the vision encoder."""
    import torch
    from safetensors.torch import save_file
    from transformers import Sam3VideoConfig, Sam3VideoModel

    small = {"hidden_size": WIDTH, "intermediate_size": 64, "num_attention_heads": 2}
    sizes = {"image_size": SIDE, "patch_size": 14, "window_size": 2, "pretrain_image_size": SIDE}
    vit = {"model_type": "sam3_vit_model", "num_hidden_layers": 2, "global_attn_indexes": [1], **sizes, **small}
    vision = {
        "model_type": "sam3_vision_model",
        "backbone_config": vit,
        "fpn_hidden_size": WIDTH,
        "backbone_feature_sizes": [[16, 16], [8, 8], [4, 4]],
    }
    text = {"model_type": "clip_text_model", "vocab_size": 8, "projection_dim": WIDTH, "num_hidden_layers": 1, **small}
    detector = {
        "model_type": "sam3",
        "vision_config": vision,
        "text_config": text,
        "geometry_encoder_config": {"num_layers": 1, **small},
        "detr_encoder_config": {"num_layers": 1, **small},
        "detr_decoder_config": {"num_layers": 1, "num_queries": 5, **small},
        "mask_decoder_config": {"hidden_size": WIDTH, "num_attention_heads": 2},
    }
    memory = {"hidden_size": WIDTH, "num_layers": 2, "num_attention_heads": 1, "feed_forward_hidden_size": 64}
    tracker = {
        "model_type": "sam3_tracker_video",
        "vision_config": vision,
        "image_size": SIDE,
        "prompt_encoder_config": {"hidden_size": WIDTH, "image_size": SIDE, "patch_size": 14},
        "mask_decoder_config": {
            "hidden_size": WIDTH,
            "num_attention_heads": 2,
            "mlp_dim": 64,
            "iou_head_hidden_dim": WIDTH,
        },
        "num_maskmem": 3,
        "max_object_pointers_in_encoder": 4,
        **{f"memory_attention_{name}": number for name, number in memory.items()},
        "memory_attention_rope_feat_sizes": [4, 4],
        "memory_encoder_hidden_size": WIDTH,
        "memory_encoder_output_channels": MEMORY,
        "mask_downsampler_embed_dim": WIDTH,
        "memory_fuser_embed_dim": WIDTH,
        "memory_fuser_intermediate_dim": 64,
    }
    torch.manual_seed(0)
    config = Sam3VideoConfig(detector_config=detector, tracker_config=tracker, low_res_mask_size=16)
    model = Sam3VideoModel(config)
    # Otherwise the random tracker says that nothing is there.
    torch.nn.init.constant_(model.tracker_model.mask_decoder.pred_obj_score_head.proj_out.bias, 1.0)
    config.save_pretrained(folder)
    save_file(model.state_dict(), folder / "model.safetensors", {"format": "pt"})
    numbers = {"size": {"height": SIDE, "width": SIDE}, "image_mean": [0.5] * 3, "image_std": [0.5] * 3}
    other = {**numbers, "image_mean": [0.4] * 3}
    (folder / "processor_config.json").write_text(json.dumps({"image_processor": other, "video_processor": numbers}))
    return folder
