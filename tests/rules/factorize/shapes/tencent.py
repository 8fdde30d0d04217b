"""A local server that speaks the API of Tencent Cloud's Hunyuan3D, and checks the signature TC3-HMAC-SHA256.

Written from the vendor's description of the API (`ai3d`, 2025-05-13) and of signature version 3, not from its SDK.
"""

from __future__ import annotations

import base64
import hashlib
import hmac
import json
import re
import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from http.server import BaseHTTPRequestHandler
from typing import Any

from tests import local_server

SECRET_ID, SECRET_KEY = "AKIDz8krbsJ5yKBZQpn74WFkmLPx3EXAMPLE", "Gu5t9xGARNpq86cd98joQYCN3EXAMPLE"
_AUTHORISED = re.compile(
    r"TC3-HMAC-SHA256 Credential=(?P<id>[^/]+)/(?P<date>[\d-]+)/ai3d/tc3_request, "
    r"SignedHeaders=(?P<signed>[a-z;-]+), Signature=(?P<signature>[0-9a-f]{64})"
)


class Tencent:
    """Makes one GLB per job, after `rounds` queries.

    `faults` are served first, one per request of that action (`Submit`, `Query`, `File`): an error code, or `cut`
    (no answer), `torn` (half of the body), `html` (no JSON), `502`.
    """

    def __init__(self, glb: bytes) -> None:
        self.url = ""
        self.glb = glb
        self.rounds = 2
        self.fails = ""
        self.types = ["OBJ", "GLB"]
        self.faults: dict[str, list[str]] = {}
        self.submitted: list[dict[str, Any]] = []
        self.jobs: dict[str, int] = {}
        self.seen: list[str] = []
        self.region = ""
        self.content_type = "application/json"

    def answer(self, action: str, told: dict[str, Any]) -> dict[str, Any]:
        if action == "SubmitHunyuanTo3DProJob":
            self.submitted.append(told)
            name = f"13572372333116375{len(self.submitted):02d}"
            self.jobs[name] = self.rounds
            return {"JobId": name}
        if told.get("JobId") not in self.jobs:
            return _error("ResourceNotFound.JobId", "job not found or expired")
        self.jobs[told["JobId"]] -= 1
        left = self.jobs[told["JobId"]]
        plain = {"ErrorCode": "", "ErrorMessage": "", "ResultFile3Ds": []}
        if left >= 0:
            return {**plain, "Status": "RUN" if left < self.rounds - 1 else "WAIT"}
        if self.fails:
            return {**plain, "Status": "FAIL", "ErrorCode": "FailedOperation", "ErrorMessage": self.fails}
        files = [{"Type": kind, "Url": f"{self.url}/made.{kind.lower()}?q-signature=abc"} for kind in self.types]
        return {**plain, "Status": "DONE", "ResultFile3Ds": files}

    def refusal(self, handler: BaseHTTPRequestHandler, body: bytes) -> dict[str, Any] | None:
        """An error if the request is not signed as the vendor demands."""
        headers = handler.headers
        found = _AUTHORISED.fullmatch(headers["Authorization"] or "")
        if found is None:
            return _error("AuthFailure.InvalidAuthorization", "no TC3 signature")
        stamp = int(headers["X-TC-Timestamp"])
        date = datetime.fromtimestamp(stamp, UTC).strftime("%Y-%m-%d")
        if abs(time.time() - stamp) > 300 or date != found["date"]:
            return _error("AuthFailure.SignatureExpire", "signed too long ago")
        if found["id"] != SECRET_ID:
            return _error("AuthFailure.SecretIdNotFound", "no such secret id")
        names = found["signed"].split(";")
        if not {"content-type", "host"} <= set(names):
            return _error("AuthFailure.InvalidAuthorization", "content-type and host must be signed")
        lines = "".join(f"{name}:{(headers[name] or '').strip()}\n" for name in names)
        digest = hashlib.sha256(body).hexdigest()
        canonical = f"POST\n{handler.path}\n\n{lines}\n{found['signed']}\n{digest}"
        scope = f"{date}/ai3d/tc3_request"
        text = f"TC3-HMAC-SHA256\n{stamp}\n{scope}\n{hashlib.sha256(canonical.encode()).hexdigest()}"
        key = f"TC3{SECRET_KEY}".encode()
        for part in (date, "ai3d", "tc3_request"):
            key = hmac.new(key, part.encode(), hashlib.sha256).digest()
        if hmac.new(key, text.encode(), hashlib.sha256).hexdigest() != found["signature"]:
            return _error("AuthFailure.SignatureFailure", "the signature is wrong")
        return None

    def picture(self, number: int = -1) -> bytes:
        """The picture of a submitted job."""
        return base64.b64decode(self.submitted[number]["ImageBase64"])


def _error(code: str, message: str) -> dict[str, Any]:
    return {"Error": {"Code": code, "Message": message}}


@contextmanager
def serving_tencent(glb: bytes) -> Iterator[Tencent]:
    service = Tencent(glb)

    class Handler(local_server.Quiet, BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            body = self.rfile.read(int(self.headers["Content-Length"]))
            action = self.headers["X-TC-Action"] or ""
            service.region = self.headers["X-TC-Region"]
            fault = self.fault("Submit" if action.startswith("Submit") else "Query")
            if fault is None:
                return
            assert self.headers["X-TC-Version"] == "2025-05-13"
            told = service.refusal(self, body)
            told = told or (
                _error(fault, "try later") if fault[:1].isalpha() and fault not in ("html", "torn") else None
            )
            told = told or service.answer(action, json.loads(body))
            text = json.dumps({"Response": {**told, "RequestId": "e4de438f"}}).encode()
            self.give(b"<html>" if fault == "html" else text, 502 if fault == "502" else 200, torn=fault == "torn")

        def do_GET(self) -> None:
            fault = self.fault("File")
            if fault is not None:
                self.give(service.glb, 502 if fault == "502" else 200, torn=fault == "torn")

        def fault(self, kind: str) -> str | None:
            service.seen.append(kind)
            fault = (service.faults.get(kind) or [""]).pop(0)
            if fault != "cut":
                return fault
            self.close_connection = True
            self.connection.close()
            return None

        def give(self, body: bytes, status: int, *, torn: bool) -> None:
            self.send_response(status)
            self.send_header("Content-Type", service.content_type)
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body[: len(body) // 2] if torn else body)
            self.close_connection = torn

    with local_server.serving(Handler) as address:
        service.url = address
        yield service
