"""Messages of ROS 2 as bytes: CDR, written without ROS.

Little-endian XCDR version 1, as ROS 2 stores it: each number stands at a multiple of its size,
counted from behind the head. Definitions as their packages have them (common_interfaces, humble to
rolling), without comments; those that are used stand below the one that uses them.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Final, NamedTuple

from sniffer.ground.model import NS, OutputError
from sniffer.ground.wording import Sentence
from sniffer.mcapfile.kinds import MessageType

if TYPE_CHECKING:
    from collections.abc import Sequence

_HEAD: Final = b"\x00\x01\x00\x00"
"""Of each message: CDR, little-endian; no options."""

SECONDS_END: Final = 1 << 31
"""Stamps end before this second of Unix time: builtin_interfaces/Time has 32 bits, one a sign."""

_LINE: Final = "=" * 80
_HEADER: Final = f"""{_LINE}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{_LINE}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""

JOINT_STATE: Final = MessageType(
    "sensor_msgs/msg/JointState",
    "cdr",
    "ros2msg",
    f"""std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
{_HEADER}""".encode(),
)

NUMBERS: Final = MessageType(
    "std_msgs/msg/Float64MultiArray",
    "cdr",
    "ros2msg",
    f"""std_msgs/MultiArrayLayout layout
float64[] data
{_LINE}
MSG: std_msgs/MultiArrayLayout
std_msgs/MultiArrayDimension[] dim
uint32 data_offset
{_LINE}
MSG: std_msgs/MultiArrayDimension
string label
uint32 size
uint32 stride
""".encode(),
)

ONE_NUMBER: Final = _HEAD + struct.pack("<III4x", 0, 0, 1)
"""What stands before the number in an array of one: no dimensions, no offset, the count."""

DIAGNOSTICS: Final = MessageType(
    "diagnostic_msgs/msg/DiagnosticArray",
    "cdr",
    "ros2msg",
    f"""std_msgs/Header header
diagnostic_msgs/DiagnosticStatus[] status
{_HEADER}{_LINE}
MSG: diagnostic_msgs/DiagnosticStatus
byte OK=0
byte WARN=1
byte ERROR=2
byte STALE=3
byte level
string name
string message
string hardware_id
diagnostic_msgs/KeyValue[] values
{_LINE}
MSG: diagnostic_msgs/KeyValue
string key
string value
""".encode(),
)


class DiagnosticStatus(NamedTuple):
    """A status of a DiagnosticArray; ``level`` is 0 ok, 1 warning, 2 error."""

    level: int
    name: str
    message: str
    hardware: str
    values: Sequence[tuple[str, str]]


class _Cdr:
    """One message as it grows."""

    def __init__(self, t_ns: int) -> None:
        """Begin with a header: its stamp, and no frame.

        Raises:
            OutputError: there is no stamp of that time.
        """
        seconds, rest = divmod(t_ns, NS)
        if seconds >= SECONDS_END:
            told = "messages of ROS 2 have no times after January 2038: leave out {ros2}"
            raise OutputError(Sentence(told))
        self.data = bytearray(_HEAD)
        self.data += struct.pack("<iI", seconds, rest)
        self.text("")

    def align(self, size: int) -> None:
        """Fill up to where a number of that size may stand."""
        self.data += bytes((len(_HEAD) - len(self.data)) % size)

    def count(self, n: int) -> None:
        """Write how many of something follow."""
        self.align(4)
        self.data += struct.pack("<I", n)

    def text(self, text: str) -> None:
        """Write a text; its length counts the zero at its end."""
        data = text.encode() + b"\0"
        self.count(len(data))
        self.data += data

    def doubles(self, values: Sequence[float]) -> None:
        """Write a list of numbers."""
        self.count(len(values))
        if values:
            self.align(8)
            self.data += struct.pack(f"<{len(values)}d", *values)


def joint_state(t_ns: int, name: str, position: float, velocity: float | None) -> bytes:
    """Return a JointState of one joint: ``position`` in rad or m, ``velocity`` in rad/s or m/s."""
    out = _Cdr(t_ns)
    out.count(1)
    out.text(name)
    out.doubles([position])
    out.doubles([] if velocity is None else [velocity])
    out.doubles([])
    return bytes(out.data)


def diagnostics(t_ns: int, found: DiagnosticStatus) -> bytes:
    """Return a DiagnosticArray of one status."""
    out = _Cdr(t_ns)
    out.count(1)
    out.data.append(found.level)
    for text in (found.name, found.message, found.hardware):
        out.text(text)
    out.count(len(found.values))
    for key, value in found.values:
        out.text(key)
        out.text(value)
    return bytes(out.data)
