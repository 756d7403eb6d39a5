"""Object stores: found by a URI, and written so that an object is there whole or not at all."""

from __future__ import annotations

import contextlib
import os
import uuid
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import pyarrow as pa
import pyarrow.fs as pafs

if TYPE_CHECKING:
    from pathlib import Path

AT_ONCE: Final = 10 << 20
"""Bytes that arrow sends to S3 in one request; of more it makes a multipart upload of several."""

CONNECTS_S: Final = 10
"""How long S3 may take to be reached; the client of Amazon gives up after one second."""

ANSWERS_S: Final = 60
"""How long S3 may be silent; the client of Amazon gives up after three seconds."""


class ObjectPlace(NamedTuple):
    """A file system of arrow, a path in it, and how many bytes it sends in one request."""

    system: Any
    path: str
    at_once: int


def find_objects(uri: str) -> ObjectPlace:
    """Return where ``s3://bucket/key``, ``gs://bucket/key`` and the like are.

    What stands behind the bucket is the key as it is: captures have blanks, ``%`` and ``?`` in
    their names, which stand for something else in a URI. ``AWS_ENDPOINT_URL``
    (``AWS_ENDPOINT_URL_S3`` comes first) says where S3 is, if not at Amazon's.

    Raises:
        pyarrow.ArrowInvalid: nobody knows such a URI.
        OSError: the bucket cannot be found.
    """
    scheme, _, rest = uri.partition("://")
    bucket, _, key = rest.partition("/")
    if not bucket:  # file:///...
        system, path = pafs.FileSystem.from_uri(uri)
        return ObjectPlace(system, path.rstrip("/"), 0)
    system, base = pafs.FileSystem.from_uri(f"{scheme}://{bucket}")
    path = f"{base.rstrip('/')}/{key}".rstrip("/")
    if scheme == "s3":
        with contextlib.suppress(TypeError):  # pyarrow before 21, which always sends parts
            endpoint = os.environ.get("AWS_ENDPOINT_URL_S3") or os.environ.get("AWS_ENDPOINT_URL")
            system = pafs.S3FileSystem(
                region=system.region or None,
                endpoint_override=endpoint,
                connect_timeout=CONNECTS_S,
                request_timeout=ANSWERS_S,
                allow_delayed_open=True,
                background_writes=False,
            )
            return ObjectPlace(system, path, AT_ONCE)
    return ObjectPlace(system, path, 0)


def send_object(place: ObjectPlace, file: Path) -> None:
    """Let an object with what a finished file holds appear.

    An output stream of arrow makes an object of whatever it was given when it is let go of, also
    after an error: of a multipart upload whose first part was refused it makes an empty one. So
    what takes several requests is sent to a name of its own, and copied to its place within the
    store when it is whole.

    Raises:
        OSError: the store refuses it; at the place is what was there.
    """
    if file.stat().st_size <= place.at_once:
        _stream(place.system, place.path, file)
        return
    folder, _, name = place.path.rpartition("/")
    beside = f"{folder}/_{uuid.uuid4().hex}-{name}"  # readers of tables pass over such names
    try:
        _stream(place.system, beside, file)
        place.system.copy_file(beside, place.path)
    finally:
        with contextlib.suppress(OSError):  # it was never there, or the store is gone
            place.system.delete_file(beside)


def _stream(system: Any, path: str, file: Path) -> None:
    """Send a file with one call, between which and the end of the stream nothing can come."""
    with pa.memory_map(str(file)) as source, system.open_output_stream(path) as stream:
        stream.write(source.read_buffer())
