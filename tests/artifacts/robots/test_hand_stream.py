"""HandStream: what it says of itself, and every error of a value that does not fit."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.robots.hand_stream import HandStream, Take
from dextera_build.errors import ArtifactError
from tests.hand_streams import RATE_HZ, stream, with_buttons

COUNT = 12


def test_wrists_are_the_first_joints_and_the_rate_is_that_of_the_messages() -> None:
    made = stream(COUNT, lost=[(1, 2, 4)])
    np.testing.assert_array_equal(made.wrists[..., :3], made.positions[:, :, 0])
    np.testing.assert_array_equal(made.wrists[..., 3:], made.rotations[:, :, 0])
    assert np.isnan(made.wrists[2:4, 1]).all()
    assert made.rate_hz == pytest.approx(RATE_HZ, rel=1e-6)
    assert stream(1).rate_hz == 0


def test_a_value_comes_back_from_the_store() -> None:
    blobs: dict[str, bytes] = {}

    def put(data: bytes) -> str:
        key = str(hash(data))
        blobs[key] = bytes(data)
        return key

    made = with_buttons()
    found = HandStream.decode(made.encode(put), blobs.__getitem__)
    for name in HandStream.model_fields:
        np.testing.assert_array_equal(getattr(found, name), getattr(made, name))


def array(name: str, index: object, value: float) -> np.ndarray:
    changed = np.array(getattr(stream(COUNT), name))
    changed[index] = value
    return changed


WRONG = {
    "A501": ({"stamps": array("stamps", 5, 0.0)}, "HandStream.stamps do not increase"),
    "A551": ({"takes": (Take(first=0, last=4), Take(first=3, last=8))}, "takes overlap, are empty, or reach beyond"),
    "A552": ({"tracking": array("tracking", (3, 1), 7)}, "there is no state 7"),
    "A553": ({"positions": array("positions", (4, 0, 9), np.nan)}, "left hand at 0.055555556 s does not fit"),
    "A554": ({"rotations": array("rotations", (4, 0, 9), 0.9)}, "quaternions are of another length than 1"),
    "A555": ({"pinch": array("pinch", (4, 0), 1.5)}, "outside of 0 .open. to 1 .closed."),
    "A556": ({"button_names": ("success",)}, "1 names for 0 columns of buttons"),
}


@pytest.mark.parametrize("code", WRONG)
def test_a_value_that_does_not_fit_is_refused(code: str) -> None:
    changes, text = WRONG[code]
    with pytest.raises(ArtifactError, match=text) as caught:
        stream(COUNT, **changes)
    assert caught.value.code == f"DXB-{code}"


def test_a_stream_has_a_message_and_25_joints() -> None:
    with pytest.raises(ArtifactError, match="needs a message"):
        stream(0)
    with pytest.raises(ArtifactError, match=r"positions.*21"):
        stream(COUNT, positions=stream(COUNT).positions[:, :, :21])


@pytest.mark.parametrize("takes", [(Take(first=4, last=4),), (Take(first=0, last=COUNT + 1),)])
def test_takes_lie_within_the_messages(takes: tuple[Take, ...]) -> None:
    with pytest.raises(ArtifactError, match="reach beyond"):
        stream(COUNT, takes=takes)


def test_a_lost_hand_that_has_a_pose_is_refused() -> None:
    with pytest.raises(ArtifactError, match="does not fit its tracking state 0") as caught:
        stream(COUNT, tracking=array("tracking", (2, 0), 0))
    assert caught.value.facts["joints without a number"] == "0 of 25"


def test_a_take_is_a_stream_of_its_own() -> None:
    whole = with_buttons()
    assert [(take.first, take.last) for take in whole.demonstrations] == [(0, 8), (9, 20)]
    part = whole.during(whole.takes[1])
    np.testing.assert_array_equal(part.stamps, whole.stamps[9:])
    np.testing.assert_array_equal(part.positions, whole.positions[9:])
    assert part.buttons is not None
    assert whole.buttons is not None
    np.testing.assert_array_equal(part.buttons, whole.buttons[9:])
    assert HandStream(**dict(part)).takes == (Take(first=0, last=11),)
    assert [(take.first, take.last) for take in stream(5).demonstrations] == [(0, 5)]
