"""What tshark shows of a capture, with the dissector, is what the decoder says of it."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pytest

import sniffer
from sniffer.decoding.options import AUTO, Options
from sniffer.ground.registers import TYPES
from sniffer.protocols.wck.grammar import build
from sniffer.wireshark.lua import lua
from tests.sharks import join, summed_up, tshark
from tests.streams.mightyzap import packet

if TYPE_CHECKING:
    from collections.abc import Iterator

SAMPLES: Final = sorted(
    (p for p in Path("sample_captures").iterdir() if p.suffix != ".md"),
    key=lambda p: ("damaged", "clean", "manual").index(p.stem.partition("_")[2]),
)
"""Those whose times count from 1970 first: the dissector takes times that go back for another
capture."""

TALKS: Final = {
    "an_answer_that_fits_nothing_until_the_right_one_comes": (
        "lss",
        b"#5QDT\r*5QD12\r*5QDT3\r#5QD\r*5QT1\r*5QD1\r",
    ),
    "bare_replies_in_a_row_are_those_of_as_many_commands": (
        "wck",
        build("status_read", data1={"id": 2}) + build("status_read", data1={"id": 3}) + b"\0\1\0\2",
    ),
    "a_refused_resolution_does_not_hold": (
        "mightyzap",
        b"".join(
            (
                packet(1, 0xF3, b"\x16\x02"),
                packet(1, 0x40),
                packet(1, 0xF2, b"\x8c\x02"),
                packet(1, 0, b"\xff\x07"),
            )
        ),
    ),
}
"""Talk that a dissector once had wrong, or may."""

FIELDS: Final = (
    *(
        "kind",
        "id",
        "op",
        "status",
        "addr",
        "text",
        "outcome",
        "refused",
        "response_to",
        "response_in",
    ),
    *("rtt", "rtt.uncertainty", "register", "raw", "target", "checksum.status", "checksum.bad"),
)
VALUE: Final = "servo.reg."
WITHIN_S: Final = 1.7e-6
"""An RTAC head tells its start to the microsecond, Lua a packet's time to a quarter of one; both
are rounded to one."""

Record = dict[str, Any]


@dataclass
class Compared:
    """A packet as tshark shows it, and all that the decoder says of it."""

    shown: dict[str, list[str]]
    record: Record
    transaction: Record | None
    answered_in: str
    asked_in: str
    samples: list[Record]

    @property
    def is_response(self) -> bool:
        return self.record.get("kind") == "response"

    def one(self, field: str) -> str | None:
        """Return the field's only value, None where it is not there."""
        assert len(self.shown[field]) < 2, (field, self)
        return self.shown[field][0] if self.shown[field] else None


@pytest.fixture(scope="module")
def packets(dissector: Path, tmp_path_factory: pytest.TempPathFactory) -> list[Compared]:
    """Every packet of the sample captures, looked at as one file: tshark starts slowly."""
    folder = tmp_path_factory.mktemp("shark")
    captures, said = [], []
    for name, (_, data) in TALKS.items():
        (folder / f"{name}.bin").write_bytes(data)
    for path in [*SAMPLES, *(folder / f"{name}.bin" for name in TALKS)]:
        outputs = [folder / f"{path.stem}{suffix}" for suffix in (".pcapng", ".jsonl")]
        protocol = TALKS[path.stem][0] if path.stem in TALKS else AUTO
        sniffer.convert(path, outputs, Options(protocol))
        captures.append(str(outputs[0]))
        said.append([json.loads(line) for line in outputs[1].read_text("utf-8").splitlines()])
    whole = folder / "all.pcapng"
    join(whole, captures)
    registers = {r["register"] for records in said for r in records if r["type"] == "sample"}
    names = [f"servo.{name}" for name in FIELDS] + [VALUE + name for name in sorted(registers)]
    rows = tshark(dissector, "-2", "-r", str(whole), fields=names)
    out = list(_joined(said, rows))
    assert len(out) == len(rows)
    return out


