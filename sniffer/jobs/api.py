"""``sniffer.decode(path_or_bytes)``: a whole capture as batches, rows, or data frames."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from sniffer.anomalies.alarms import alarm_in
from sniffer.decoding.pipeline import AUTO, Options, Pipeline
from sniffer.decoding.rows import Row, rows, rows_of
from sniffer.ground.limits import BAUDS, whole
from sniffer.ground.model import Batch, Chunk, DamagedInputError
from sniffer.ground.needs import need_pyarrow
from sniffer.ground.registers import RegisterMap
from sniffer.ground.wiring import Wiring
from sniffer.jobs.order import merged
from sniffer.jobs.telling import Teller
from sniffer.sources import open_source

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence
    from pathlib import Path

    from sniffer.decoding.sink import Part
    from sniffer.decoding.summary import Summary
    from sniffer.protocols.base import BusProtocol


class _Keep:
    """A sink that keeps the batches, pass by pass."""

    def __init__(self) -> None:
        self.passes: list[tuple[str, Sequence[Part]]] = []

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take nothing."""

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Keep a batch."""
        self.passes.append((bus, [(protocol, batch)]))

    def write_together(self, bus: str, parts: Sequence[Part]) -> None:
        """Keep the batches of several protocols."""
        self.passes.append((bus, parts))

    def close(self) -> None:
        """Do nothing."""


class Capture:
    """A decoded capture in memory; iterate it for rows in wire order.

    ``batches`` are (bus, protocol, batch), two of the same bytes where two protocols share a wire.
    ``damage`` says what broke the input off, None where it was read to its end.
    """

    def __init__(
        self,
        passes: Sequence[tuple[str, Sequence[Part]]],
        summary: Summary,
        damage: str | None = None,
    ) -> None:
        self.batches = [(bus, *part) for bus, parts in passes for part in parts]
        self.summary = summary
        self.damage = damage
        self._passes = passes

    def __iter__(self) -> Iterator[Row]:
        for bus, parts in self._passes:
            yield from rows_of(parts, bus)

    def samples(self) -> Any:
        """Return all samples as an arrow table (``.to_pandas()`` makes a data frame)."""
        need_pyarrow()
        from sniffer.sinks import tables

        return self._table(tables.samples_table, tables.SAMPLES)

    def frames(self) -> Any:
        """Return all frames as an arrow table."""
        need_pyarrow()
        from sniffer.sinks import tables

        return self._table(tables.frames_table, tables.FRAMES)

    def _table(self, build: Any, schema: Any) -> Any:
        import pyarrow as pa

        parts = [build(bus, protocol, batch) for bus, protocol, batch in self.batches]
        return pa.concat_tables(parts).unify_dictionaries() if parts else schema.empty_table()


def records(batch: Batch, protocol: BusProtocol, bus: str = "bus0") -> Iterator[Row]:
    """Yield a batch's records one by one, in wire order."""
    return rows(batch, protocol, bus)


def samples_table(batch: Batch, protocol: BusProtocol, bus: str = "bus0") -> Any:
    """Return a batch's samples as an arrow table."""
    need_pyarrow()
    from sniffer.sinks import tables

    return tables.samples_table(bus, protocol, batch)


def frames_table(batch: Batch, protocol: BusProtocol, bus: str = "bus0") -> Any:
    """Return a batch's frames as an arrow table."""
    need_pyarrow()
    from sniffer.sinks import tables

    return tables.frames_table(bus, protocol, batch)


def decode(
    source: str | Path | bytes | bytearray | memoryview,
    protocol: str | BusProtocol = AUTO,
    *,
    input_format: str = "auto",
    baud: int | None = None,
    models: Mapping[int | None, str] | None = None,
    latency_ns: int | None = None,
    registers: Iterable[str | Path | RegisterMap] = (),
    alarms: str | Iterable[str] = (),
    channels: Mapping[str, str] | None = None,
    invert: bool = False,
    glitch_us: float | None = None,
) -> Capture:
    """Decode a file (or the bytes of one) as a whole.

    Args:
        source: a path, ``"-"`` for standard input, or the content of a file.
        protocol: a name of ``PROTOCOLS``, a file that defines one (``*.py``), the protocol itself,
            two of them that share a wire (``"mightyzap+rs30x"``),
            or ``"auto"``.
        input_format: ``"auto"`` or a name of ``sniffer.sources.SOURCES``.
        baud: bits per second; the protocol's default where None.
        models: servo id (None: all) -> model name.
        latency_ns: how long the adapter may have held bytes back.
        registers: register tables of further models, each a TOML file or what one was read into.
        alarms: rules of your own, such as ``"temperature > 70 for 2s"``.
        channels: which channels of a logic capture are read, each with the bus that it is a wire
            of, or "" for one of its own; those with serial bytes where None.
        invert: the lines of a logic capture idle low.
        glitch_us: pulses of a logic capture that are shorter do not count; those of less than a
            third of a bit where None.

    Raises:
        InputError: the input cannot be read, its protocol cannot be told, or a rule is none.
        SnifferError: unknown protocol or model, or a number that cannot be.
    """
    if baud is not None:
        baud = whole("baud", baud, *BAUDS)
    keep = _Keep()
    wiring = Wiring(channels or {}, invert, glitch_us, baud)
    given = open_source(source, input_format, wiring=wiring)
    tables = tuple(t if isinstance(t, RegisterMap) else RegisterMap.from_toml(t) for t in registers)
    options = Options(
        protocol=protocol,
        baud=baud,
        models=models or {},
        latency_ns=latency_ns,
        tables=tables,
        alarms=tuple(map(alarm_in, [alarms] if isinstance(alarms, str) else alarms)),
    ).with_facts(given.facts(), given.tables)
    pipeline = Pipeline(options, [keep])
    damage = None
    quiet = Teller(lambda line: None, quiet=True)
    try:
        for group in merged(given, given, options, quiet):
            pipeline.feed(group)
    except DamagedInputError as error:
        damage = str(error)
    pipeline.close()
    return Capture(keep.passes, pipeline.summary, damage)
