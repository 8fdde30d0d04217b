"""Jobs of Tencent Cloud's Hunyuan3D: one picture in, one GLB out.

API `ai3d`, version 2025-05-13: SubmitHunyuanTo3DProJob and QueryHunyuanTo3DProJob, signed with TC3-HMAC-SHA256 by
Tencent's own SDK.
"""

from __future__ import annotations

import base64
import json
import os
from collections.abc import Callable, Mapping
from typing import Any, Literal
from urllib.parse import urlsplit

from dextera_build.errors import MachineError, RuleError
from dextera_build.rule import JobState, Response

ADDRESS = "DXB_HUNYUAN_URL"
"""Environment variable with another address of the service."""
REGION = "DXB_HUNYUAN_REGION"
_DEFAULT_ADDRESS, _DEFAULT_REGION = "https://ai3d.tencentcloudapi.com", "ap-guangzhou"
_STATES: Mapping[str, Literal["waits", "runs", "done", "failed"]] = {
    "WAIT": "waits",
    "RUN": "runs",
    "DONE": "done",
    "FAIL": "failed",
}
_STATUS = (
    (("RequestLimitExceeded", "LimitExceeded"), 429),
    (("AuthFailure", "UnauthorizedOperation"), 401),
    (("ResourceNotFound",), 404),
    (("InternalError", "ServiceUnavailable"), 503),
)
"""First part of an error's code -> the equivalent HTTP status; the API answers with 200 even for errors."""
_OF_NETWORK = ("ClientNetworkError", "ServerNetworkError")
"""Codes that the SDK uses for a broken connection and for HTTP statuses other than 200."""
_LARGEST = 512 << 20
"""Maximum size of a GLB [bytes]."""


class HunyuanJob:
    """The client of one job; see `dextera_build.calls.Job`.

    Args:
        parameters: Parameters of SubmitHunyuanTo3DProJob, without the picture.
        picture: PNG; sides of 128 to 5000 px, 6 MB at most.
        secret: Name -> secret; called with `TENCENTCLOUD_SECRET_ID` and `TENCENTCLOUD_SECRET_KEY`.
    """

    def __init__(self, parameters: Mapping[str, object], picture: bytes, secret: Callable[[str], str]) -> None:
        self._parameters, self._picture, self._secret = parameters, picture, secret

    def submit(self, timeout_s: float) -> str | Response:
        """Submit the picture; the job's name is valid for 24 hours."""
        image = base64.b64encode(self._picture).decode()
        told = self._asked("SubmitHunyuanTo3DProJob", {**self._parameters, "ImageBase64": image}, timeout_s)
        return told if isinstance(told, Response) else str(told.get("JobId") or "")

    def poll(self, name: str, timeout_s: float) -> JobState | Response:
        """Progress of the job."""
        told = self._query(name, timeout_s)
        if isinstance(told, Response):
            return told
        state = _STATES.get(told.get("Status", ""))
        if state is None:
            raise RuleError(f"Hunyuan3D reports an unknown state: `{told.get('Status')}`", code="DXB-B344")
        return JobState(state, " ".join(str(told.get(part) or "") for part in ("ErrorCode", "ErrorMessage")).strip())

    def fetch(self, name: str, timeout_s: float) -> bytes | Response:
        """The GLB of a finished job; its address is valid for 24 hours."""
        told = self._query(name, timeout_s)
        if isinstance(told, Response):
            return told
        files = {
            str(file.get("Type", "")).upper(): str(file.get("Url", "")) for file in told.get("ResultFile3Ds") or ()
        }
        if not files.get("GLB"):
            raise RuleError(f"Hunyuan3D made no GLB, only: {', '.join(sorted(files)) or 'nothing'}", code="DXB-B344")
        _refuse_clear(files["GLB"])
        return _downloaded(files["GLB"], timeout_s)

    def cancel(self, name: str, timeout_s: float) -> bool:
        """Does nothing: the service cannot cancel a job."""
        return False

    def _query(self, name: str, timeout_s: float) -> dict[str, Any] | Response:
        return self._asked("QueryHunyuanTo3DProJob", {"JobId": name}, timeout_s)

    def _asked(self, action: str, parameters: Mapping[str, object], timeout_s: float) -> dict[str, Any] | Response:
        """The field `Response` of the answer to one request, or its error as a `Response`."""
        from tencentcloud.common.exception.tencent_cloud_sdk_exception import TencentCloudSDKException

        client = self._client(timeout_s)
        try:
            found: dict[str, Any] = dict(client.call_json(action, dict(parameters))["Response"])
        except TencentCloudSDKException as error:
            return _refusal(str(error.get_code()), str(error.get_message()))
        except (ValueError, KeyError, TypeError) as error:  # e.g. from a proxy
            raise OSError(f"the answer is none of the API: {type(error).__name__}") from None
        if fault := found.get("Error"):  # the SDK misses this if the content type has more than `application/json`
            return _refusal(str(fault.get("Code")), str(fault.get("Message")))
        return found

    def _client(self, timeout_s: float) -> Any:
        from tencentcloud.ai3d.v20250513.ai3d_client import Ai3dClient
        from tencentcloud.common.credential import Credential
        from tencentcloud.common.profile.client_profile import ClientProfile
        from tencentcloud.common.profile.http_profile import HttpProfile

        address = os.environ.get(ADDRESS) or _DEFAULT_ADDRESS
        _refuse_clear(address)
        parts = urlsplit(address)
        http = HttpProfile(protocol=parts.scheme, endpoint=parts.netloc, reqTimeout=timeout_s)
        credential = Credential(self._secret("TENCENTCLOUD_SECRET_ID"), self._secret("TENCENTCLOUD_SECRET_KEY"))
        profile = ClientProfile(signMethod="TC3-HMAC-SHA256", httpProfile=http)
        return Ai3dClient(credential, os.environ.get(REGION) or _DEFAULT_REGION, profile)


def _refusal(code: str, message: str) -> Response:
    """An error of the API as a response.

    Raises:
        OSError: The request or its answer was lost.
    """
    if code in _OF_NETWORK:
        raise OSError(f"{code}: {message}")
    status = next((status for begins, status in _STATUS if code.split(".")[0] in begins), 400)
    return Response(json.dumps({"code": code, "message": message}, ensure_ascii=False).encode(), status)


def _refuse_clear(address: str) -> None:
    parts = urlsplit(address)
    if parts.scheme != "https" and parts.hostname not in ("localhost", "127.0.0.1", "::1"):
        raise MachineError(
            "a picture or a mesh would be sent in the clear",
            code="DXB-E363",
            facts={"address": address},
            hint=f"export {ADDRESS}=https://...",
        )


def _downloaded(address: str, timeout_s: float) -> bytes | Response:
    import httpx

    with httpx.stream("GET", address, timeout=timeout_s, follow_redirects=True) as answer:
        if not answer.is_success:
            return Response(answer.read(), answer.status_code, dict(answer.headers))
        data = bytearray()
        for part in answer.iter_bytes():
            data += part
            if len(data) > _LARGEST:
                raise RuleError(f"the mesh is larger than {_LARGEST >> 20} MiB", code="DXB-B344")
    return bytes(data)
