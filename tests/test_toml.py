"""Register tables are read line by line where that is enough, as tomllib reads them."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Final

import pytest

from sniffer.ground.registers import schema_path
from sniffer.ground.toml import quick

ROOT: Final = Path(__file__).parents[1]
TABLES: Final = sorted(
    (*schema_path("registers").glob("*.toml"), *ROOT.glob("examples/protocols/*/*-*.toml"))
)


@pytest.mark.parametrize("path", TABLES, ids=lambda p: p.name)
def test_a_table_is_read_line_by_line_as_the_standard_library_reads_it(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert repr(quick(text)) == repr(tomllib.loads(text))


@pytest.mark.parametrize(
    "text",
    [
        'model = "a"\n\n[[register]]\nname = "x" # why\naddress = 0x1F\nrange = [-1, 255]\n',
        "a = {}\nb = []\nc = 1e-3\nd = -0\ne = 1.50\nf = true\ng = false",
        'special = { "1" = "on # off", "-1" = "x = y" } # what "they" mean',
        'scale_by.scale = { "1" = 0.5 }\nscale_by.register = "mode"',
        'identifies = { register = "number", values = [0x10, 2], begins = ["A", "B"] }',
    ],
)
def test_what_tables_are_made_of_needs_nothing_else(text: str) -> None:
    assert repr(quick(text)) == repr(tomllib.loads(text))


@pytest.mark.parametrize(
    "text",
    [
        "a = 1\na = 2",  # twice
        'a = "x\\ty"',
        "a = 'x'",
        'a = """x"""',
        "a = [1,\n2]",
        "a = [1 2]",
        'a = { "x" = 1, }',
        "a = 007",
        "a = 1_000",
        "a = 1979-05-27",
        "[head]\na = 1",
        "a = 1\r\n",
        "a=1",
        'a = "\x01"',
        "nonsense",
    ],
)
def test_what_is_not_plain_is_left_to_the_standard_library(text: str) -> None:
    assert quick(text) is None
