"""What a backend says of itself."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Backend:
    """Description of a backend, in literals so that it can be read without importing the file.

    A backend of rule `mesh` called `primitives` is the file `mesh_primitives.py` next to `mesh.py`, or in the folder of
    that stage in a project, with a module-level `BACKEND = Backend(...)` and the functions of the rule's `Protocol`.
    Each takes `ctx`, the inputs, and `options`: the backend's own, `Options` if it has none.
    """

    summary: str
    """One line for `dxb ls backends`."""
    profiles: tuple[str, ...] = ()
    """Profiles that take it for rules that their files do not list; see `recipe.profiles`."""
    packages: tuple[str, ...] = ()
    """Distributions that it uses; their versions enter the key."""
    extra: str = ""
    """Extra of dextera-build that installs them."""
    gpu_gb: float = 0.0
    """Required GPU memory [GiB]."""
    cpu: bool = False
    """Whether it also runs, slower, on a machine without such a GPU; see `Context.device`."""
    weights: tuple[str, ...] = ()
    """Models described by `recipes/model/NAME.yaml`; digests of their weights enter the key. See `Context.weights`."""
    licence: str = "Apache-2.0"
    """Licence of code and weights."""
