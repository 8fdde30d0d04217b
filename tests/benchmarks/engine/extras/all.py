"""Every row beside the graphs; a new measurement, of a remote say, is one more function in `EXTRAS`."""

from __future__ import annotations

from tests.benchmarks.engine.extras.folder import large_folder
from tests.benchmarks.engine.extras.graphs import long_chain, memory, pool, restore
from tests.benchmarks.engine.extras.row import Extra
from tests.benchmarks.engine.extras.twin import twin

EXTRAS: tuple[Extra, ...] = (restore, pool, long_chain, memory, large_folder, twin)
