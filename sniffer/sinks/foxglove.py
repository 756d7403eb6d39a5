"""What was decoded, served to Foxglove while it is heard: the messages of a recording, live.

Topics and messages are those of ``sniffer.mcapfile``, all but the raw bytes, encoded once for all
who look on. ``log_time`` is when bytes were on the wire, by the best estimate; so each frame has
its own, and states come frame by frame.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from sniffer import __version__
from sniffer.decoding.called import ServoNames
from sniffer.ground.model import NS, OutputError
from sniffer.mcapfile.kinds import MessageType, type_of
from sniffer.mcapfile.levels import LEVELS
from sniffer.mcapfile.messages import DERIVED, BusWriter
from sniffer.mcapfile.queue import Queue
from sniffer.mcapfile.structs import MESSAGE
from sniffer.messages import FLAT, TOOL
from sniffer.messages.log_pb2 import Log

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sniffer.decoding.rates import Rate
    from sniffer.ground.model import Batch, Chunk, Severity
    from sniffer.protocols.base import BusProtocol

FIXED: Final = tuple(topic for topic in DERIVED if topic not in ("state", FLAT))
"""Topics of each bus that are there before anybody can look on. Who subscribes the moment a topic
is announced may be told that there is none (seen once with foxglove-sdk 0.30)."""

INCIDENTS: Final = "/incidents/log"
"""Topic of what becomes of incidents, in words."""


class FoxgloveSink:
    """Serves what is decoded to Foxglove, over a web socket.

    Args:
        buses: whose topics there are from the beginning.
        bauds: their rates, for the statistics.
        host: where it listens.
        port: 0: any that is free.

    Raises:
        OutputError: nobody can listen there.
    """

    def __init__(
        self, buses: Sequence[str], bauds: Mapping[str, int], host: str, port: int
    ) -> None:
        import foxglove

        self._foxglove = foxglove
        self._context = foxglove.Context()
        self._ids: dict[str, int] = {}
        self._channels: list[Any] = []
        self._queue = Queue()
        self._bauds = dict(bauds)
        self._buses: dict[str, BusWriter] = {}
        self._names = ServoNames()
        for bus in buses:
            for topic in FIXED:
                self._open(f"/{bus.strip('/')}/{topic}", DERIVED[topic], {"bus": bus})
        self._open(INCIDENTS, Log, {})
        try:
            self._server = foxglove.start_server(
                name=f"{TOOL} {__version__}", host=host, port=port, context=self._context
            )
        except (RuntimeError, OSError) as error:
            raise OutputError(f"nobody can be served at {host}:{port} ({error})") from None
        self.address = f"ws://{host}:{self._server.port}"

    def call(self, names: ServoNames) -> None:
        """Take what servos are called."""
        self._names = names

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take nothing: what is shown is what was decoded."""

    def tuned(self, bus: str, rate: Rate) -> None:
        """Take the rate that was found for a bus."""
        self._bauds[bus] = rate.baud

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Take what a pass decided."""
        if bus not in self._buses:
            self._buses[bus] = BusWriter(
                *(bus, self._bauds.get(bus), 0, self._queue, self._open),
                live=True,
                names=self._names,
            )
        self._buses[bus].write(protocol, batch)

    def incident(self, bus: str, t_ns: int, severity: Severity, text: str) -> None:
        """Tell what has become of an incident."""
        stamp = {"seconds": t_ns // NS, "nanos": t_ns % NS}
        told = Log(
            timestamp=stamp,
            level=LEVELS[severity],
            message=self._names.sentence(bus, text),
            name=bus,
        )
        self._channels[self._ids[INCIDENTS]].log(told.SerializeToString(), log_time=t_ns)

    def flush(self) -> None:
        """Send what was taken."""
        for writer in self._buses.values():
            writer.encode()
        self._send()

    def close(self) -> None:
        """Send the rest and stop serving."""
        for writer in self._buses.values():
            writer.encode(final=True)
        self._send()
        self._server.stop()

    def _send(self) -> None:
        waiting = self._queue.take(None)
        if waiting is None:
            return
        rows = waiting.sorted(0)
        columns = (c.tolist() for c in (rows.channel, rows.log, rows.start, rows.end))
        for number, log, start, end in zip(*columns, strict=True):
            channel = self._channels[number]
            if channel.has_sinks():
                channel.log(bytes(rows.data[start + MESSAGE.size : end]), log_time=log)

    def _open(
        self, topic: str, message: type[Any] | MessageType, metadata: Mapping[str, str]
    ) -> int:
        """Return the number of a topic, announced where it is new."""
        if topic not in self._ids:
            kind = message if isinstance(message, MessageType) else type_of(message)
            schema = self._foxglove.Schema(
                name=kind.name, encoding=kind.schema_encoding, data=kind.definition
            )
            self._ids[topic] = len(self._channels)
            self._channels.append(
                self._foxglove.Channel(
                    topic,
                    schema=schema,
                    message_encoding=kind.encoding,
                    context=self._context,
                    metadata=dict(metadata),
                )
            )
        return self._ids[topic]