def _joined(captures: list[list[Record]], rows: list[dict[str, list[str]]]) -> Iterator[Compared]:
    at = 0
    for records in captures:
        heard = sorted(
            (r for r in records if r["type"] in ("frame", "gap")), key=lambda r: r["offset"]
        )
        number = {r["offset"]: str(at + i) for i, r in enumerate(heard, 1)}
        answers: dict[int, Record] = {}
        answered: dict[int, int] = {}
        samples = defaultdict(list)
        for r in records:
            if r["type"] == "sample":
                samples[r["offset"]].append(r)
            elif r["type"] == "transaction" and r["response_offset"] is not None:
                answers[r["response_offset"]] = r
                if r["request_offset"] is not None:
                    answered[r["request_offset"]] = r["response_offset"]
        for r in heard:
            where, told = r["offset"], answers.get(r["offset"])
            yield Compared(
                rows[at],
                r,
                told,
                number.get(answered.get(where, -1), ""),
                number.get(told["request_offset"], "") if told else "",
                samples[where],
            )
            at += 1


def test_requests_answers_and_gaps_are_told_apart(packets: list[Compared]) -> None:
    for p in packets:
        kind = {"request": "0", "response": "1"}.get(p.record.get("kind", ""), "2")
        assert p.one("servo.kind") == kind, p


def test_every_frame_has_the_servo_the_command_and_the_address_of_the_decode(
    packets: list[Compared],
) -> None:
    for p in packets:
        if p.record["type"] == "gap":
            assert not p.shown["servo.id"], p
            assert not p.shown["servo.op"], p
            continue
        servo, fields = p.record["servo_id"], p.record["fields"]
        assert p.one("servo.id") == (None if servo is None else str(servo)), p
        assert p.one("servo.op") == p.record["op"], p
        if p.record["protocol"] == "mightyzap" and "address" in fields:
            assert p.one("servo.addr") == str(fields["address"]), p


def test_status_bytes_are_those_of_the_decode(packets: list[Compared]) -> None:
    seen = 0
    for p in packets:
        told = p.record.get("fields", {})
        told = told.get("error") or (told.get("flags") if p.is_response else None)
        if told is not None:
            assert int(p.one("servo.status") or "-1", 16) == told["number"], p
            seen += 1
    assert seen > 1000


def test_checksums_are_good_bad_or_none_as_the_decode_says(packets: list[Compared]) -> None:
    bad = 0
    for p in packets:
        detail = p.record.get("detail", {})
        if "checksum_expected" in detail:
            assert p.one("servo.checksum.status") == "0", p
            assert p.one("servo.checksum.bad") == "1", p
            bad += 1
        elif p.record["type"] == "frame":
            status = {"ok": "1", "none": "2"}[p.record["checksum"]]
            assert p.one("servo.checksum.status") == status, p
    assert bad > 5


def test_requests_and_answers_are_linked_as_transactions_are(packets: list[Compared]) -> None:
    for p in packets:
        assert (p.one("servo.response_in") or "") == p.answered_in, p
        assert (p.one("servo.response_to") or "") == p.asked_in, p
        assert p.one("servo.outcome") == (p.transaction["outcome"] if p.transaction else None), p


def test_response_times_are_those_of_the_decode_to_the_microsecond_of_the_format(
    packets: list[Compared],
) -> None:
    for p in packets:
        took = p.transaction["response_time_ns"] if p.transaction else None
        if took is None:
            assert not p.shown["servo.rtt"], p
            continue
        assert float(p.one("servo.rtt") or "nan") == pytest.approx(took / 1e9, abs=WITHIN_S), p
        # what an assumed rate adds to it is not said in the file
        assert p.one("servo.rtt.uncertainty") == "0.001", p
        assert p.transaction is not None
        assert p.transaction["uncertainty_ns"] >= 1_000_000, p


def test_registers_have_the_values_of_the_samples(packets: list[Compared]) -> None:
    count = refused = 0
    for p in packets:
        if p.shown["servo.refused"]:  # what was asked for is shown, and none of it became true
            assert not p.samples, p
            refused += 1
            continue
        valued: dict[str, list[float]] = defaultdict(list)
        for s in p.samples:
            if s["value"] is not None:
                valued[s["register"]].append(s["value"])
                count += 1
        shown = {
            name.removeprefix(VALUE): [round(float(v), 6) for v in values]
            for name, values in p.shown.items()
            if name.startswith(VALUE) and values
        }
        assert shown == dict(valued), p
        without = [s for s in p.samples if s["value"] is None]
        assert p.shown["servo.register"] == [s["register"] for s in without], p
        assert p.shown["servo.raw"] == [str(s["raw"]) for s in without], p
        others = [s["servo_id"] for s in p.samples if s["servo_id"] != p.record["servo_id"]]
        assert p.shown["servo.target"] == [str(servo) for servo in others], p
    assert count > 20_000
    assert refused > 0


