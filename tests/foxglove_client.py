"""A client of Foxglove's, by hand: the handshake of a web socket, and subprotocol foxglove.sdk.v1.

Source: RFC 6455, and https://github.com/foxglove/ws-protocol (docs/spec.md), whose messages the SDK
speaks: texts are JSON with an ``op``; binary ones are data, opcode 1.
"""

from __future__ import annotations

import base64
import contextlib
import json
import os
import socket
import struct
from collections import defaultdict
from typing import TYPE_CHECKING, Any, Final

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

if TYPE_CHECKING:
    from collections.abc import Iterator

PROTOCOL: Final = "foxglove.sdk.v1"
_TEXT, _BINARY, _PING, _PONG = 1, 2, 9, 10
_DATA: Final = 1


class FoxgloveClient:
    """Subscribes to every topic that is announced, and keeps what comes. Use it with ``with``."""

    def __init__(self, port: int) -> None:
        self.topics: dict[str, dict[str, Any]] = {}
        self.got: dict[str, list[tuple[int, Any]]] = defaultdict(list)
        """Log times and messages by topic, parsed by the schemas that were announced."""
        self._by_subscription: dict[int, str] = {}
        self._types: dict[str, Any] = {}
        self._buffer = b""
        self._socket = socket.create_connection(("127.0.0.1", port), timeout=30)
        key = base64.b64encode(os.urandom(16)).decode()
        self._socket.sendall(
            f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\n"
            f"Connection: Upgrade\r\nSec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n"
            f"Sec-WebSocket-Protocol: {PROTOCOL}\r\n\r\n".encode()
        )
        while b"\r\n\r\n" not in self._buffer:
            self._fill()
        head, self._buffer = self._buffer.split(b"\r\n\r\n", 1)
        assert head.startswith(b"HTTP/1.1 101"), head
        assert PROTOCOL.encode() in head
        self._socket.settimeout(0.1)

    def __enter__(self) -> FoxgloveClient:
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()

    def look(self) -> None:
        """Take what has come; waits a tenth of a second where there is nothing."""
        with contextlib.suppress(TimeoutError):  # what came before has not been looked at
            self._fill()
        for opcode, data in self._frames():
            if opcode == _TEXT:
                self._told(json.loads(data))
            elif opcode == _BINARY and data[0] == _DATA:
                subscription, log_time = struct.unpack_from("<IQ", data, 1)
                topic = self._by_subscription[subscription]
                self.got[topic].append((log_time, self._types[topic].FromString(data[13:])))
            elif opcode == _PING:
                self._send(_PONG, data)

    def _told(self, message: dict[str, Any]) -> None:
        if message["op"] != "advertise":
            return
        wanted = []
        for channel in message["channels"]:
            topic, number = channel["topic"], len(self._by_subscription) + 1
            self.topics[topic] = channel
            self._types[topic] = _parsed(channel)
            self._by_subscription[number] = topic
            wanted.append({"id": number, "channelId": channel["id"]})
        self._send(_TEXT, json.dumps({"op": "subscribe", "subscriptions": wanted}).encode())

    def _fill(self) -> None:
        data = self._socket.recv(1 << 16)
        if not data:
            raise ConnectionResetError
        self._buffer += data

    def _frames(self) -> Iterator[tuple[int, bytes]]:
        """Yield the frames that are complete; a server does not mask, and need not split."""
        while len(self._buffer) >= 2:
            size, at = self._buffer[1], 2
            if size >= 126:
                at = 4 if size == 126 else 10
                if len(self._buffer) < at:
                    return
                size = int.from_bytes(self._buffer[2:at])
            if len(self._buffer) < at + size:
                return
            head, data = self._buffer[0], self._buffer[at : at + size]
            assert head & 0x80, "a message in pieces"
            self._buffer = self._buffer[at + size :]
            yield head & 15, data

    def _send(self, opcode: int, data: bytes) -> None:
        mask = os.urandom(4)
        n = len(data)
        size = bytes([0x80 | n]) if n < 126 else b"\xfe" + struct.pack(">H", n)
        masked = bytes(b ^ mask[i % 4] for i, b in enumerate(data))
        self._socket.sendall(bytes([0x80 | opcode]) + size + mask + masked)


def _parsed(channel: dict[str, Any]) -> Any:
    """Return the message class that a channel announces."""
    assert (channel["encoding"], channel["schemaEncoding"]) == ("protobuf", "protobuf")
    pool = descriptor_pool.DescriptorPool()
    files = descriptor_pb2.FileDescriptorSet.FromString(base64.b64decode(channel["schema"]))
    for file in files.file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(channel["schemaName"]))
