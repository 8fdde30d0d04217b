"""A human hand's angles that bring its fingertips to given places: Gauss-Newton on all moments at once."""

from __future__ import annotations

import numpy as np

from dextera_build.geometry import hands, human_hand
from dextera_build.geometry.human_hand import Hand

ROUNDS = 20
"""Largest number of steps of Gauss-Newton; more change tips by less than their errors."""
STILL_RAD = 1e-4
"""It ends when no angle changes more in a step [rad]."""
PAIRS, NEAR_M = 3.0, 0.06
"""Weight of the way from the thumb's tip to each other tip where they touch, relative to the tips' places, and the
distance at which it is half of that [m]."""
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
    apart = np.linalg.norm(targets[:, 1:] - targets[:, :1], axis=-1)
    weights = PAIRS / (1 + (apart / NEAR_M) ** 2)
    for _ in range(ROUNDS):
        tips, jacobian = _tips(hand, found)
        off = tips[:, chosen] - targets
        rows = _rows(jacobian[:, chosen], off, weights)
        step = _solved(*rows, found[:, chosen], chosen)
        before = found.copy()
        found[:, chosen] -= step
        found = _within(found)
        if np.abs(found - before).max() < STILL_RAD:
            break
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


def _rows(jacobian: np.ndarray, off: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Jacobian (T, R, 4 F) and residuals (T, R) of the tips, and of the ways from the first tip to the others.

    Args:
        jacobian: Of each tip, (T, F, 3, 4).
        off: Of the tips, (T, F, 3) [m].
        weights: Of the ways, (T, F - 1).
    """
    moments, count = off.shape[:2]
    full = np.zeros((moments, count, 3, count, 4))
    for finger in range(count):
        full[:, finger, :, finger] = jacobian[:, finger]
    pairs, apart = full[:, 1:] - full[:, :1], off[:, 1:] - off[:, :1]
    pairs, apart = pairs * weights[:, :, None, None, None], apart * weights[:, :, None]
    both = np.concatenate([full, pairs], axis=1).reshape(moments, -1, 4 * count)
    return both, np.concatenate([off, apart], axis=1).reshape(moments, -1)


def _solved(jacobian: np.ndarray, off: np.ndarray, now: np.ndarray, chosen: list[int]) -> np.ndarray:
    """The step (T, F, 4) of Gauss-Newton towards the targets and, a little, towards the open hand.

    Angles at a limit that would go beyond it do not take part.
    """
    moments, count = now.shape[:2]
    away = (now - human_hand.open_angles()[chosen]).reshape(moments, -1)
    pull = np.einsum("tri,tr->ti", jacobian, off) + REST_M**2 * away
    low, high = (np.broadcast_to(_LIMITS[chosen, :, end], now.shape).reshape(moments, -1) for end in (0, 1))
    angles = now.reshape(moments, -1)
    free = ~(((angles <= low) & (pull > 0)) | ((angles >= high) & (pull < 0)))
    moved = jacobian * free[:, None]
    normal = moved.swapaxes(1, 2) @ moved + REST_M**2 * np.eye(4 * count)
    step = np.linalg.solve(normal, (pull * free)[..., None])[..., 0]
    return np.clip(step, -0.3, 0.3).reshape(moments, count, 4)


def _within(found: np.ndarray) -> np.ndarray:
    return _coupled(np.clip(found, _LIMITS[..., 0], _LIMITS[..., 1]))


def _coupled(found: np.ndarray) -> np.ndarray:
    """The last joint of the four fingers follows the middle one."""
    made = found.copy()
    made[:, 1:, 3] = human_hand.COUPLED * made[:, 1:, 2]
    return made
