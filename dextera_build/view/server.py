"""The viewer's web server."""

from __future__ import annotations

import contextlib
import io
import socket
from collections.abc import Sequence
from typing import Any

from dextera_build.errors import MachineError, UsageError, install_extra
from dextera_build.view import panel
from dextera_build.view.guard import Guard


def start(port: int = 8080, host: str = "127.0.0.1", origins: Sequence[str] = ()) -> tuple[Any, str]:
    """Start a viser server with z up and return it with its URL; if the port is in use, take the next free one.

    Args:
        port: Wanted TCP port.
        host: Address to listen on; the default is this machine alone.
        origins: Origins whose pages may connect in addition to the viewer's own: those of a proxy or a tunnel.

    Raises:
        UsageError: One of `origins` is not an origin, or `host` is not an address of this machine.
        MachineError: viser is not installed.
    """
    try:
        import viser
    except ImportError:
        raise MachineError(
            "the viewer needs viser, which is not installed",
            code="DXB-E320",
            hint=install_extra("view"),
        ) from None
    _check_address(host)
    with _mute(), Guard(host, origins).installed():
        server = viser.ViserServer(host=host, port=port, label="dxb", verbose=False)
    server.scene.set_up_direction("+z")
    # viser's fog begins right at the camera and would bleach photographs.
    server.scene.configure_fog(near=50.0, far=100.0, enabled=False)
    server.gui.configure_theme(dark_mode=False, show_logo=False)
    return server, f"http://{shown(host)}:{server.get_port()}"


def shown(host: str) -> str:
    """The part of a URL by which other machines reach a server that listens on `host`."""
    name = socket.gethostname() if host in ("0.0.0.0", "::") else host
    return f"[{name}]" if ":" in name else name


def _check_address(host: str) -> None:
    """Check `host` by listening on any port: viser takes every failure for a port in use and tries a thousand."""
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind, protocol) as probe:
            probe.bind(address)
    except OSError as error:
        raise UsageError(
            f"`{host}` is not an address of this machine",
            code="DXB-U322",
            facts={"system": error.strerror or str(error)},
            hint="`--host 127.0.0.1` serves this machine, `--host 0.0.0.0` every network that it is in",
        ) from None


def clear(server: Any) -> None:
    """Remove the scene and the panel, for others to take their place."""
    server.scene.reset()
    server.gui.reset()
    panel.noted(server).clear()


def stop(server: Any) -> None:
    """Stop a server that `start` started; without it, viser prints at the end of the process that it stopped."""
    with _mute():
        server.stop()


def _mute() -> contextlib.redirect_stdout[io.StringIO]:
    """Drop what viser prints, a banner and that it stopped: standard output is for data."""
    return contextlib.redirect_stdout(io.StringIO())
