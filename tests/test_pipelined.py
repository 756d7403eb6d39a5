"""Several requests in flight: who is answered by what, and what is said where it cannot be told."""

from __future__ import annotations

import pytest

from sniffer.decoding import pairing
from sniffer.decoding.decoder import Decoder
from sniffer.decoding.reference import Reference
from sniffer.decoding.rows import FrameRow, SampleRow, TransactionRow, rows
from sniffer.ground.codes import OUTCOMES
from sniffer.ground.model import Batch, Chunk, Clock
from sniffer.protocols import PROTOCOLS
from tests.records import batches, records
from tests.streams.mightyzap import packet as zap
from tests.streams.rs30x import packet, returned

NS = 1_000_000
POSITION, VOLTAGE, LONG = (
    zap(1, 0xF2, bytes([a, n])) for a, n in ((0x8C, 2), (0x92, 2), (0x8C, 4))
)
TWO = zap(1, 0, b"\x10\x02")


def decoded(name: str, *data: bytes) -> list[Batch]:
    """Decode in one pass; the reference, and one pass a byte, must tell the same."""
    chunk = Chunk(b"".join(data))
    parts = batches(Decoder(name), [[chunk]])
    told = records(parts)
    assert Reference(PROTOCOLS[name]).decode([chunk]) == told
    one_by_one = [[Chunk(bytes([b]))] for b in chunk.data]
    assert records(batches(Decoder(name), one_by_one)) == told
    return parts


def exchanges(name: str, *data: bytes) -> list[tuple[int | None, int | None, str]]:
    """Return request and answer, each as the number of its part, and the outcome, by request."""
    at, number = 0, {-1: None}
    for i, part in enumerate(data):
        number[at] = i  # type: ignore[assignment]
        at += len(part)
    found = records(decoded(name, *data)).transactions
    return [(number[q], number[r], OUTCOMES[how]) for q, r, how, *_ in found]


def codes(name: str, *data: bytes) -> list[str]:
    return [a.code for b in decoded(name, *data) for a in b.anomalies]


def samples(name: str, *data: bytes) -> list[tuple[int | None, str, int]]:
    protocol = PROTOCOLS[name]
    told = [row for b in decoded(name, *data) for row in rows(b, protocol)]
    return [(s.servo_id, s.register, s.raw) for s in told if isinstance(s, SampleRow)]


def back(who: int, raw: int = 0) -> bytes:
    return returned(who, 42, raw.to_bytes(2, "little") + bytes(16))


@pytest.mark.parametrize(
    ("name", "asked", "answers"),
    [
        ("lss", [b"#1QD\r", b"#1QV\r"], [b"*1QD10\r", b"*1QV12000\r"]),
        ("lss", [b"#1QD\r", b"#2QD\r"], [b"*1QD10\r", b"*2QD20\r"]),
        ("rs30x", [packet(1, 9), packet(2, 9)], [back(1), back(2)]),
        (
            "rs30x",
            [packet(1, 0x0F, 42, 2), packet(1, 0x0F, 44, 2)],
            [returned(1, 42, b"\1\0"), returned(1, 44, b"\2\0")],
        ),
        (
            "mightyzap",
            [bytes.fromhex("FFFFFF0104F28C027A"), bytes.fromhex("FFFFFF0204F28C0279")],
            [TWO, zap(2, 0, b"\x11\x03")],
        ),
        ("mightyzap", [POSITION, LONG], [TWO, zap(1, 0, b"\x10\x02\0\0")]),
    ],
)
def test_answers_to_distinct_requests_in_flight_are_matched_by_what_they_carry_in_any_order(
    name: str, asked: list[bytes], answers: list[bytes]
) -> None:
    assert exchanges(name, *asked, *answers) == [(0, 2, "ok"), (1, 3, "ok")]
    assert exchanges(name, *asked, *answers[::-1]) == [(0, 3, "ok"), (1, 2, "ok")]
    assert codes(name, *asked, *answers) == []
    assert len(samples(name, *asked, *answers)) >= 2


