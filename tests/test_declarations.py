"""Declarations of the packet family that are refused, and members that echo the code."""

from __future__ import annotations

import dataclasses
import importlib
import re
from pathlib import Path
from typing import Any, Final

import pytest
from construct import (
    Byte,
    Bytes,
    Check,
    Checksum,
    Const,
    FlagsEnum,
    GreedyBytes,
    Int16ub,
    Int16ul,
    RawCopy,
    Struct,
    Terminated,
    this,
)

from sniffer.decoding.detect import detect
from sniffer.ground.checksums import COMPLEMENT_SUM, SUM8
from sniffer.ground.crc import Crc16
from sniffer.ground.model import Chunk, DeclarationError
from sniffer.protocols import PROTOCOLS
from sniffer.protocols.packets import ANY, BY_CODE, MUST, AllBut, Command, Member, Packet, Seal
from sniffer.protocols.plugins import PluginError, load_file
from sniffer.sources import open_source
from tests.streams.members import EXAMPLES, example

ID, LENGTH, CODE, REST = (
    "servo_id" / Byte,
    "length" / Byte,
    "code" / Byte,
    "params" / Bytes(this.length - 2),
)
HEADER: Final = "header" / Const(b"\xff\xff")
SUM: Final = "checksum" / Checksum(Byte, COMPLEMENT_SUM, this.body.data)


def packet(*fields: Any, checksum: Any = SUM) -> Any:
    return Struct("header" / Const(b"\xff\xff"), "body" / RawCopy(Struct(*fields)), checksum)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"packet": packet("id" / Byte, LENGTH, CODE, REST)}, "one byte that is named servo_id"),
        ({"packet": packet(ID, LENGTH, "cmd" / Byte, REST)}, "one byte that is named code"),
        ({"packet": Struct(ID, LENGTH, CODE, REST, SUM)}, 'packet needs "body" / RawCopy'),
        ({"packet": packet(ID, LENGTH, CODE, REST, checksum=Byte)}, 'needs "checksum" / Checksum'),
        (
            {
                "packet": packet(
                    ID,
                    LENGTH,
                    CODE,
                    REST,
                    checksum="checksum" / Checksum(Byte, sum, this.body.data),
                )
            },
            "take one of sniffer.ground.checksums",
        ),
        (
            {"packet": packet(ID, LENGTH, CODE, "sums" / Bytes(2), REST)},
            "no plan for params <Bytes>",
        ),
        (
            {"packet": packet(ID, LENGTH, Check(lambda ctx: ctx.length < 9), CODE, REST)},
            "packet: a lambda cannot be read: write this.length, with construct's `this`",
        ),
        ({"silent": 254}, r"silent are ids, however many: silent=\(254,\)"),
        ({"feedback": Struct("data" / GreedyBytes)}, "feedback needs a field named error"),
        ({"feedback": Struct("error" / Byte)}, 'feedback needs "data" / GreedyBytes'),
        (
            {"echoes": True, "commands": {1: Command("get", Struct("x" / Byte), MUST, answer=1)}},
            "get may have 1 parameters, as its answer has",
        ),
    ],
)
def test_a_declaration_of_another_form_is_refused_with_what_to_write(
    changes: dict[str, Any], told: str
) -> None:
    with pytest.raises(TypeError, match=told):
        Member(dataclasses.replace(example("dynamixel1").FAMILY, **changes))


def test_errors_that_the_answers_of_some_commands_have_alone_are_called_by_their_names() -> None:
    family = example("herkulex").FAMILY
    plain = dataclasses.replace(family, feedback=Struct("data" / GreedyBytes))
    assert Member(plain).status_names(0b101) == ("input_voltage", "temperature")
    other = Command(
        "turn", Struct(Terminated), MUST, feedback=Struct("error" / FlagsEnum(Byte, x=1))
    )
    with pytest.raises(TypeError, match="differently: one grammar for all, ERROR = FlagsEnum"):
        Member(dataclasses.replace(family, commands={**family.commands, 0x0A: other}))


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        (
            {
                "answer_header": b"\xff\xff\xfd\x01",
                "feedback": Struct("data" / GreedyBytes),
                "stuffing": None,
                "commands": {1: Command("ping", Struct(Terminated), MUST)},
            },
            "answer_header wants .* as the packet's first field",
        ),
        ({"answer_code": lambda code: code ^ 0x80}, "leave the constant out"),
        (
            {"answer_code": lambda code: code ^ 0x40, "feedback": Struct("data" / GreedyBytes)},
            "stuffing goes with answers of code, error and data only",
        ),
        (
            {
                "answer_code": lambda code: code ^ 0x40,
                "feedback": Struct("data" / GreedyBytes),
                "stuffing": None,
            },
            "together goes with answers of code, error and data only",
        ),
        (
            {"answer_code": lambda code: code ^ 0x80, "echoes": True},
            "echoes says that only the count tells an answer: leave out answer_code",
        ),
    ],
)
def test_forms_that_exclude_each_other_are_refused_with_what_to_leave_out(
    changes: dict[str, Any], told: str
) -> None:
    with pytest.raises(TypeError, match=told):
        Member(dataclasses.replace(example("dynamixel2").FAMILY, **changes))


