"""Recordings for programs that plot: a topic for each quantity of a servo, with no false zeros."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING, Any

import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

import sniffer
from sniffer.decoding.rows import SampleRow, TransactionRow
from sniffer.mcapfile.fields import state_field
from sniffer.mcapfile.recover import recover
from sniffer.mcapfile.source import session
from sniffer.messages import FLAT, TOPICS
from tests.commands import within
from tests.recordings import messages, record, talk
from tests.test_convert import CAPTURES, LOG, Capsys
from tests.test_mcap_live import live

if TYPE_CHECKING:
    from pathlib import Path


def plotted(path: Path) -> dict[str, list[tuple[int, float]]]:
    """Return the series that PlotJuggler makes of a recording: every field that is a number.

    Its parser walks the fields of a message's descriptor and asks nobody whether one is there: what
    is absent is the default of its type, which is 0.
    """
    out: dict[str, list[tuple[int, float]]] = {}

    def walk(name: str, message: Any, t_ns: int) -> None:
        for field in message.DESCRIPTOR.fields:
            if field.is_repeated or field.cpp_type == field.CPPTYPE_STRING:
                continue
            value = getattr(message, field.name)
            if field.cpp_type == field.CPPTYPE_MESSAGE:
                walk(f"{name}/{field.name}", value, t_ns)
            else:
                out.setdefault(f"{name}/{field.name}", []).append((t_ns, float(value)))

    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        for _, channel, message, decoded in reader.iter_decoded_messages():
            walk(channel.topic, decoded, message.publish_time)
    return out


def told(path: Path) -> dict[str, list[float]]:
    """Return the values of each quantity of a servo, and its response times, read one by one."""
    capture = sniffer.decode(path)
    fields = {(r.name, r.unit): state_field(r) for _, p, _ in capture.batches for r in p.registers}
    out: dict[str, list[float]] = {}
    for row in capture:
        if isinstance(row, SampleRow) and row.value is not None:
            field = fields[row.register, row.unit]
            if field is not None:
                topic = f"/{row.bus}/servo/{row.servo_id}/{field}/value"
                out.setdefault(topic, []).append(row.value)
        elif isinstance(row, TransactionRow) and row.response_time_ns is not None:
            topic = f"/{row.bus}/servo/{row.servo_id}/response_time_ms/value"
            out.setdefault(topic, []).extend([row.response_time_ns / 1e6] * (row.outcome == "ok"))
    return out


@pytest.mark.parametrize("name", ["mightyzap_damaged.log", "wck_damaged.log"])
def test_each_quantity_of_a_servo_is_a_topic_that_plots_what_was_said_and_nothing_else(
    tmp_path: Path, capsys: Capsys, name: str
) -> None:
    out = tmp_path / "flat.mcap"
    done = within(capsys, "convert", CAPTURES / name, out, "--topics", "flat")
    assert done.status == 0
    assert session(out)["topics"] == "raw,flat"
    series = {k: v for k, v in plotted(out).items() if not k.startswith("/bus0/raw")}
    wanted = told(CAPTURES / name)
    assert series.keys() == wanted.keys()
    for topic, values in wanted.items():
        times = [t for t, _ in series[topic]]
        assert times == sorted(times)
        assert sorted(v for _, v in series[topic]) == pytest.approx(sorted(values)), topic


def test_states_plot_false_zeros_which_single_values_do_not(tmp_path: Path, capsys: Capsys) -> None:
    out = tmp_path / "both.mcap"
    within(capsys, "convert", LOG, out, "--topics", "+flat")
    assert session(out)["topics"].split(",") == [*TOPICS, FLAT]
    series = plotted(out)
    state = [v for _, v in series["/bus0/servo/1/state/position_mm"]]
    alone = [v for _, v in series["/bus0/servo/1/position_mm/value"]]
    assert 0.0 in state
    assert 0.0 not in alone
    assert [v for v in state if v] == alone


def test_nobody_gets_single_values_who_does_not_ask_for_them(tmp_path: Path) -> None:
    record(tmp_path / "run.mcap", "mightyzap", talk("mightyzap"))
    names = {topic.rpartition("/")[2] for topic in messages(tmp_path / "run.mcap")}
    assert names <= {*TOPICS}
    assert FLAT not in TOPICS


def test_a_live_recording_of_single_values_that_is_cut_has_all_of_them_again(
    tmp_path: Path,
) -> None:
    sent = talk("mightyzap", 2.0)
    whole, cut, anew = (tmp_path / f"{name}.mcap" for name in ("whole", "cut", "anew"))
    sink = live(whole, sent, flush_ns=0, topics=["flat"])
    data, rng = whole.read_bytes(), random.Random(3)
    sink.close()
    made = 0
    for _ in range(2):
        cut.write_bytes(data[: rng.randrange(len(data) // 2, len(data) * 9 // 10)])
        made += recover(cut, cut).derived
        sniffer.convert(cut, [anew], contents=sniffer.Contents(["flat"]), overwrite=True)
        assert values(cut) == values(anew)
    assert made


def values(path: Path) -> dict[str, list[tuple[int, float]]]:
    return {k: sorted(v) for k, v in plotted(path).items() if "/servo/" in k}


def test_topics_are_about_recordings(tmp_path: Path, capsys: Capsys) -> None:
    done = within(capsys, "convert", LOG, tmp_path / "x.jsonl", "--topics", "flat")
    assert (done.status, done.complaint) == (2, "--topics is about a recording: name an .mcap")
    done = within(capsys, "convert", LOG, tmp_path / "x.mcap", "--topics", "flatt")
    assert (done.status, "did you mean flat?" in done.complaint) == (2, True)
    done = within(capsys, "convert", LOG, tmp_path / "x.mcap", "--topics", "raw,+flat")
    assert (done.status, "or before none" in done.complaint) == (2, True)
    assert not any(tmp_path.iterdir())