def test_wck_replies_to_commands_in_a_row_come_in_their_order() -> None:
    """A status read of servo 9 and a set of servo 12's id; then both replies."""
    asked = bytes.fromhex("FFA90029"), bytes.fromhex("FFE90C000065")
    answers = bytes.fromhex("0059"), bytes.fromhex("0000")
    assert exchanges("wck", *asked, *answers) == [(0, 2, "ok"), (1, 3, "ok")]
    assert "echo-mismatch" not in codes("wck", *asked, *answers)
    assert (9, "position", 0x59) in samples("wck", *asked, *answers)


def test_sixteen_wck_commands_written_at_once_all_get_their_reply() -> None:
    asked = [bytes([0xFF, 0xA0 | i, 0x10, (0xA0 | i) ^ 0x10 & 0x7F]) for i in range(16)]
    asked = [raw[:3] + bytes([(raw[1] ^ raw[2]) & 0x7F]) for raw in asked]
    answers = [bytes([i, 100 + i]) for i in range(16)]
    assert exchanges("wck", *asked, *answers) == [(i, 16 + i, "ok") for i in range(16)]


def test_equal_requests_are_answered_first_by_first() -> None:
    assert exchanges("mightyzap", POSITION, POSITION, TWO, TWO) == [(0, 2, "ok"), (1, 3, "ok")]


def test_the_one_answer_to_a_request_and_its_retry_is_that_of_the_retry() -> None:
    told = [(0, None, "no_response"), (1, 2, "ok")]
    assert exchanges("mightyzap", POSITION, POSITION, TWO) == told
    assert exchanges("lss", b"#1QD\r", b"#1QD\r", b"*1QD5\r") == told
    assert exchanges("rs30x", packet(1, 9), packet(1, 9), back(1)) == told
    follow = POSITION, TWO, POSITION, TWO
    assert [how for *_, how in exchanges("mightyzap", POSITION, *follow)] == [
        "no_response",
        "ok",
        "ok",
    ]


def test_a_second_answer_to_one_request_is_a_duplicate_also_among_several() -> None:
    assert exchanges("mightyzap", POSITION, TWO, TWO) == [(0, 1, "ok"), (None, 2, "unsolicited")]
    assert codes("mightyzap", POSITION, TWO, TWO) == ["duplicate-response"]
    both = b"#1QD\r", b"#2QD\r", b"*1QD1\r", b"*1QD2\r", b"*2QD3\r"
    assert codes("lss", *both) == ["duplicate-response"]
    assert exchanges("lss", *both)[:2] == [(0, 2, "ok"), (1, 4, "ok")]


def test_a_command_that_nobody_answers_closes_no_request() -> None:
    everyone = zap(254, 0xF3, b"\x86\x01\x02")
    assert exchanges("mightyzap", POSITION, everyone, TWO) == [
        (0, 2, "ok"),
        (1, None, "not_expected"),
    ]
    assert codes("mightyzap", POSITION, everyone, TWO) == []


def test_of_two_requests_the_one_whose_answer_is_lost_has_none() -> None:
    lost = b"#1QD\r", b"#2QD\r", b"*1QD1\r"
    assert exchanges("lss", *lost) == [(0, 2, "ok"), (1, None, "no_response")]
    behind = b"#3QD\r", b"*3QD3\r"  # the controller went on
    found = [a for b in decoded("lss", *lost, *behind) for a in b.anomalies]
    assert [(a.code, a.servo_id) for a in found] == [("no-response", 2)]


def test_an_answer_of_another_servo_right_behind_a_request_is_a_misfit() -> None:
    assert exchanges("mightyzap", POSITION, zap(2, 0, b"\1\2")) == [(0, 1, "mismatched")]


def test_a_stray_answer_between_request_and_answer_is_unsolicited_and_the_request_answered() -> (
    None
):
    assert exchanges("mightyzap", POSITION, zap(2, 0, b"\1\2"), TWO) == [
        (0, 2, "ok"),
        (None, 1, "unsolicited"),
    ]


