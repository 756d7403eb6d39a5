"""What the tool knows: one frame drawn, the protocols, the register tables."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest

from sniffer.protocols import PROTOCOLS
from tests.commands import within
from tests.streams.mightyzap import packet

if TYPE_CHECKING:
    from sniffer.ground.registers import RegisterMap

Capsys = pytest.CaptureFixture[str]

ECHO = "FF FF FF 00 02 F1 0C"
READ = packet(1, 0xF2, b"\x8c\x08").hex()
REPLY = packet(1, 0, bytes([0xC3, 0x07, 0x35, 0x03, 0, 0, 120, 40])).hex(" ").upper()


# --- explain -----------------------------------------------------------------------------------


def test_a_good_frame_is_drawn_byte_by_byte(capsys: Capsys) -> None:
    ran = within(capsys, "explain", *ECHO.split())
    assert (ran.status, ran.err) == (0, "")
    lines = ran.out.splitlines()
    assert lines[:4] == [
        "IRROBOT mightyZAP (IR protocol), 7 bytes",
        "",
        "request: echo, servo 0",
        f"  {ECHO}",
    ]
    fields = [line.split()[0] for line in lines[4:] if line[2:5].strip().isdigit()]
    assert fields == ["0", "3", "4", "5", "6"]
    assert any("checksum" in line and "[00 02 F1] = 0C, sent 0C" in line for line in lines)


@pytest.mark.parametrize(
    "form", [ECHO.replace(" ", ""), ECHO.lower(), "0xff,0xff, 0xff,0x00,0x02,0xf1,0x0c"]
)
def test_hex_may_be_written_in_any_way(form: str, capsys: Capsys) -> None:
    assert within(capsys, "explain", form).out == within(capsys, "explain", ECHO).out


def test_a_reply_alone_cannot_name_its_values(capsys: Capsys) -> None:
    ran = within(capsys, "explain", REPLY)
    assert ran.status == 0
    assert "exchange: unsolicited" in ran.out
    assert "present_position" not in ran.out


def test_a_reply_after_its_request_names_its_values(capsys: Capsys) -> None:
    ran = within(capsys, "explain", REPLY, "--after", READ)
    assert (ran.status, ran.err) == (0, "")
    assert "response: load_data, servo 1" in ran.out
    assert "request:" not in ran.out
    assert "present_position: raw 1987 = 14.5568 mm" in ran.out
    assert "present_voltage: raw 120 = 12 V" in ran.out
    assert "exchange: ok" in ran.out


def test_a_model_changes_what_the_values_mean(capsys: Capsys) -> None:
    known = within(capsys, "explain", REPLY, "--after", READ, "--model", "mightyzap-12lf").out
    assert "present_load" in within(capsys, "explain", REPLY, "--after", READ).out
    assert "present_current" in known


def test_a_damaged_frame_shows_both_sums_and_what_was_read(capsys: Capsys) -> None:
    ran = within(capsys, "explain", "FF FF FF 00 02 F1 0D")
    assert (ran.status, ran.err) == (1, "")
    assert ran.out.splitlines()[2:] == [
        "no frame: damaged",
        "  FF FF FF 00 02 F1 0D",
        "  checksum expected: 0C",
        "  checksum got: 0D",
        "  fields, as they were read:",
        "    servo id: 0",
        "    op: echo",
        "    data: none",
    ]


def test_a_frame_with_a_byte_too_many_is_half_explained(capsys: Capsys) -> None:
    ran = within(capsys, "explain", f"{ECHO} 55")
    assert ran.status == 1
    assert "request: echo" in ran.out
    assert "no frame: noise\n  55" in ran.out


def test_garbage_of_a_named_protocol_is_noise(capsys: Capsys) -> None:
    ran = within(capsys, "explain", "01 02 03", "--protocol", "mightyzap")
    assert ran.status == 1
    assert ran.out.endswith("no frame: noise\n  01 02 03\n")


def test_a_line_of_lss_is_given_as_text(capsys: Capsys) -> None:
    ran = within(capsys, "explain", "#5D1800")
    assert (ran.status, ran.err) == (0, "")
    assert "request: D, servo 5" in ran.out
    assert "goal_position: raw 1800 = 180 deg" in ran.out


def test_a_frame_of_every_protocol_can_be_explained(capsys: Capsys) -> None:
    for frame in (ECHO, "FAAF01001E0401640064001A", "FF 01 00 01", "#5QD"):
        ran = within(capsys, "explain", frame)
        assert (ran.status, ran.err) == (0, ""), frame


def test_a_frame_that_is_cut_off_is_no_shorter_one_of_another_protocol_within_it(
    capsys: Capsys,
) -> None:
    ran = within(capsys, "explain", "FFFFFF0104F28C02")
    assert ran.status == 1
    assert ran.out.startswith("IRROBOT mightyZAP")
    assert "need: 9" in ran.out


def test_a_request_that_is_explained_alone_is_no_capture_that_ends(capsys: Capsys) -> None:
    assert "capture" not in within(capsys, "explain", "FFFFFF0104F28C027A").out


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ([__file__], f"{__file__} is a file: name a byte of it, as in {__file__}@12175"),
        (["zz"], "'zz': not hex digits; write bytes as FF FF FF 01 02 F1 0B"),
        (["FFF"], "'FFF': an odd number of hex digits"),
        ([""], "no bytes to explain"),
        (["01 02 03"], "cannot tell the protocol of these bytes: name it with --protocol"),
        ([ECHO, "--after", "xy"], "'xy': not hex digits"),
        ([ECHO, "--model", "nix"], "no model 'nix': one of lss, lss-pro, mightyzap-12lf"),
        ([ECHO, "--protocol", "nix"], "'nix' is not one of"),
        ([], "Missing argument 'HEX|"),
    ],
)
def test_what_cannot_be_explained_says_why(arguments: list[str], told: str, capsys: Capsys) -> None:
    ran = within(capsys, "explain", *arguments)
    assert (ran.status, ran.out) == (2, "")
    assert told in ran.complaint


# --- protocols and registers -------------------------------------------------------------------


def test_every_protocol_is_listed_with_its_models_and_rates(
    capsys: Capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    ran = within(capsys, "protocols")
    assert (ran.status, ran.err) == (0, "")
    assert max(map(len, ran.out.splitlines())) <= 80
    words = ran.out.replace(",", " ").split()
    for protocol in PROTOCOLS.values():
        assert {protocol.name, *(m.model for m in protocol.models)} <= set(words)
        assert {str(baud) for baud in protocol.bauds} <= set(words)
        assert f"{protocol.baud} (default)" in ran.out


MODELS = [m for p in PROTOCOLS.values() for m in p.models]


def test_every_model_is_listed(capsys: Capsys) -> None:
    lines = within(capsys, "registers").out.splitlines()
    assert [line.split()[:2] for line in lines] == [
        [m.model, str(len(m.registers))] for m in MODELS
    ]


@pytest.mark.parametrize("table", MODELS, ids=lambda m: str(m.model))
def test_a_register_table_shows_every_register_whole(
    table: RegisterMap, capsys: Capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    ran = within(capsys, "registers", table.model)
    assert (ran.status, ran.err) == (0, "")
    assert "…" not in ran.out
    lines = [line for line in ran.out.partition("\n\n")[2].splitlines() if line[:1] != " "]
    begin = lines[0].index("name")
    assert [line[begin:].split()[0] for line in lines[1:]] == [r.name for r in table.registers]
    for register in table.registers:
        for name in (*register.values.values(), *register.bits.values()):
            assert str(name) in " ".join(ran.out.split())


@pytest.mark.parametrize("table", MODELS, ids=lambda m: str(m.model))
def test_a_register_table_is_there_for_programs_too(table: RegisterMap, capsys: Capsys) -> None:
    ran = within(capsys, "registers", table.model, "--format", "jsonl")
    rows = [json.loads(line) for line in ran.out.splitlines()]
    assert [(r["name"], r["type"], r["unit"], r["scale"]) for r in rows] == [
        (r.name, r.type, r.unit, r.scale) for r in table.registers
    ]
    assert [(r["address"], r.get("word", "")) for r in rows] == [
        (r.address if r.address >= 0 else None, r.word) for r in table.registers
    ]


def test_an_unknown_model_says_which_there_are(capsys: Capsys) -> None:
    ran = within(capsys, "registers", "nix")
    assert (ran.status, ran.out) == (2, "")
    assert all(m.model in ran.complaint for m in MODELS)


def test_a_protocol_stands_for_the_registers_of_its_models(capsys: Capsys) -> None:
    ran = within(capsys, "registers", "mightyzap")
    assert ran.status == 0
    models = [m.model for m in PROTOCOLS["mightyzap"].models]
    heads = [line.split(":")[0] for line in ran.out.splitlines() if line.startswith("mightyzap-")]
    assert heads == models
    rows = within(capsys, "registers", "mightyzap", "--format", "jsonl").out.splitlines()
    assert list(dict.fromkeys(json.loads(row)["model"] for row in rows)) == models
    # lss is a model as well as a protocol: the model is meant
    assert within(capsys, "registers", "lss").out.startswith("lss: ")
    assert "did you mean mightyzap?" in within(capsys, "registers", "mightyzp").complaint
