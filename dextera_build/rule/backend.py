"""Declaration of a backend."""

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
    takes: tuple[str, ...] = ()
    """Inputs of the rule that this backend is for: a call with one of them has it, unless it names another, or
    the profile takes stubs."""
    packages: tuple[str, ...] = ()
    """Distributions without which it is not chosen; their versions enter the key."""
    extra: str = ""
    """Extra of dextera-build that installs them."""
    gpu_gb: float = 0.0
    """Required GPU memory [GiB]."""
    cpu: bool = False
    """Whether it also runs, slower, on a machine without such a GPU; see `Context.device`."""
    weights: tuple[str, ...] = ()
    """Models described by `recipes/model/NAME.yaml`; digests of their weights enter the key. See `Context.weights`."""
    uses: tuple[str, ...] = ()
    """Other backends of the rule that it calls by `Context.other`; their code and packages enter the key."""
    command: tuple[str, ...] = ()
    """The program that answers `Context.outside`, see docs/outside.md; `{python}` is the Python of `environment`."""
    server: bool = False
    """Whether the program stays for the next calls of its worker."""
    files: tuple[str, ...] = ()
    """Patterns of the program's files other than those in `command`, from this file's folder; they enter the key."""
    environment: str = ""
    """`venv:FOLDER`, `conda:NAME`, `docker:IMAGE@sha256:...` or `podman:...`; left out, the Python of dxb."""
    lock: str = ""
    """File that lists the content of the environment, from the project's folder; it enters the key."""
    timeout_s: float = 3600.0
    """Longest duration of a call of the program [s]."""
    memory_gb: float = 0.0
    """Most memory of the program [GiB]; 0 for any."""
    disk_gb: float = 16.0
    """Most space of the program's answer and temporary files [GiB]."""
    licence: str = "Apache-2.0"
    """Licence of code and weights."""