def test_a_request_to_all_leaves_the_answer_to_a_later_one_to_that() -> None:
    told = exchanges("lss", b"#254QD\r", b"#1QD\r", b"*1QD1\r", b"*1QD1\r", b"*2QD2\r", b"*3QD3\r")
    assert told == [(0, 3, "ok"), (0, 4, "ok"), (0, 5, "ok"), (1, 2, "ok")]


def test_of_two_reads_of_one_length_the_later_is_answered_and_that_it_is_a_guess_is_told() -> None:
    assert exchanges("mightyzap", POSITION, VOLTAGE, TWO) == [
        (0, None, "no_response"),
        (1, 2, "ok"),
    ]
    on = POSITION, TWO  # the controller went on
    assert codes("mightyzap", POSITION, VOLTAGE, TWO, *on) == ["no-response", "ambiguous-response"]
    assert codes("mightyzap", POSITION, LONG, TWO, *on) == ["no-response"]  # the length tells
    # the same either way
    assert codes("mightyzap", POSITION, POSITION, TWO, *on) == ["no-response"]


def test_a_wck_reply_behind_two_commands_is_the_laters_and_that_it_is_a_guess_is_told() -> None:
    row = bytes.fromhex("FFA90029"), bytes.fromhex("FFE90C000065"), bytes.fromhex("0059")
    assert exchanges("wck", *row) == [(0, None, "no_response"), (1, 2, "ok")]
    on = bytes.fromhex("FFAC002C"), bytes.fromhex("0059")  # the controller went on
    assert codes("wck", *row, *on) == ["id-changed", "no-response", "ambiguous-response"]


def test_a_request_is_closed_by_sixteen_others_by_its_reach_and_by_a_silence() -> None:
    asked = [b"#%dQD\r" % i for i in range(1, 18)]
    assert exchanges("lss", *asked[:16], b"*1QD5\r")[0] == (0, 16, "ok")
    assert exchanges("lss", *asked, b"*1QD5\r")[0] == (0, None, "no_response")
    far = [zap(254, 0xF3, b"\x86" + bytes(100))] * 3
    assert exchanges("mightyzap", POSITION, *far[:2], TWO)[0] == (0, 3, "ok")
    assert exchanges("mightyzap", POSITION, *far, TWO)[0] == (0, None, "no_response")
    silent = [Chunk(POSITION, 0, Clock.FILE), Chunk(TWO, 300 * NS, Clock.FILE)]
    told = records(batches(Decoder("mightyzap"), [silent])).transactions
    assert [OUTCOMES[how] for _, _, how, *_ in told] == ["no_response", "unsolicited"]


def test_an_answer_that_describes_itself_is_read_also_where_nothing_asked_for_it() -> None:
    assert samples("lss", b"*1QD10\r") == [(1, "present_position", 10)]
    assert samples("lss", b"#1QV\r", b"*2QD10\r") == [(2, "present_position", 10)]
    assert samples("lss", b"*1QSD55\r") == []  # which speed, the query's selector says
    assert (1, "present_position", 7) in samples("rs30x", back(1, 7))
    assert samples("mightyzap", TWO) == []  # its bytes have no address
    told = [r for b in decoded("lss", b"#1QV\r", b"*2QD10\r") for r in rows(b, PROTOCOLS["lss"])]
    assert [r.op for r in told if isinstance(r, FrameRow)] == ["QV", "QD"]
    assert [r.outcome for r in told if isinstance(r, TransactionRow)] == ["mismatched"]


def test_a_second_answer_behind_a_ping_is_no_proof_that_writes_are_answered() -> None:
    """A write the servo does not answer, a ping, and its answer from two servos with one id."""
    write, ping, ack = zap(1, 0xF3, b"\x86\x01\x02"), zap(1, 0xF1), zap(1, 0)
    told = exchanges("mightyzap", write, ping, ack, ack, write, POSITION, TWO)
    assert told[2] == (4, None, "not_expected")


