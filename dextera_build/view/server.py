"""The viewer's web server, and its export to files."""

from __future__ import annotations

import contextlib
import sys
from pathlib import Path
from typing import Any

from dextera_build.errors import MachineError


def start(port: int = 8080, host: str = "127.0.0.1") -> tuple[Any, str]:
    """Start a viser server with z up and return it with its URL; a taken port is replaced by the next free one.

    Args:
        port: Wanted TCP port.
        host: Address to listen on; the default is this machine alone.

    Raises:
        MachineError: viser is not installed.
    """
    try:
        import viser
    except ImportError:
        raise MachineError(
            "the viewer needs viser, which is not installed",
            code="DXB-E320",
            hint="`pip install 'dextera-build[view]'`",
        ) from None
    # Its banner belongs to people, and standard output to data.
    with contextlib.redirect_stdout(sys.stderr):
        server = viser.ViserServer(host=host, port=port, label="dxb", verbose=False)
    server.scene.set_up_direction("+z")
    # viser's fog begins right at the camera and would bleach photographs.
    server.scene.configure_fog(near=50.0, far=100.0, enabled=False)
    server.gui.configure_theme(dark_mode=False, show_logo=False)
    return server, f"http://{host}:{server.get_port()}"


def stop(server: Any) -> None:
    """Stop a server that `start` started."""
    with contextlib.redirect_stdout(sys.stderr):
        server.stop()


def static_export(server: Any, folder: Path) -> Path:
    """Write what the server shows to `folder/scene.viser` and return that file.

    viser calls this export experimental, so it stands behind this one function. `viser-build-client` makes the web
    page that plays it.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "scene.viser"
    path.write_bytes(server.get_scene_serializer().serialize())
    return path
