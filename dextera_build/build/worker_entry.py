"""What a worker loads: the runner, behind the importer, so that code which enters keys is compiled from its source."""

from dextera_build.code.importer import install

install().takes_dxb = True

from dextera_build.build.runner import run_task as run_task  # noqa: E402