def test_torn_bytes_among_answers_in_turn_are_the_answer_that_is_missing() -> None:
    asked = [zap(i, 0xF2, b"\x8c\x02") for i in (1, 2, 3)]
    answers = [zap(i, 0, b"\1\2") for i in (1, 2, 3)]
    for hit in range(3):
        torn = [a[:-1] + bytes([a[-1] ^ 1]) if i == hit else a for i, a in enumerate(answers)]
        told = [how for *_, how in exchanges("mightyzap", *asked, *torn)]
        assert told == ["damaged" if i == hit else "ok" for i in range(3)]


@pytest.mark.parametrize("chain", [pairing.CHAIN, 0])
def test_an_answer_torn_in_a_chain_without_end_is_damaged_wherever_the_chain_is_cut(
    chain: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two are asked while the two before are open; every fifth time the second answer is torn."""
    monkeypatch.setattr(pairing, "CHAIN", chain)
    ask, answer = [[b % (i % 8) for i in range(900)] for b in (b"#%dQD\r", b"*%dQD1\r")]
    torn = range(1, 890, 10)
    for i in torn:
        answer[i] = answer[i][:-3]
    rounds = (answer[i : i + 2] + ask[i + 4 : i + 6] for i in range(0, 890, 2))
    s = b"".join([*ask[:4], *(part for parts in rounds for part in parts)])
    assert len(s) > 2 * pairing.CHAIN
    parts = batches(Decoder("lss"), [[Chunk(s[at : at + 64])] for at in range(0, len(s), 64)])
    told = records(parts)
    assert any(b.before is not None for b in parts)  # it was cut
    assert told == records(batches(Decoder("lss"), [[Chunk(s)]]))
    damaged = [q for q, _, how, *_ in told.transactions if OUTCOMES[how] == "damaged"]
    assert len(damaged) == len(torn)


def test_that_it_is_a_guess_is_told_wherever_the_chain_is_cut(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The cut leads between the two requests and the answer that may be either's."""
    on = [zap(3, 0xF2, b"\x8c\x02"), zap(3, 0, b"\1\2")] * 20
    data = [POSITION, VOLTAGE, zap(2, 0xF2, b"\x8c\x02"), TWO, *on]
    whole = codes("mightyzap", *data)
    assert whole == ["no-response", "no-response", "ambiguous-response"]
    monkeypatch.setattr(pairing, "CHAIN", 0)
    parts = batches(Decoder("mightyzap"), [[Chunk(bytes([b]))] for b in b"".join(data)])
    assert any(b.before is not None for b in parts)  # it was cut
    assert [a.code for b in parts for a in b.anomalies] == whole


def test_a_row_of_wck_commands_is_not_cut_before_its_replies(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Doubled ones wait until it is known whether they are an adapter's echo."""
    monkeypatch.setattr(pairing, "CHAIN", 0)
    one, two = bytes.fromhex("fff80e9c7f15"), bytes.fromhex("fff310bc124d")
    told = [how for *_, how in exchanges("wck", two, two, two, one, one, *[b"\x3c\x12"] * 3, two)]
    assert told == ["no_response", "no_response", "ok", "ok", "ok", "no_response"]


def test_late_answers_are_told_for_the_request_that_each_of_them_fits() -> None:
    asked = b"#1QD\r#2QD\r"
    chunks = [
        Chunk(asked, 0, Clock.FILE),
        Chunk(b"*1QD1\r", 400 * NS, Clock.FILE),
        Chunk(b"*2QD2\r", 410 * NS, Clock.FILE),
    ]
    found = [a for b in batches(Decoder("lss"), [chunks]) for a in b.anomalies]
    late = [(a.servo_id, a.evidence[1]) for a in found if a.code == "late-response"]
    assert late == [(1, (0, 5)), (2, (5, 5))]
