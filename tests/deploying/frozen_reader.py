"""A controller behind a small buffer; it prints when it received which number, `when:number`, separated by spaces."""

from __future__ import annotations

import os
import sys
import time

from dextera_build.deploying import dds
from dextera_build.deploying.transport import Topic
from dextera_build.formats.ros import hashes

BUFFER = "<Internal><SocketReceiveBufferSize min='default' max='4kB'/></Internal>"
"""What the network cannot deliver is lost, as in a gap."""

if __name__ == "__main__":
    os.environ["CYCLONEDDS_URI"] = dds.config(()).replace("</Domain>", f"{BUFFER}</Domain>")
    transport, got = dds.Dds(domain=int(sys.argv[1])), list[str]()
    topic = Topic("/numbers", "std_msgs/Float64MultiArray")
    transport.subscribe(topic, lambda message, at: got.append(f"{at}:{hashes.read(topic.kind, message).data[0]:g}"))
    print("ready", flush=True)
    time.sleep(float(sys.argv[2]))
    print(*got)
    transport.close()
