"""The driver's store as the workers of one build reach it: over HTTP, under a password that lives as long as that."""

from __future__ import annotations

import resource
import secrets
import threading
from contextlib import suppress
from dataclasses import replace

from dextera_build.engine.executors.ray_worker import Setup
from dextera_build.store.remotes.server import CacheServer
from dextera_build.store.store import Store


class DriverStore:
    """Serves a store until it is closed.

    Args:
        store: The driver's.
        host: Address to listen at.
    """

    def __init__(self, store: Store, host: str) -> None:
        _allow_connections()
        password = secrets.token_urlsafe(24)
        self._server = CacheServer(store, (host, 0), secret=password)
        threading.Thread(target=self._server.serve_forever, name="dxb store", daemon=True).start()
        self.url = self._server.url.replace("://", f"://dxb:{password}@")
        """With the password."""

    def told(self, setup: Setup) -> Setup:
        """`setup` with this store, where recorded answers are looked for, too."""
        listed = setup.environment.get("DXB_REMOTES") or "remote:r"
        environment = {**setup.environment, "DXB_REMOTES": f"{self.url}:r,{listed}"}
        return replace(setup, driver=self.url, environment=environment)

    def close(self) -> None:
        """Serve no longer."""
        self._server.shutdown()
        self._server.server_close()


def _allow_connections() -> None:
    """Have as many open files as the system allows: every worker holds connections."""
    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    with suppress(ValueError, OSError):
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
