"""Backend sam3_video of align.follow: the tracker of SAM 3, which keeps a memory of each object."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dextera_build.artifacts.cameras.mask_track import MaskTrack
from dextera_build.artifacts.cameras.video import Video
from dextera_build.learning.vision_input import VisionInput
from dextera_build.rule import Backend, Context, Options

if TYPE_CHECKING:
    from torch import Tensor

BACKEND = Backend(
    summary="the tracker of SAM 3, from the masks of the first frame",
    profiles=("gpu",),
    packages=("torch", "transformers"),
    extra="models",
    gpu_gb=6.0,
    cpu=True,
    weights=("sam3",),
    licence="SAM License",
)


@dataclass(frozen=True)
class Tracker:
    """The tracker of SAM 3 and the data type of its input."""

    model: Any
    images: VisionInput


def follow(ctx: Context, video: Video, first: np.ndarray, names: tuple[str, ...], options: Options) -> MaskTrack:
    """Masks of SAM 3 (Meta, 2025), given those of the first frame; an occluded object may be found again.

    A pixel has the label with the highest logit, if that is positive; the score is the model's probability that the
    object is in the frame. Frames are decoded one by one, and the memory does not grow with their number.
    """
    return MaskTrack.of(names, video.stamps, _frames(ctx, video, first, len(names)))


def self_test(ctx: Context) -> None:
    """Check that the tracker follows a square over two grey frames."""
    grey, first = np.full((2, 64, 64, 3), 128, np.uint8), np.zeros((64, 64), np.uint8)
    first[16:48, 16:48] = 1
    assert len(list(answers(ctx.load(load_tracker, "sam3"), grey, first))) == 2


def load_tracker(folder: Path, device: str) -> Tracker:
    """Load the tracker from a folder with the weights of SAM 3, which also contain its detector."""
    import transformers

    library: Any = transformers  # partly typed
    model = library.Sam3TrackerVideoModel.from_pretrained(folder, use_safetensors=True)
    return Tracker(model.to(device).eval(), VisionInput.read(folder, "video_processor"))


def answers(tracker: Tracker, frames: Iterable[np.ndarray], first: np.ndarray) -> Iterator[tuple[Tensor, Tensor]]:
    """Output of the model for each frame and each object of the first frame, in the order of their labels.

    Args:
        tracker: The model.
        frames: Pixels (H, W, 3) uint8.
        first: Labels (H, W) uint8 of the first frame.

    Returns:
        Logits (K, h, w) of the masks, at the model's resolution, and (K,) of the presence of the objects.
    """
    from transformers.models.sam3_tracker_video.modeling_sam3_tracker_video import Sam3TrackerVideoInferenceSession

    device = tracker.model.device
    session: Any = Sam3TrackerVideoInferenceSession(
        video_height=first.shape[0],
        video_width=first.shape[1],
        inference_device=device,
        inference_state_device=device,
        video_storage_device=device,
        dtype=tracker.model.dtype,
    )
    shown = [int(label) for label in np.unique(first) if label]
    for label in shown:
        session.add_mask_inputs(session.obj_id_to_idx(label), 0, _prompt(first == label, tracker.images.size))
    session.obj_with_new_inputs = list(shown)
    config = tracker.model.config
    for number, pixels in enumerate(frames):
        said = tracker.model(session, frame=tracker.images.tensor(pixels).to(device), frame_idx=number)
        _forget(session, number, max(config.num_maskmem, config.max_object_pointers_in_encoder))
        height, width = said.pred_masks.shape[-2:]
        yield said.pred_masks.reshape(-1, height, width).float(), said.object_score_logits.reshape(-1).float()


def _frames(ctx: Context, video: Video, first: np.ndarray, count: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Labels (H, W) uint8 and scores (K,) of each frame."""
    import torch

    shown = np.unique(first[first > 0])
    for done, (logits, presence) in enumerate(answers(ctx.load(load_tracker, "sam3"), video.every(), first)):
        ctx.progress(done, len(video.stamps), "frames")
        large = torch.nn.functional.interpolate(logits[None], first.shape, mode="bilinear", align_corners=False)[0]
        best, place = (each.cpu().numpy() for each in large.max(dim=0))
        labels = np.where(best > 0, shown[place], 0).astype(np.uint8)
        scores = np.zeros(count, np.float32)
        scores[shown - 1] = presence.sigmoid().cpu().numpy()
        yield (labels if done else first), scores


def _prompt(mask: np.ndarray, size: tuple[int, int]) -> Tensor:
    """A mask (H, W) bool as input of the tracker, (1, 1, h, w) float32 of zeros and ones."""
    import torch

    given = torch.from_numpy(mask.astype(np.float32))[None, None]
    large = torch.nn.functional.interpolate(given, size, mode="bilinear", align_corners=False, antialias=True)
    return (large >= 0.5).float()


def _forget(session: Any, number: int, kept: int) -> None:
    """Drop data that the model no longer needs: the picture, masks at full size, and frames older than `kept`."""
    session.processed_frames.pop(number)
    for outputs in session.output_dict_per_obj.values():
        for each in outputs.values():
            each.get(number, {}).pop("high_res_masks", None)
        outputs["non_cond_frame_outputs"].pop(number - kept, None)
