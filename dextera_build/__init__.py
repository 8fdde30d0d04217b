"""dxb: a content-addressed build system for robot digital twins."""

from dextera_build.version import __version__

# Every command waits for this file, so it does not import `typing`; type checkers take any such name for true.
TYPE_CHECKING = False
if TYPE_CHECKING:
    from dextera_build.api import Project as Project
    from dextera_build.api import Result as Result

__all__ = ["Project", "Result", "__version__"]


def __getattr__(name: str) -> object:
    # On first use, so that neither `import dextera_build` nor the command line waits for it.
    if name in ("Project", "Result"):
        from importlib import import_module

        return getattr(import_module("dextera_build.api"), name)
    raise AttributeError(f"module `dextera_build` has no attribute `{name}`")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__} - {"TYPE_CHECKING"})
