"""Types of ROS 2 messages for cyclonedds-python, made from the definitions of `formats.ros.types`.

cyclonedds-python packs and unpacks messages value by value, which takes long for the bytes of a picture. The types here
only describe a message to other programs: its bytes are passed as they are.
"""

from __future__ import annotations

from functools import cache
from typing import Any

from dextera_build.formats.ros import hashes
from dextera_build.formats.ros.types import full_name


@cache
def packed(kind: str) -> Any:
    """The type of a topic, whose values hold a message's CDR bytes in `cdr`."""
    made = _struct(full_name(kind))
    made.serialize = _serialize
    made.deserialize = classmethod(_deserialize)
    return made


def value(kind: str, message: bytes) -> Any:
    """A value of `packed(kind)`."""
    made = packed(kind)
    found = made.__new__(made)
    found.cdr = message
    return found


def dds_name(kind: str) -> str:
    """`sensor_msgs/JointState` -> `sensor_msgs::msg::dds_::JointState_`."""
    package, _, name = kind.partition("/")
    return f"{package}::msg::dds_::{name}_"


def ros_name(name: str) -> str:
    """The reverse of `dds_name`; other names stay."""
    package, middle, kind = name.partition("::msg::dds_::")
    return f"{package}/{kind.removesuffix('_')}" if middle and kind.endswith("_") else name


def _serialize(self: Any, *_: Any, **__: Any) -> bytes:
    data: bytes = self.cdr
    return data


def _deserialize(cls: Any, data: bytes, *_: Any, **__: Any) -> Any:
    found = cls.__new__(cls)
    found.cdr = bytes(data)
    return found


@cache
def _struct(name: str) -> Any:
    """The structure `sensor_msgs/msg/JointState`, with the structures of its fields."""
    from cyclonedds.idl import make_idl_struct
    from cyclonedds.idl.annotations import final

    package, _, kind = name.split("/")
    fields = {field: _field(*described) for field, described in hashes.store().fielddefs[name][1]}
    # ROS 2 declares all types final; a peer with another extensibility would not match.
    return final(make_idl_struct(f"{kind}_", f"{package}.msg.dds_.{kind}_", fields))


def _field(node: Any, described: Any) -> Any:
    """The type of a field, from what rosbags knows of it."""
    from cyclonedds.idl import types
    from rosbags.interfaces import Nodetype

    if node == Nodetype.NAME:
        return _struct(described)
    if node == Nodetype.BASE:
        base = {"string": str, "bool": bool}
        return base.get(described[0]) or getattr(types, described[0])
    inner = _field(*described[0])
    return types.array[inner, described[1]] if node == Nodetype.ARRAY else types.sequence[inner]
