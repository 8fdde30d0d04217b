"""Runs under the interpreter that has BuildGrid: reads messages with the protobuf runtime, and writes them again.

One JSON document a line, in and out: `{"name", "hex"}` -> `{"fields", "hex"}`, or `{"error"}` for what is no message.
"""

from __future__ import annotations

import json
import sys

from buildgrid._protos.build.bazel.remote.execution.v2 import remote_execution_pb2
from buildgrid._protos.build.bazel.semver import semver_pb2
from buildgrid._protos.google.bytestream import bytestream_pb2
from buildgrid._protos.google.rpc import status_pb2
from google.protobuf.message import DecodeError


def find(name):
    """The generated class of a message, `Outer.Inner` for one inside another."""
    outer, *inner = name.split(".")
    modules = (remote_execution_pb2, bytestream_pb2, semver_pb2, status_pb2)
    found = next(getattr(module, outer) for module in modules if hasattr(module, outer))
    for part in inner:
        found = getattr(found, part)
    return found


def plain(message):
    """Field number -> value, without those that hold nothing."""
    found = {str(field.number): value(getattr(message, field.name), field) for field in message.DESCRIPTOR.fields}
    return {number: body for number, body in found.items() if body}


def value(body, field):
    """A field's value as JSON."""
    many = field.is_repeated if hasattr(field, "is_repeated") else field.label == field.LABEL_REPEATED
    return [one(each) for each in body] if many else one(body)


def one(body):
    """One value as JSON."""
    if isinstance(body, bytes):
        return body.hex()
    return plain(body) if hasattr(body, "DESCRIPTOR") else body


for line in sys.stdin:
    asked = json.loads(line)
    try:
        message = find(asked["name"]).FromString(bytes.fromhex(asked["hex"]))
        answer = {"fields": plain(message), "hex": message.SerializeToString(deterministic=True).hex()}
    except DecodeError as error:
        answer = {"error": str(error)}
    print(json.dumps(answer), flush=True)
