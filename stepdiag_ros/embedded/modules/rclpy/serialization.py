"""Messages to CDR bytes and back."""

from __future__ import annotations

from typing import Any

from stepdiag_ros.embedded import registry


def serialize_message(message: Any) -> bytes:
    """Return a message as CDR bytes, with the encapsulation header.

    Raises:
        TypeError: It is not a message.
    """
    cls: Any = type(message)
    return registry.serializer(cls)(message)


def deserialize_message(serialized_message: bytes, message_type: type) -> Any:
    """Return the message of CDR bytes.

    Raises:
        ValueError: The bytes are not a message of this type.
        TypeError: The type is not a message class.
    """
    return registry.deserializer(message_type)(bytes(serialized_message))
