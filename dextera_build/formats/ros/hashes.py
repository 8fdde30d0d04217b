"""Hashes of the types of ROS 2 messages (REP 2011), and messages from their CDR bytes, by definitions in `types`."""

from __future__ import annotations

from functools import cache
from typing import Any

from dextera_build.errors import MachineError, install_extra
from dextera_build.formats.ros.types import DEFINITIONS, full_name


@cache
def store() -> Any:
    """The `rosbags.typesys.store.Typestore` of the types that dxb writes and reads.

    Raises:
        MachineError: rosbags is not installed.
    """
    try:
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError:
        raise MachineError(
            "messages of ROS 2 need rosbags, which is not installed", code="DXB-E440", hint=install_extra("ros")
        ) from None
    made = get_typestore(Stores.EMPTY)
    for kind, text in DEFINITIONS.items():
        found = get_types_from_msg(text, full_name(kind))
        made.register({name: fields for name, fields in found.items() if name not in made.fielddefs})
    return made


def type_hash(kind: str) -> str:
    """`sensor_msgs/JointState` -> `RIHS01_a13ee3a3...`, as ROS 2 computes it from the type's description."""
    return str(store().hash_rihs01(full_name(kind)))


def read(kind: str, message: bytes) -> Any:
    """The fields of a message from its CDR bytes; sequences of numbers are arrays.

    Raises:
        ValueError: The bytes are no such message.
    """
    found = store()
    from rosbags.serde.errors import SerdeError

    try:
        return found.deserialize_cdr(message, full_name(kind))
    except (SerdeError, ValueError, IndexError) as error:
        raise ValueError(f"{len(message)} bytes are no {kind}: {error}") from None
