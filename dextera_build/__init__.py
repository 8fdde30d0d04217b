"""dxb: a content-addressed build system for robot digital twins."""

from dextera_build.version import __version__

# Every command loads this file, so it avoids importing `typing`; type checkers treat this name as true.
TYPE_CHECKING = False
if TYPE_CHECKING:
    from dextera_build.api import Project as Project
    from dextera_build.api import Result as Result

__all__ = ["Project", "Result", "__version__"]


def __getattr__(name: str) -> object:
    # Imported on first use to keep `import dextera_build` and the command line fast.
    if name in ("Project", "Result"):
        from importlib import import_module

        return getattr(import_module("dextera_build.api"), name)
    raise AttributeError(f"module `dextera_build` has no attribute `{name}`")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__} - {"TYPE_CHECKING"})
