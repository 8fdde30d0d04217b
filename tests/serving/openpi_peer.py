"""Runs in an environment with openpi-client: asks the policy at an address, and answers as JSON."""

import json
import sys

import json_numpy
import numpy as np
from openpi_client import msgpack_numpy
from openpi_client.websocket_client_policy import WebsocketClientPolicy

address, key, asked, posted = sys.argv[1:]
policy = WebsocketClientPolicy(address, api_key=key)
stated = policy.get_server_metadata()
with open(asked, "rb") as file:  # packed by dxb
    requests = msgpack_numpy.unpackb(file.read())
chunks = []
for step, request in enumerate(requests):
    request["prompt"] = stated["instruction"]
    request[stated["reset"]] = np.bool_(step == 0)
    answer = policy.infer(request)
    chunks.append(answer["actions"].tolist())
    assert answer["server_timing"]["infer_ms"] > 0
try:
    policy.infer({"joints": np.zeros(99, np.float32)})
except RuntimeError as error:
    refused = str(error)
with open(posted) as file:  # as dxb asks OpenVLA's server
    image = json_numpy.loads(file.read())["image"]
said = {
    "chunks": chunks,
    "refused": refused,
    "numpy": np.__version__,
    "image": [image.tolist(), str(image.dtype)],
    "reply": json_numpy.dumps(np.array([0.1, -0.2, 0.3])),
}
print(json.dumps(said))
