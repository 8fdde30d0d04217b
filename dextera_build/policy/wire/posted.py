"""The protocol of OpenVLA: one POST per step, JSON with arrays as `json_numpy` writes them.

[openvla: vla-scripts/deploy.py; json_numpy 2.1]
"""

from __future__ import annotations

import base64
import json
import math
import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from dextera_build.errors import MachineError, install_extra
from dextera_build.policy.wire import link
from dextera_build.redact import hide

ERROR = "error"
"""The answer of OpenVLA's server to a request that failed, with HTTP status 200."""


class Posted:
    """A policy that is asked by POST.

    Args:
        address: `http://HOST:PORT/act`.
        key: Sent as `Authorization: Api-Key`; empty: none.

    Raises:
        MachineError: Nothing answers there.
    """

    greeting = b""

    def __init__(self, address: str, key: str = "") -> None:
        self._httpx = _httpx()
        self._address = address
        headers = {"Content-Type": "application/json"}
        if key:
            hide("the key of a policy's server", key)
            headers["Authorization"] = f"Api-Key {key}"
        self._client = self._httpx.Client(headers=headers, timeout=link.CONNECT_S, trust_env=False)
        try:
            status = self._client.head(address).status_code  # answered with an error, as only POST is allowed
        except (self._httpx.HTTPError, self._httpx.InvalidURL, OSError) as error:
            self.close()
            raise link.unreachable(address, error) from None
        if status in (401, 403, 404):
            self.close()
            raise link.unreachable(address, f"HTTP status {status}")

    def ask(self, request: Mapping[str, Any], limit_s: float) -> Mapping[str, Any]:
        """The answer to a request; see `link.Link`.

        Raises:
            PolicyFault: There is no answer, or it is none of this protocol.
        """
        content = json.dumps(request, default=_as_json).encode()
        ends = time.monotonic() + limit_s
        data = bytearray()
        try:
            with self._client.stream("POST", self._address, content=content, timeout=limit_s) as response:
                for part in response.iter_bytes():
                    data += part
                    if time.monotonic() > ends:
                        raise link.late(self._address, limit_s)
                    if len(data) > link.LARGEST:
                        link.too_large(self._address, "an answer of")
        except self._httpx.TimeoutException:
            raise link.late(self._address, limit_s) from None
        except (self._httpx.HTTPError, self._httpx.StreamError, OSError) as error:
            raise link.lost(self._address, error) from None
        if response.status_code != 200:
            raise link.failed(
                self._address, f"HTTP status {response.status_code}: {data[:500].decode(errors='replace')}"
            )
        return {"actions": self._actions(bytes(data))}

    def _actions(self, data: bytes) -> object:
        """What an answer holds: a list, an array, or either of them written as text once more."""
        try:
            found = json.loads(data)
            found = json.loads(found) if isinstance(found, str) and found != ERROR else found
        except (ValueError, RecursionError) as error:
            raise link.unusable(self._address, "is no JSON", reason=error) from None
        if found == ERROR:
            hint = "the server's log has the traceback; a model of several data sets needs `unnorm_key`"
            raise link.failed(self._address, ERROR, hint)
        if isinstance(found, dict) and "__numpy__" in found:
            return self._array(found)
        return found

    def _array(self, parts: Mapping[str, Any]) -> np.ndarray:
        try:
            dtype = np.dtype(str(parts["dtype"]))
            data, shape = base64.b64decode(parts["__numpy__"]), tuple(map(int, parts["shape"]))
            if dtype.kind not in "iuf" or math.prod(shape) * dtype.itemsize != len(data):
                raise ValueError(f"{len(data)} bytes for {shape} of {dtype}")
            return np.frombuffer(data, dtype).reshape(shape)
        except (KeyError, TypeError, ValueError) as error:
            raise link.unusable(self._address, "is no array", reason=error) from None

    def close(self) -> None:
        """End the connection."""
        self._client.close()


def _as_json(value: Any) -> dict[str, Any]:
    """An array as `json_numpy` writes it."""
    if not isinstance(value, np.ndarray):
        raise TypeError(f"a request cannot hold a {type(value).__name__}")
    return {"__numpy__": base64.b64encode(value.tobytes()).decode(), "dtype": value.dtype.str, "shape": value.shape}


def _httpx() -> Any:
    """The module httpx.

    Raises:
        MachineError: It is not installed.
    """
    try:
        import httpx
    except ImportError:
        raise MachineError(
            "a policy behind HTTP needs httpx, which is not installed",
            code="DXB-E329",
            hint=install_extra("serve"),
        ) from None
    return httpx
