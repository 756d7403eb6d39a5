"""What a register table of somebody else cannot say, and what is odd about it."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Final

import pytest

from sniffer.ground.entries import QUANTITIES, UNITS
from sniffer.ground.model import SnifferError
from sniffer.ground.registers import RegisterMap
from tests.commands import sniffer

if TYPE_CHECKING:
    from collections.abc import Sequence

HEAD: Final = 'model = "mine"\nprotocol = "mightyzap"\n'
ENTRY: Final = '[[register]]\nname = "x"\naddress = 0x10\nsource = "data sheet"\n'


def table(*lines: str, entry: str = ENTRY) -> RegisterMap:
    return RegisterMap.from_text(HEAD + entry + "\n".join(lines) + "\n", "mine.toml")


@pytest.mark.parametrize(
    ("lines", "told"),
    [
        (["scale = 0.0"], "a scale of 0, or of no number, gives no value"),
        (["scale = nan"], "a scale of 0, or of no number, gives no value"),
        (
            ['scale_by.register = "x"', 'scale_by.scale = { "1" = 0.0 }'],
            "a scale of 0, or of no number, gives no value",
        ),
        (["range = [10, 1]"], "range = [10, 1]: the lowest raw number comes first"),
        (["range = [1]"], "range = [1]: the lowest and the highest raw number"),
        (["range = [0.5, 2]"], "range = [0.5, 2]: the lowest and the highest raw number"),
        (["range = [0, 300]"], "range has 300, and a u8 is from 0 to 255"),
        (["range = [0, 9]", "default = 10"], "default = 10 is beyond its range, 0 to 9"),
        (["default = 300"], "default has 300, and a u8 is from 0 to 255"),
        (['default = "a"'], "default = 'a' is no whole number"),
        (['values = { "256" = "a" }'], "values has 256, and a u8 is from 0 to 255"),
        (['type = "i8"', 'special = { "255" = "a" }'], "special has 255, and a i8 is from -128"),
        (['bits = { "8" = "a" }'], "bits has 8, and a u8 has the bits 0 to 7"),
        (['bits = { "1" = "a" }', "alarms = [2]"], "alarms has 2, for which bits has no name"),
        (['values = { "1" = "a" }', "alarms = [2]"], "alarms has 2, for which values has no name"),
        (["alarms = [2]"], "alarms has 2, for which neither values nor bits has a name"),
        (['type = "i16le"', "sign_bit = 10"], "sign_bit goes with unsigned types"),
        (['type = "u16le"', "sign_bit = 16"], "sign_bit = 16, and a u16le has the bits 0 to 15"),
        (['access = "rx"'], "no access 'rx': one of r, rw, w"),
        (['volatile = "no"'], "volatile = 'no': true or false, without quotes"),
        (["unit = 3"], "unit = 3 is no text: write it in quotes"),
    ],
)
def test_what_an_entry_cannot_say_is_refused_in_a_sentence_that_names_it(
    lines: Sequence[str], told: str
) -> None:
    with pytest.raises(SnifferError, match=re.escape(f"mine.toml: register x: {told}")):
        table(*lines)


def test_a_register_that_ends_behind_the_last_address_is_refused() -> None:
    entry = ENTRY.replace("0x10", "0xFFFF")
    assert table(entry=entry).registers[0].address == 0xFFFF
    with pytest.raises(SnifferError, match="its 2 bytes from 0xFFFF on end behind 0xFFFF"):
        table('type = "u16le"', entry=entry)


def test_what_an_entry_may_say_is_taken() -> None:
    (register,) = table(
        'type = "u16le"',
        "sign_bit = 10",
        "scale = -0.1",
        "range = [0, 2047]",
        "default = 65535",
        'special = { "65535" = "off" }',
        'access = "w"',
    ).registers
    assert (register.access, register.default, register.range) == ("w", 65535, (0, 2047))


def test_what_is_odd_about_a_table_is_said_below_it_and_nobody_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    more = ENTRY.replace('"x"', '"y"').replace("0x10", "0x11").replace('source = "data sheet"', "")
    file.write_text(HEAD + ENTRY + 'unit = "A"\nquantity = "goal_pos"\n' + more, encoding="utf-8")
    ran = sniffer("registers", file)
    assert ran.status == 0
    assert "the unit 'A' is none that is known: one of mm, deg," in ran.err
    assert (
        "the quantity 'goal_pos', so it is shown and not diagnosed: did you mean goal_p" in ran.err
    )
    assert "mine: y: no source says where the manual has it" in ran.err


def test_units_and_quantities_are_those_of_the_rules_for_authors() -> None:
    rules = (Path(__file__).parents[1] / "schemas" / "README.md").read_text(encoding="utf-8")
    units = rules.partition("### Units\n")[2].partition(", or")[0]
    quantities = rules.partition("### Quantities\n")[2].partition(". What")[0]
    assert tuple(re.findall("`([^`]+)`", units)) == UNITS
    assert set(re.findall("`([^`]+)`", quantities)) == set(QUANTITIES)