def sealed(*fields: Any) -> Any:
    """Return a packet whose check stands at its front."""
    check = "checksum" / Seal(Byte, COMPLEMENT_SUM, "servo_id", "length", "code", "params")
    return Packet("header" / Const(b"\xff\xff"), check, *(fields or (ID, LENGTH, CODE, REST)))


class OneSum:
    """A checksum that is none elsewhere than at the end."""

    formula = "none"

    def __call__(self, data: bytes) -> int:
        return sum(data) & 0xFF

    def good(self, block: Any, first: Any, at: Any) -> Any:
        return block[at] == first


EMPTY: Final = Struct(Terminated)
GET: Final = Struct("address" / Byte, "length" / Byte, Terminated)
PUT: Final = Struct("address" / Byte, "data" / GreedyBytes)
ONLY: Final = Struct("data" / GreedyBytes)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"baud": 1234}, "baud 1234 is none of bauds: name it there"),
        ({"models": ()}, "models needs a table: models="),
        ({"window_ns": 10}, "window_ns=10 is in nanoseconds: 5 ms are 5_000_000"),
        ({"silent": (256,)}, "silent are ids from 0 to 255, and 256 is none"),
        ({"commands": {300: Command("far", EMPTY, MUST)}}, "codes from 0 to 255: not 300"),
        ({"commands": {1: ("ping", EMPTY)}}, r"commands are \{code: Command"),
        ({"commands": {1: Command("ping", EMPTY, 77)}}, "command ping: its reply is one of NEVER"),
        (
            {"commands": {1: Command("get", GET, MUST, at=3)}},
            "command get: its packets name an address themselves: leave out `at`",
        ),
        (
            {"commands": {1: Command("ping", EMPTY, MUST, space=256)}},
            "command ping: no packet of it names an address that `space` or `stride` could",
        ),
        (
            {"commands": {1: Command("get", GET, MUST, feedback=ONLY)}},
            "get has a feedback of its own: that wants answer_code",
        ),
        (
            {"commands": {1: Command("set", Struct("a" / Byte, Check(this.b > 1)), MUST)}},
            "a Check asks fields of Byte or Int16ul before it, by this.NAME: b is none",
        ),
        (
            {"commands": {1: Command("set", Struct("addr" / Byte, "data" / GreedyBytes), MUST)}},
            "command set: it has no address, .* but addr: call that address",
        ),
        (
            {"commands": {1: Command("get", Struct("address" / Byte, "count" / Byte), MUST)}},
            "command get: it has an address and no length, .* but count: call that length",
        ),
        ({"packet": sealed(LENGTH, CODE, REST)}, "named servo_id, or sole_id=0 where packets name"),
        ({"packet": sealed(), "sole_id": 3}, "packet names a servo_id: leave out sole_id"),
        ({"packet": sealed("servo_id" / Int16ul, LENGTH, CODE, REST)}, "one byte .* servo_id"),
        ({"most": 40}, r"takes more: write Check\(this.length <= 40\) behind it, or another most"),
        ({"packet": sealed(ID, CODE, REST)}, "asks? fields before params, by this.NAME: length"),
        ({"packet": sealed(ID, LENGTH, CODE)}, "a plan needs one field of Bytes"),
        ({"packet": Packet(HEADER, ID, LENGTH, CODE, REST)}, 'packet needs a check, as "checksum"'),
        (
            {"packet": Packet(ID, LENGTH, CODE, REST, "sum" / Seal(Byte, SUM8, "params"))},
            'packet needs a header, "header" / Const.*By hand',
        ),
        (
            {"packet": Packet(HEADER, ID, LENGTH, CODE, REST, "sum" / Seal(Byte, SUM8, "data"))},
            "sum covers data, which is no field of the packet",
        ),
        (
            {"packet": Packet(HEADER, ID, LENGTH, CODE, REST, "sum" / Seal(Byte, SUM8))},
            "sum covers nothing: name fields, Seal",
        ),
        (
            {
                "packet": Packet(
                    HEADER, "sum" / Seal(Byte, OneSum(), "code"), ID, LENGTH, CODE, REST
                )
            },
            "sum stands not right behind the fields it covers: its checksum needs over",
        ),
        (
            {"packet": sealed(ID, LENGTH, CODE, REST, "sum" / Seal(Byte, Crc16(0x1021), "params"))},
            "sum is held by 1 byte, and its checksum has 2: Byte holds one, Int16ul and Int16ub",
        ),
        (
            {"packet": sealed(ID, LENGTH, CODE, REST, "sum" / Seal(Int16ub, SUM8, "params"))},
            "sum is held by 2 bytes, and its checksum has 1",
        ),
        (
            {"packet": sealed(ID, LENGTH, CODE, REST, "sum" / Seal(Bytes(2), SUM8, "params"))},
            "sum is held by Byte, Int16ul or Int16ub, not by <Bytes>",
        ),
        (
            {"packet": sealed(ID, LENGTH, CODE, REST, "sum" / Seal(Int16ub, OneSum(), "params"))},
            "sum is high byte first: its checksum needs over",
        ),
        (
            {"feedback": Struct("code" / Const(b"\x01"), "error" / Byte, "data" / GreedyBytes)},
            "feedback has the code 0x01, which is also a command, ping",
        ),
        (
            {"feedback": Struct("error" / Byte, "more" / Byte, "data" / GreedyBytes)},
            "where the error stands in the place of the code, feedback is Struct",
        ),
        (
            {"answer_code": lambda code: code},
            "ping the code 0x01, which is its own: say echoes=True",
        ),
        ({"answer_code": lambda code: code + 1}, "the code 0x02, which is also a command, read"),
        ({"answer_code": lambda code: 0x70}, "gives read and ping the same code, 0x70"),
        ({"answer_code": lambda code: code + 255}, "0x01. is 256, and a code is from 0 to 255"),
        ({"answer_header": b"\xff"}, "answer_header is another header of 2 bytes"),
        ({"answer_header": b"\xff\xff", "packet": sealed()}, "answer_header is another header"),
        ({"answer_code": lambda code: None}, "answer_code gives no command a code"),
        (
            {"commands": {1: Command("get", EMPTY, MUST, answer=ANY, at=3)}},
            "command get: answer=ANY wants answer_code or answer_header",
        ),
        (
            {"commands": {1: Command("move", PUT, MUST, answer_at=3)}},
            "command move: answer_at is where .*: say how many they are, answer=",
        ),
        (
            {"commands": {1: Command("off", EMPTY, MUST, repeats=True)}},
            "command off: repeats says .* the same packet once more: that wants echoes=True",
        ),
        (
            {"commands": {1: Command("move", PUT, MUST, later={"error": (2,)})}},
            "command move: later wants answer_code or answer_header",
        ),
        (
            {
                "answer_code": lambda code: code + 0x40,
                "commands": {1: Command("move", PUT, MUST, later={"done": (2,)})},
            },
            "command move: later names done, which is no number in its feedback",
        ),
        (
            {
                "packet": Packet(
                    HEADER,
                    ID,
                    CODE,
                    "params" / Bytes(BY_CODE),
                    "sum" / Seal(Byte, SUM8, "params"),
                ),
            },
            "command .*: BY_CODE wants one size of it: say parameters without bytes of any number",
        ),
        (
            {"commands": {1: Command("off", EMPTY, MUST, stride=2)}},
            "command off: no packet of it names an address that `space` or `stride` could move",
        ),
        (
            {
                "packet": Packet(
                    HEADER, ID, LENGTH, CODE, "sum" / Seal(Byte, SUM8, "code", some=True), REST
                )
            },
            "sum is not always there: then it is the last of the packet, and covers params",
        ),
        (
            {
                "answer_code": lambda code: code ^ 0x40,
                "feedback": Struct("data" / GreedyBytes, "error" / Byte),
            },
            "feedback: no columns for error .*|feedback: write .data. / AllBut",
        ),
        (
            {
                "answer_code": lambda code: code ^ 0x40,
                "feedback": Struct("data" / AllBut(2), "error" / Byte),
            },
            r"feedback: AllBut\(2\) leaves 2 bytes, and 1 stand behind the data",
        ),
        (
            {
                "answer_code": lambda code: code ^ 0x40,
                "feedback": Struct("code" / Const(b"\x80"), "error" / Byte),
            },
            "feedback is what stands behind the code: leave the constant out",
        ),
    ],
)
def test_a_newcomers_mistake_is_told_in_a_sentence_that_says_what_to_write(
    changes: dict[str, Any], told: str
) -> None:
    with pytest.raises(DeclarationError, match=told) as found:
        Member(dataclasses.replace(example("dynamixel1").FAMILY, **changes))
    assert str(found.value).startswith("dynamixel1: ")
    assert "\n" not in str(found.value)


