"""Types of messages, as a file declares them."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, cast

from google.protobuf.descriptor_pb2 import FileDescriptorSet

if TYPE_CHECKING:
    from google.protobuf.descriptor import FileDescriptor
    from google.protobuf.message import Message


class MessageType(NamedTuple):
    """A type of messages: its name, how they and their definition are encoded, the definition."""

    name: str
    encoding: str
    schema_encoding: str
    definition: bytes


def type_of(message: type[Message]) -> MessageType:
    """Return a protobuf message as a file declares it."""
    definition = _descriptors(cast("FileDescriptor", message.DESCRIPTOR.file))
    return MessageType(message.DESCRIPTOR.full_name, "protobuf", "protobuf", definition)


def _descriptors(file: FileDescriptor) -> bytes:
    """Return the file's descriptor set, the files it imports before it."""
    out = FileDescriptorSet()
    seen: set[str] = set()

    def add(one: FileDescriptor) -> None:
        if one.name not in seen:
            seen.add(one.name)
            for imported in one.dependencies:
                add(imported)
            one.CopyToProto(out.file.add())

    add(file)
    return out.SerializeToString()
