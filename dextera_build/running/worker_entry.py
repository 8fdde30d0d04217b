"""Entry point of workers: the runner, loaded after the importer so that digested code is compiled from source."""

from dextera_build.code.children import Children
from dextera_build.code.importer import install

_importer = install()
_importer.takes_dxb = True
_importer.children = Children()

from dextera_build.calls import secrets  # noqa: E402
from dextera_build.running.runner import run_task as run_task  # noqa: E402

secrets.withhold()