def test_where_no_field_is_asked_for_experts_and_protocols_are_told_all_the_same(
    dissector: Path, tmp_path: Path
) -> None:
    capture = tmp_path / "x.pcapng"
    log = Path(sniffer.__file__).parents[1] / "sample_captures" / "mightyzap_damaged.log"
    sniffer.convert(log, [capture])
    asked = ("-z", "expert,error", "-z", "expert,warn", "-z", "io,phs")
    plain = summed_up(dissector, capture, *asked)
    all_laid_out = summed_up(dissector, capture, *asked, "-z", "io,stat,0,servo")
    assert re.search(r"\d+ +Checksum .*The checksum does not hold", plain)
    assert re.search(r"servo +frames:\d{3}", plain)
    for line in plain.splitlines():
        assert line in all_laid_out


def test_texts_that_servos_answer_are_shown(packets: list[Compared]) -> None:
    texts = 0
    for p in packets:
        value = p.record.get("fields", {}).get("value")
        if p.record.get("protocol") == "lss" and isinstance(value, str):
            assert p.one("servo.text") == value, p
            texts += 1
    assert texts > 3


@pytest.mark.parametrize(
    ("value", "written"),
    [
        ({"end": 1, "x": None, 3: True}, '{["end"] = 1, [3] = true}'),
        ([1, 0.1, 'a"b\\c\n'], '{1, 0.1, "a\\"b\\\\c\\n"}'),
        (b"\xff\x0a", '"\\255\\010"'),
    ],
)
def test_values_are_written_as_lua_reads_them(value: object, written: str) -> None:
    assert lua(value) == written


def test_lua_has_no_sets() -> None:
    with pytest.raises(TypeError, match="no Lua for"):
        lua({1, 2})


def test_the_engine_has_no_operators_that_old_lua_lacks() -> None:
    for path in Path("sniffer/wireshark/engine").glob("*.lua"):
        code = re.sub(r'"(\\.|[^"\\])*"|--[^\n]*', "", path.read_text("utf-8"))
        assert not re.search(r"//|<<|>>|[&|]|(?<!~)~(?!=)|\bgoto\b", code), path.name


def test_numbers_of_every_type_that_tables_have_are_read_as_the_decoder_reads_them(
    good: Path, tmp_path: Path
) -> None:
    edges = [bytes(8), b"\xff" * 8, b"\x80" + bytes(7), bytes(7) + b"\x80", bytes(range(1, 9))]
    edges += [
        b"\x7f" + b"\xff" * 7,
        bytes.fromhex("FEFFFFFFFFFFFFFF"),
        bytes.fromhex("0102030405060000"),
    ]
    cases = [
        (name, raw[: kind.itemsize], int(np.frombuffer(raw[: kind.itemsize], kind)[0]))
        for name, kind in TYPES.items()
        for raw in edges
        if kind.itemsize and name != "decimal"
    ]
    cases = [case for case in cases if abs(case[2]) < 2**53]  # old Lua has no more digits
    assert {name for name, _, _ in cases} >= {"u32be", "i32be", "i64"}
    values = Path("sniffer/wireshark/engine/1_values.lua").read_text("utf-8")
    numbers = re.split(r"^-{20,}.*$", values, flags=re.M)[1]
    prints = [f"print('read', digits(READS.{n}({lua(b'?' + raw)}, 2)))" for n, raw, _ in cases]
    script, capture = tmp_path / "numbers.lua", tmp_path / "any.pcapng"
    script.write_text("\n".join([numbers, *prints]), encoding="utf-8")
    sniffer.convert(good, [capture], Options("mightyzap"))
    said = summed_up(script, capture)
    assert [int(n) for n in re.findall(r"^read\t(\S+)$", said, re.M)] == [
        want for *_, want in cases
    ]


@pytest.mark.skipif(shutil.which("luac5.1") is None, reason="needs luac5.1")
def test_the_dissector_is_lua_of_the_oldest_kind(dissector: Path) -> None:
    assert subprocess.run(["luac5.1", "-p", dissector], check=False).returncode == 0
