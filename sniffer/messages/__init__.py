"""What recordings hold: the messages, generated from ``schemas/messages`` by ``make schemas``.

And the names by which a recording is known as one of this tool's, for those who write and read it.
"""

from __future__ import annotations

from typing import Final

MAGIC: Final = b"\x89MCAP0\r\n"
"""How a recording begins and ends: the MCAP specification."""

TOOL: Final = "servo-sniffer"
"""What the header's library begins with."""

SESSION: Final = "servo_sniffer.session"
"""Metadata record: facts of the whole recording."""

BUS: Final = "servo_sniffer.bus"
"""Metadata records ``<BUS>.<bus>``: what one bus speaks."""

OFFSET: Final = "offset"
"""Facts ``<OFFSET>.<bus>`` of a session: where in the stream a file begins that goes on with it."""

CUT: Final = "cut"
"""Facts of a part of a capture: ``cut.source`` (of what), ``cut.from_ns`` and ``cut.to_ns`` (what
was asked for), ``cut.offset.<bus>`` (where its first byte stood there)."""

ANCHOR: Final = ("clock_wall_ns", "clock_monotonic_ns")
"""Facts of a session: two clocks when the recorder began, which all of its files have."""

END: Final = "servo_sniffer.end"
"""Metadata record behind all messages of a file that another one goes on with: ``<OFFSET>.<bus>``
is where it ends, ``<TIME>.<bus>`` when the byte before that was on the wire, where that lies within
a chunk. What stands in the file from there on belongs to the next one, which has it, too."""

TIME: Final = "t_ns"

TABLES: Final = "registers/"
"""What the names of the register tables begin with that are attached: ``<TABLES><model>.toml``."""

TRIGGER: Final = "servo_sniffer.trigger"
"""Metadata records of a flight recorder's file: what has happened, one for each time."""

RECOVERED: Final = "servo_sniffer.recovered"
"""Metadata record: the recorder did not finish the file; ``why`` says what was wrong with it."""

MARKS: Final = "servo_sniffer.marks"
"""Metadata record behind all messages: places that somebody marked, each as JSON (``t_ns``,
``bus``, ``offset`` from the first byte of the bus in this file, ``note``). Of several the last one
holds."""

BULK: Final = ("frames", "transactions")
"""Topics of which a live recording indexes next to nothing: nobody plots them, and with ``raw``, of
which the same is true, the index would be thrice the raw bytes of a busy bus and more."""

INCIDENTS: Final = "incidents"
"""The topic ``/incidents``, which is of all buses."""

SHOWN: Final = ("state", "gaps", "anomalies", "log", "stats", INCIDENTS)
"""Topics that viewers look up message by message."""

TOPICS: Final = ("raw", *BULK, *SHOWN)
"""All topics that a recording has where nobody chooses, by the last part of their names."""

FLAT: Final = "flat"
"""Topics ``servo/<id>/<quantity>_<unit>``, one for each value alone; only where asked for."""

PLOTS: Final = "plots"
"""Topics ``plots/servo_<id>_position_<unit>``: where a servo says it is, in a message of ROS 2 that
Rerun draws unasked; only where asked for. Of all that it could draw it chooses eight by chance, so
there is nothing else to choose from."""

CHOICES: Final = (*TOPICS, FLAT, PLOTS)
"""What may be chosen."""
