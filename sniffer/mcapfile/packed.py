"""The chunks of an MCAP file: their heads, and what they unpack to, which is bounded."""

from __future__ import annotations

import struct
from typing import Final

import zstandard

UNPACKED: Final = 1 << 26
"""The same for what a chunk unpacks to, and for what is unpacked of a torn one: this tool writes
1 MiB at a time, others a few."""

_CHUNK: Final = struct.Struct("<QQQII")


class BrokenError(Exception):
    """The file makes no sense from here on; ``str`` says why."""


def chunk_head(body: bytes) -> tuple[int, int, str, int, bytes]:
    """Return a chunk's size, checksum, compression, length when packed, and what is packed.

    Raises:
        BrokenError: that makes no sense.
    """
    try:
        _, _, size, crc, named = _CHUNK.unpack_from(body)
        at = _CHUNK.size + named
        compression = body[_CHUNK.size : at].decode()
        (length,) = struct.unpack_from("<Q", body, at)
    except (struct.error, UnicodeDecodeError):
        raise BrokenError("the head of a chunk makes no sense") from None
    return size, crc, compression, length, body[at + 8 :]


def unpack(compression: str, packed: bytes, size: int) -> bytes:
    """Return what a chunk holds.

    Raises:
        BrokenError: it cannot be unpacked, or it says that it holds too much.
    """
    if size > UNPACKED:
        raise BrokenError(f"a chunk claims to have {size} bytes")
    if not compression:
        return packed
    try:
        if compression == "zstd":
            stated = zstandard.get_frame_parameters(packed).content_size
            if stated not in (size, zstandard.CONTENTSIZE_UNKNOWN):
                raise BrokenError("a chunk is not as long as it says")
            return zstandard.ZstdDecompressor().decompress(packed, max_output_size=size)
        if compression == "lz4":
            import lz4.frame  # type: ignore[import-untyped] # only other tools write it

            data: bytes = lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=size)
            return data
    except ImportError:
        raise BrokenError("a chunk is packed with lz4: `pip install lz4`") from None
    except (zstandard.ZstdError, RuntimeError, EOFError):
        raise BrokenError("a chunk cannot be unpacked") from None
    raise BrokenError(f"a chunk is packed with {compression[:20]!a}, which is not known here")


def begin_of(packed: bytes, size: int) -> bytes:
    """Return what the beginning of a packed chunk holds, at most ``size`` bytes.

    Raises:
        zstandard.ZstdError: it is damaged.
    """
    parts: list[bytes] = []
    left = size
    with zstandard.ZstdDecompressor().stream_reader(packed) as stream:
        while left and (part := stream.read(min(left, 1 << 16))):
            parts.append(part)
            left -= len(part)
    return b"".join(parts)
