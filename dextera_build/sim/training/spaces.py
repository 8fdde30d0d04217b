"""Terms as Gymnasium spaces and observations."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from gymnasium import spaces

from dextera_build.policy.observation import DeployableObservation, PrivilegedObservation
from dextera_build.policy.terms import Term


def of_terms(terms: Iterable[Term]) -> spaces.Dict:
    """One box per term."""
    return spaces.Dict({term.key: _box(term) for term in terms})


def values(
    terms: Iterable[Term], shown: DeployableObservation, hidden: PrivilegedObservation | None
) -> dict[str, np.ndarray]:
    """Values of terms by key.

    Args:
        terms: Requested terms; privileged ones need `hidden`.
        shown: The deployable observation.
        hidden: The privileged quantities of the simulator.
    """
    found = {}
    for term in terms:
        name = term.declared.name
        if term.camera:
            found[term.key] = getattr(shown.frames[term.camera], name)
        elif term.declared.seen_by == "policies":
            found[term.key] = shown[name]
        else:
            assert hidden is not None
            found[term.key] = hidden[name]
    return found


def _box(term: Term) -> spaces.Box:
    if term.declared.dtype == "uint8":
        return spaces.Box(0, 255, term.shape, np.uint8)
    return spaces.Box(0.0 if term.declared.name == "depth" else -np.inf, np.inf, term.shape, np.float32)
