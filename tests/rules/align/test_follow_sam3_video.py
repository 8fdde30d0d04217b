"""Masks by the tracker of SAM 3: it runs with random weights, and its answers are chosen as constructed."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from dextera_build.artifacts.cameras.image import LabelImage
from dextera_build.artifacts.cameras.mask_track import MaskTrack
from dextera_build.artifacts.cameras.video import Video
from dextera_build.code.loader import Library
from dextera_build.formats import video as video_files
from dextera_build.testing import RuleRunner
from tests.installed import needs
from tests.rules.align import tiny_sam3_video

torch = pytest.importorskip("torch")
needs("transformers", "av")

COUNT, SHAPE = 12, (40, 64)


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tiny_sam3_video.sam3_video(tmp_path_factory.mktemp("weights") / "sam3")


@pytest.fixture
def backend() -> ModuleType:
    return Library().find("align.follow").backends["sam3_video"].module


@pytest.fixture
def video(tmp_path: Path) -> Video:
    return video_files.write(tmp_path / "a.mp4", noise(), video_files.encoder(SHAPE[1], SHAPE[0], 30.0, qp=10))


def noise() -> np.ndarray:
    """Frames that differ, (N, H, W, 3) uint8."""
    return np.random.default_rng(0).integers(0, 256, (COUNT, *SHAPE, 3), dtype=np.uint8)


def truth() -> np.ndarray:
    """Label 1 moves right and leaves, label 3 stays and is hidden for some frames; there is no label 2."""
    labels = np.zeros((COUNT, *SHAPE), np.uint8)
    for number in range(COUNT):
        labels[number, 4:20, 4 + 8 * number : 20 + 8 * number] = 1
        if number not in (5, 6):
            labels[number, 24:36, 10:30] = 3
    return labels


def run(folder: Path, weights: Path, video: Video) -> tuple[MaskTrack, str]:
    runner, first = RuleRunner(folder, weights={"sam3": weights}), LabelImage(labels=truth()[0].astype(np.int32))
    found: MaskTrack = runner.run("align.follow", backend="sam3_video", video=video, first=first)
    return found, runner.outcome.line


@pytest.mark.slow
def test_the_tracker_runs_and_gives_the_same_masks_again(tmp_path: Path, weights: Path, video: Video) -> None:
    (first, _), (second, _) = (run(tmp_path / name, weights, video) for name in "ab")
    assert first.file == second.file
    assert (first.width, first.height, first.names) == (SHAPE[1], SHAPE[0], ("1", "2", "3"))
    assert np.array_equal(first.labels(0), truth()[0])
    assert first.scores is not None
    assert not first.scores[:, 1].any()
    assert (first.scores[:, [0, 2]] > 0.5).all()


def test_all_weights_are_those_of_the_checkpoint(backend: ModuleType, weights: Path) -> None:
    from safetensors.torch import load_file

    stored, tracker = load_file(weights / "model.safetensors"), backend.load_tracker(weights, "cpu")
    for name, array in tracker.model.state_dict().items():
        places = (
            f"tracker_model.{name}",
            name.replace("vision_encoder.neck.", "tracker_neck."),
            f"detector_model.{name}",
        )
        kept = next(stored[place] for place in places if place in stored)
        assert torch.equal(kept, array), name
    assert tracker.images.mean == (0.5, 0.5, 0.5), "those of the video processor"


def library_session(first: np.ndarray, video: Any) -> Any:
    """A session with the whole video in memory and prompts as the processor of transformers makes them."""
    from transformers.models.sam3_tracker_video import modeling_sam3_tracker_video as modeling
    from transformers.models.sam3_tracker_video.processing_sam3_tracker_video import Sam3TrackerVideoProcessor

    session = modeling.Sam3TrackerVideoInferenceSession(video=video, dtype=torch.float32)
    Sam3TrackerVideoProcessor.process_new_mask_for_video_frame(
        SimpleNamespace(target_size=tiny_sam3_video.SIDE), session, 0, [1, 3], [first == 1, first == 3]
    )
    return session


@pytest.mark.medium
def test_frames_one_by_one_are_followed_as_a_whole_video_is(backend: ModuleType, weights: Path) -> None:
    tracker, first = backend.load_tracker(weights, "cpu"), truth()[0]
    found = list(backend.answers(tracker, iter(noise()), first))
    session = library_session(first, torch.cat([tracker.images.tensor(frame) for frame in noise()]))
    wanted = list(tracker.model.propagate_in_video_iterator(session, start_frame_idx=0))
    assert len(found) == len(wanted) == COUNT
    for (logits, presence), said in zip(found, wanted, strict=True):
        assert torch.allclose(logits, said.pred_masks[:, 0], atol=1e-5)
        assert torch.allclose(presence, said.object_score_logits[:, 0], atol=1e-5)
    assert not torch.allclose(found[-1][0], found[-2][0], atol=1e-5), "the frames differ"


def test_memory_does_not_grow_with_the_number_of_frames(backend: ModuleType, weights: Path, monkeypatch: Any) -> None:
    from transformers.models.sam3_tracker_video import modeling_sam3_tracker_video as modeling

    made: list[Any] = []

    class Session(modeling.Sam3TrackerVideoInferenceSession):
        def __init__(self, **given: Any) -> None:
            super().__init__(**given)
            made.append(self)

    monkeypatch.setattr(modeling, "Sam3TrackerVideoInferenceSession", Session)
    for _ in backend.answers(backend.load_tracker(weights, "cpu"), iter(noise()), truth()[0]):
        (session,) = made
        assert not session.processed_frames
        for outputs in session.output_dict_per_obj.values():
            assert list(outputs["cond_frame_outputs"]) == [0]
            assert len(outputs["non_cond_frame_outputs"]) <= 4
            assert not any("high_res_masks" in each for kind in outputs.values() for each in kind.values())


def test_logits_become_labels(
    tmp_path: Path, weights: Path, video: Video, backend: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Answers at the size of the video: the highest logit wins, and what is hidden is found again."""

    def said(tracker: object, frames: Iterator[np.ndarray], first: np.ndarray) -> Iterator[tuple[Any, Any]]:
        for labels, _ in zip(truth(), frames, strict=True):
            masks = torch.from_numpy(np.stack([labels == 1, labels == 3])).float()
            # The first object has each pixel for which no other has a higher logit.
            wide = torch.tensor([[[0.5]], [[0.0]]])
            there = masks.flatten(1).any(1)
            logits = torch.where(there[:, None, None], 4 * masks - 2 + wide * masks[1], torch.tensor(-1024.0))
            yield logits, torch.where(there, 5.0, -5.0)

    monkeypatch.setattr(backend, "answers", said)
    found, line = run(tmp_path, weights, video)
    assert np.array_equal(np.stack(list(found.every())), truth())
    last = int(np.flatnonzero((truth() == 1).any(axis=(1, 2))).max())
    assert line == f"3 objects through 12 frames; 1 not seen after {found.stamps[last]:.2f} s; 2 never seen"
    assert found.scores is not None
    assert found.scores[5].tolist() == pytest.approx([1 / (1 + np.exp(-5)), 0, 1 / (1 + np.exp(5))], abs=1e-6)


def test_the_self_test_runs(backend: ModuleType, weights: Path, tmp_path: Path) -> None:
    from dextera_build.rule import Context
    from dextera_build.rule.pretrained import Pretrained

    found = Pretrained(("sam3@sam3",), lambda entry: weights)
    backend.self_test(Context(backend, scratch=tmp_path, pretrained=found))
