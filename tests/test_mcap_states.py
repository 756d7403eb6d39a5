"""States of servos in recordings: what came in one read shares a message, and nothing is lost."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from mcap import records
from mcap.records import Message, MessageIndex
from mcap.stream_reader import StreamReader, breakup_chunk

from sniffer.decoding.decoder import Decoder
from sniffer.ground.model import Chunk, Clock
from sniffer.mcapfile.index import as_bytes
from sniffer.mcapfile.reads import ReadValues
from sniffer.mcapfile.sink import McapSink
from sniffer.simulation.buses import simulate
from sniffer.simulation.render import usb_reads
from tests.recordings import MESSAGES, START_NS, heads, messages, talk

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    import numpy.typing as npt

GOAL, POSITION, LOAD = range(3)


def coarse(protocol: str, many: int = 6) -> list[Chunk]:
    """Return a talk as an adapter delivers it that waits for longer: several reads in one."""
    said = talk(protocol, 1.0, 3)
    parts = [said[n : n + many] for n in range(0, len(said), many)]
    return [replace(part[-1], data=b"".join(c.data for c in part)) for part in parts]


def states(path: Path, protocol: str, said: Sequence[Chunk], size: int, **options: Any) -> None:
    """Record a talk, decoded ``size`` reads at a time."""
    decoder = Decoder(protocol)
    sink = McapSink(path, {"tool": "test"}, **options)
    for n in range(0, len(said), size):
        sink.raw("bus0", said[n : n + size])
        sink.write("bus0", decoder.protocol, decoder.feed(*said[n : n + size]))
        sink.flush()
    sink.write("bus0", decoder.protocol, decoder.close())
    sink.close()


@pytest.mark.parametrize("protocol", ["wck", "rs30x"])
def test_states_have_each_value_that_stands_alone_at_the_same_time(
    protocol: str, tmp_path: Path
) -> None:
    path = tmp_path / "run.mcap"
    states(path, protocol, coarse(protocol), 50, live=True, topics=["state", "flat"])
    alone: dict[tuple[str, str], list[tuple[int, float]]] = {}
    stated: dict[tuple[str, str], list[tuple[int, float]]] = {}
    names, shared = topics(path), 0
    for head in heads(path):
        servo, _, last = names[head.channel_id].rpartition("/")
        if last == "state":
            told = MESSAGES["servo_sniffer.ServoState"].FromString(head.data).ListFields()
            values = {field.name: value for field, value in told if field.number >= 10}
            shared += {"position_deg", "goal_position_deg"} <= values.keys()
            for name, value in values.items():
                stated.setdefault((servo, name), []).append((head.log_time, float(value)))
        elif last not in ("raw", "response_time_ms"):
            value = MESSAGES["servo_sniffer.Quantity"].FromString(head.data).value
            alone.setdefault((servo, last), []).append((head.log_time, value))
    assert stated == alone
    assert shared, "a read brought what a servo was told, and where it was"


@pytest.mark.parametrize("protocol", ["wck", "rs30x"])
def test_which_values_share_a_message_does_not_depend_on_when_they_were_decoded(
    protocol: str, tmp_path: Path
) -> None:
    said = coarse(protocol)
    once, often = tmp_path / "once.mcap", tmp_path / "often.mcap"
    states(once, protocol, said, len(said))
    states(often, protocol, said, 1, live=True, flush_ns=0)
    wanted, found = messages(once), messages(often)
    mine = [topic for topic in wanted if topic.endswith("/state")]
    assert mine
    for topic in mine:
        assert found[topic] == wanted[topic], topic


@pytest.mark.parametrize("live", [True, False])
def test_the_index_has_each_field_of_a_servo_every_10_ms_and_of_a_conversion_all_states(
    tmp_path: Path, *, live: bool
) -> None:
    path = tmp_path / "run.mcap"
    frames = simulate("lss", seed=1, full=True, baud=921600, start_ns=START_NS, duration_s=0.3)
    said = [Chunk(data, t, Clock.READ, "bus0") for t, data in usb_reads(frames, 921600)]
    states(path, "lss", said, 50, live=live, flush_ns=0, topics=["state"])
    told, named = [], []
    for there, index in indexed(path):
        told += [fields(state) for state in there.values()]
        named += [fields(there[at]) for at in index]
        mine, looked_up = ({there[at].channel_id for at in places} for places in (there, index))
        assert looked_up == mine, "who looks a topic up finds no other chunk"
    assert len(told) > 300
    if live:
        assert set().union(*named) == set().union(*told)
        assert len(named) < len(told) / 2
    else:
        assert sorted(map(sorted, named)) == sorted(map(sorted, told))


def indexed(path: Path) -> Iterator[tuple[dict[int, Message], list[int]]]:
    """Yield the states of each chunk by their places in it, and the places that its index names."""
    topic = topics(path)
    found: dict[int, Message] = {}
    named: list[int] = []
    with path.open("rb") as stream:
        for record in StreamReader(stream, emit_chunks=True, validate_crcs=True).records:
            if isinstance(record, MessageIndex) and topic[record.channel_id].endswith("/state"):
                named += [at for _, at in record.records]
                assert all(found[at].log_time == log for log, at in record.records)
                assert {found[at].channel_id for _, at in record.records} == {record.channel_id}
            elif isinstance(record, records.Chunk):
                yield found, named
                found, named, place = {}, [], 0
                for inner in breakup_chunk(record):
                    if isinstance(inner, Message) and topic[inner.channel_id].endswith("/state"):
                        found[place] = inner
                    place += len(as_bytes(inner))
    yield found, named


def fields(message: Message) -> set[tuple[int, int, int]]:
    """Return what the fields of a state are found by: channel, time to 10 ms, number."""
    state = MESSAGES["servo_sniffer.ServoState"].FromString(message.data)
    of = message.channel_id, message.log_time // 10_000_000
    return {(*of, field.number) for field, _ in state.ListFields() if field.number >= 4}


def test_a_message_ends_where_a_field_comes_again_or_the_servo_or_the_read_is_another() -> None:
    told = [
        (1, 9, {GOAL}),
        (2, 9, {GOAL}),
        (1, 9, {POSITION, LOAD}),
        (1, 9, {GOAL}),
        (1, 9, {GOAL}),
        (1, 9, {POSITION}),
        (2, 12, {POSITION}),
        (2, -1, {LOAD}),
        (2, -1, {GOAL}),
    ]
    message, last = known(told).messages()
    assert message.tolist() == [1, 0, 1, 2, 3, 3, 4, 5, 6]
    assert last.tolist() == [1, 2, 3, 5, 6, 7, 8]


def known(told: Sequence[tuple[int, int, set[int]]]) -> ReadValues:
    fields = [(n, field) for n, (_, _, named) in enumerate(told) for field in sorted(named)]
    nothing = np.zeros(len(told), np.int64)
    servo, read = (column([row[k] for row in told]) for k in (0, 1))
    row, field = (column([pair[k] for pair in fields]) for k in (0, 1))
    values = np.zeros(len(fields))
    return ReadValues(
        servo, read, nothing, nothing, nothing, nothing, nothing - 1, row, field, values
    )


def column(numbers: Any) -> npt.NDArray[np.int64]:
    return np.array(numbers, np.int64)


def topics(path: Path) -> dict[int, str]:
    from mcap.reader import make_reader

    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    return {number: channel.topic for number, channel in summary.channels.items()}
