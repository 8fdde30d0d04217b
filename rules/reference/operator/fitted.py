"""A human hand's angles that bring its fingertips to given places: Gauss-Newton on all moments at once."""

from __future__ import annotations

import numpy as np

from dextera_build.geometry import hands, human_hand
from dextera_build.geometry.human_hand import Hand

ROUNDS = 40
"""Steps of Gauss-Newton; it has converged long before."""
PAIRS = 2.0
"""Weight of the way from the thumb's tip to each other tip, relative to the tips' places."""
REST_M = 0.002
"""Weight of the distance from the open hand [m/rad]: joints that the tips leave free stay there."""
_LIMITS = np.deg2rad(human_hand.LIMITS_DEG.astype(np.float64))
_STEP = 1e-5


def angles(hand: Hand, targets: np.ndarray, fingers: tuple[int, ...]) -> np.ndarray:
    """Angles (T, 5, 4) [rad] at which the tips of a right hand are nearest to their targets.

    Fingers without a target bend as the one before them.

    Args:
        hand: The hand.
        targets: (T, F, 3) in the frame of the wrist [m].
        fingers: Finger of each target, in order; the thumb's 0 is the first.
    """
    found = np.tile(human_hand.open_angles(), (len(targets), 1, 1))
    chosen = list(fingers)
    for _ in range(ROUNDS):
        tips, jacobian = _tips(hand, found)
        off = tips[:, chosen] - targets
        rows = _rows(jacobian[:, chosen], off)
        step = _solved(*rows, (found - human_hand.open_angles())[:, chosen])
        found[:, chosen] = found[:, chosen] - step
        found = _within(found)
    for finger in range(1, len(hands.FINGERS)):
        if finger not in chosen:
            found[:, finger] = found[:, finger - 1]
    return found


def tips(hand: Hand, found: np.ndarray) -> np.ndarray:
    """Tips (T, 5, 3) [m] of a right hand in the frame of the wrist at angles (T, 5, 4)."""
    return hand.joints(found, hands.SIDES[1])[0][..., hands.TIPS, :]


def _tips(hand: Hand, found: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Tips (T, 5, 3), and their change (T, 5, 3, 4) with the angles of their own finger."""
    plain = tips(hand, found)
    columns = []
    for number in range(found.shape[-1]):
        changed = found.copy()
        changed[..., number] += _STEP
        columns.append((tips(hand, _coupled(changed)) - plain) / _STEP)
    return plain, np.stack(columns, axis=-1)


def _rows(jacobian: np.ndarray, off: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Jacobian (T, R, 4 F) and residuals (T, R) of the tips, and of the ways from the first tip to the others."""
    moments, count = off.shape[:2]
    full = np.zeros((moments, count, 3, count, 4))
    for finger in range(count):
        full[:, finger, :, finger] = jacobian[:, finger]
    pairs, apart = full[:, 1:] - full[:, :1], off[:, 1:] - off[:, :1]
    both = np.concatenate([full, PAIRS * pairs], axis=1).reshape(moments, -1, 4 * count)
    return both, np.concatenate([off, PAIRS * apart], axis=1).reshape(moments, -1)


def _solved(jacobian: np.ndarray, off: np.ndarray, away: np.ndarray) -> np.ndarray:
    """The step (T, F, 4) of Gauss-Newton towards the targets and, a little, towards the open hand."""
    moments, count = away.shape[:2]
    normal = jacobian.swapaxes(1, 2) @ jacobian + REST_M**2 * np.eye(4 * count)
    pull = np.einsum("tri,tr->ti", jacobian, off) + REST_M**2 * away.reshape(moments, -1)
    step = np.linalg.solve(normal, pull[..., None])[..., 0]
    return np.clip(step, -0.3, 0.3).reshape(moments, count, 4)


def _within(found: np.ndarray) -> np.ndarray:
    return _coupled(np.clip(found, _LIMITS[..., 0], _LIMITS[..., 1]))


def _coupled(found: np.ndarray) -> np.ndarray:
    """The last joint of the four fingers follows the middle one."""
    made = found.copy()
    made[:, 1:, 3] = human_hand.COUPLED * made[:, 1:, 2]
    return made
