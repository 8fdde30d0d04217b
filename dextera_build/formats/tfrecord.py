"""TFRecord files of `tf.train.Example` messages, written without TensorFlow.

A record is its length (uint64), the masked CRC-32C of these eight bytes, the message, and its masked CRC-32C, all
little-endian. The messages are those of TensorFlow's `example.proto` and `feature.proto`.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any, BinaryIO

import numpy as np

_MASK = 0xA282EAD8
Value = np.ndarray | Sequence[bytes]
"""Numbers of any shape, or texts and files."""


def example(features: Mapping[str, Value]) -> bytes:
    """A serialised `tf.train.Example` with deterministic bytes.

    Args:
        features: Name -> bytes, or numbers, which are flattened: floating-point ones become `float_list`, integers and
            truth values `int64_list`.
    """
    message = _example()()
    for name, value in features.items():
        feature = message.features.feature[name]
        if not isinstance(value, np.ndarray):
            feature.bytes_list.value.extend(value)
        elif value.dtype.kind == "f":
            feature.float_list.value.extend(value.ravel().astype(np.float32).tolist())
        else:
            feature.int64_list.value.extend(value.ravel().astype(np.int64).tolist())
    return bytes(message.SerializeToString(deterministic=True))


def append(file: BinaryIO, message: bytes) -> None:
    """Write one record."""
    length = struct.pack("<Q", len(message))
    for part in (length, message):
        file.write(part)
        file.write(struct.pack("<I", _masked_crc(part)))


def _masked_crc(data: bytes) -> int:
    import google_crc32c

    crc = int(google_crc32c.value(data))
    return (((crc >> 15) | (crc << 17)) + _MASK) & 0xFFFFFFFF


@cache
def _example() -> Any:
    """The class of `tf.train.Example`, from a description in a pool of its own."""
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

    kinds = descriptor_pb2.FieldDescriptorProto
    file = descriptor_pb2.FileDescriptorProto(name="example.proto", package="tensorflow", syntax="proto3")

    def field(message: Any, name: str, number: int, kind: int, *, of: str = "", many: bool = False) -> Any:
        label = kinds.LABEL_REPEATED if many else kinds.LABEL_OPTIONAL
        type_name = f".tensorflow.{of}" if of else None
        return message.field.add(name=name, number=number, type=kind, label=label, type_name=type_name)

    lists = (("BytesList", kinds.TYPE_BYTES), ("FloatList", kinds.TYPE_FLOAT), ("Int64List", kinds.TYPE_INT64))
    for name, kind in lists:
        field(file.message_type.add(name=name), "value", 1, kind, many=True)
    feature = file.message_type.add(name="Feature")
    feature.oneof_decl.add(name="kind")
    for number, (name, _) in enumerate(lists, 1):
        spelled = name.removesuffix("List").lower() + "_list"
        field(feature, spelled, number, kinds.TYPE_MESSAGE, of=name).oneof_index = 0
    features = file.message_type.add(name="Features")
    entry = features.nested_type.add(name="FeatureEntry")
    entry.options.map_entry = True
    field(entry, "key", 1, kinds.TYPE_STRING)
    field(entry, "value", 2, kinds.TYPE_MESSAGE, of="Feature")
    field(features, "feature", 1, kinds.TYPE_MESSAGE, of="Features.FeatureEntry", many=True)
    field(file.message_type.add(name="Example"), "features", 1, kinds.TYPE_MESSAGE, of="Features")
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName("tensorflow.Example"))