def test_a_file_whose_declaration_is_refused_says_that_and_no_more(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    text = (EXAMPLES / "lx16a" / "sniffer_lx16a.py").read_text(encoding="utf-8")
    table = (EXAMPLES / "lx16a" / "lx-16a.toml").read_text(encoding="utf-8")
    (tmp_path / "lx-16a.toml").write_text(table, encoding="utf-8")
    file.write_text(text.replace("window_ns=30_000_000", "window_ns=30"), encoding="utf-8")
    with pytest.raises(PluginError) as told:
        load_file(file, "mine.py")
    assert str(told.value) == "mine.py: lx16a: window_ns=30 is in nanoseconds: 5 ms are 5_000_000"
    file.write_text("import re\nre.compile('(')\n", encoding="utf-8")
    with pytest.raises(PluginError, match=r"\(mine.py, line 2\)"):
        load_file(file, "mine.py")
    file.write_text(text.replace("= Member(FAMILY)", "= FAMILY"), encoding="utf-8")
    with pytest.raises(PluginError, match=r"PROTOCOL = Member\(PacketFamily"):
        load_file(file, "mine.py")


def test_what_the_docs_show_of_the_examples_stands_in_them() -> None:
    text = (EXAMPLES.parents[1] / "docs" / "plugins.md").read_text(encoding="utf-8")
    shown = text.partition("### What the manual says")[2].partition("## A protocol, as a package")[
        0
    ]
    blocks = re.findall(r"^```py\n(.*?)^```$", shown, re.MULTILINE | re.DOTALL)
    files = [EXAMPLES / n / f"sniffer_{n}.py" for n in ("herkulex", "ics")]
    written = "".join(file.read_text(encoding="utf-8") for file in files)
    assert len(blocks) == 3
    assert [block for block in blocks if block not in written] == []


@pytest.fixture
def everyone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have all examples looked for beside what is built in."""
    names = ("dynamixel1", "dynamixel2", "feetech", "lx16a", "herkulex", "lktech", "cubemars")
    them = [*PROTOCOLS.values(), *(example(name).PROTOCOL for name in names)]
    monkeypatch.setattr(PROTOCOLS, "candidates", lambda heard=None: them)


@pytest.mark.usefixtures("everyone")
@pytest.mark.parametrize("name", ["lx16a", "herkulex"])
def test_a_member_is_told_from_the_bytes_among_all_others(name: str) -> None:
    exchanges = importlib.import_module(f"tests.talks.{name}").TALK.exchanges
    said = b"".join(
        raw for e in exchanges if e.answers is not None for raw in (e.request, *e.answers)
    )
    found = detect([Chunk(said)])
    assert (found.protocol, found.certainty) == (name, "sure")


@pytest.mark.usefixtures("everyone")
@pytest.mark.parametrize("name", list(PROTOCOLS.built_in))
def test_no_member_takes_a_capture_from_those_that_are_built_in(name: str) -> None:
    for path in sorted((Path(__file__).parents[1] / "sample_captures").glob(f"{name}_*")):
        heard = [c for group in open_source(path) for c in group]
        assert detect(heard).protocol == name
