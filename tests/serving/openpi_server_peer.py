"""Runs in an environment with openpi-client: answers as openpi's own server does, with the messages of its client.

Prints its address, then a line of JSON for each question: name -> type and shape of what was asked.
"""

import json
import time
import traceback

import numpy as np
from openpi_client import msgpack_numpy
from websockets.exceptions import ConnectionClosed
from websockets.sync.server import serve


def answer(connection):
    """Metadata, then ten times the state for each observation; a traceback as text for one without a state."""
    packer = msgpack_numpy.Packer()
    connection.send(packer.pack({"reset_pose": [0.0]}))
    try:
        while True:
            seen = msgpack_numpy.unpackb(connection.recv())
            told = {key: [str(np.asarray(part).dtype), *np.shape(part)] for key, part in seen.items()}
            print(json.dumps(told), flush=True)
            try:
                actions = np.outer(np.arange(1, 4, dtype=np.float32), seen["observation/state"])
            except KeyError:
                connection.send(traceback.format_exc())
                break
            timing = {"infer_ms": np.float64(0.5), "prev_total_ms": 1000 * time.monotonic()}
            connection.send(packer.pack({"actions": actions, "server_timing": timing}))
    except ConnectionClosed:
        pass


with serve(answer, "127.0.0.1", 0, compression=None, max_size=None) as server:
    print(f"ws://127.0.0.1:{server.socket.getsockname()[1]}", flush=True)
    server.serve_forever()
