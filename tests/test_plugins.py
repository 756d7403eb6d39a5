"""Protocols that packages and files bring: found by every command, and harmless where broken."""

from __future__ import annotations

import subprocess
import sys
from typing import TYPE_CHECKING, cast

import pytest

from sniffer.ground.model import SnifferError
from sniffer.ground.registers import RegisterMap, load_models, schema_path
from sniffer.protocols import PROTOCOLS, protocol_named
from sniffer.protocols.tables import with_tables
from tests.commands import environment
from tests.lists import in_turn
from tests.plugin import NAME, PACKAGE, install, table, write_facts, write_module

if TYPE_CHECKING:
    from pathlib import Path

    from sniffer.protocols.base import BusProtocol


def python(code: str, env: dict[str, str]) -> subprocess.CompletedProcess[str]:
    """Run a line in an interpreter of its own."""
    return subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        env=environment(**env),
        check=False,
    )


# --- listing and loading -----------------------------------------------------------------------


def test_the_built_in_protocols_come_first_and_are_a_mapping() -> None:
    assert list(PROTOCOLS)[:4] == ["mightyzap", "lss", "rs30x", "wck"]
    assert PROTOCOLS.built_in == ("mightyzap", "lss", "rs30x", "wck")
    assert PROTOCOLS["lss"] is PROTOCOLS["lss"] is protocol_named("lss")
    assert [p.name for p in PROTOCOLS.values()] == [name for name, _ in PROTOCOLS.items()]
    assert "nix" not in PROTOCOLS
    with pytest.raises(KeyError):
        PROTOCOLS["nix"]


def test_names_of_plug_ins_are_listed_without_importing_any(tmp_path: Path) -> None:
    env = install(tmp_path)
    code = (
        "import sys; from sniffer import PROTOCOLS; print(*PROTOCOLS, len(PROTOCOLS)); "
        f"assert {NAME!r} not in sys.modules; assert 'sniffer.protocols.lss' not in sys.modules; "
        f"print(PROTOCOLS[{NAME!r}].title, PROTOCOLS.origin({NAME!r}))"
    )
    ran = python(code, env)
    assert ran.stdout.splitlines() == [
        f"mightyzap lss rs30x wck {NAME} 5",
        f"Toy servos {PACKAGE}",
    ], ran.stderr


def test_without_plug_ins_the_library_that_finds_them_is_not_even_loaded() -> None:
    code = (
        "import sys; from sniffer import PROTOCOLS; list(PROTOCOLS); "
        "print('importlib.metadata' in sys.modules)"
    )
    assert python(code, {}).stdout == "False\n"


BROKEN = {
    "importing": ("it_breaks:PROTOCOL", "1 / 0", "ZeroDivisionError: division by zero (it_breaks"),
    "leaving": ("it_breaks:PROTOCOL", "raise SystemExit(7)", "SystemExit: 7"),
    "missing": ("not_there:PROTOCOL", "", "ModuleNotFoundError: No module named 'not_there'"),
    "nothing": ("it_breaks:PROTOCOL", "", "has no attribute 'PROTOCOL'"),
    "older": ("it_breaks:PROTOCOL", "class PROTOCOL: ...\nPROTOCOL = PROTOCOL()", "no interface"),
    "class": ("it_breaks:PROTOCOL", "class PROTOCOL: interface = 1", "PROTOCOL is a class"),
    "later": (
        "it_breaks:PROTOCOL",
        "class P: interface = 2\nPROTOCOL = P()",
        "it says interface = 2, this program has interface = 1",
    ),
    "lacking": (
        "it_breaks:PROTOCOL",
        "class P: interface = 1\nPROTOCOL = P()",
        "it lacks name, ",
    ),
    "otherwise": ("toyservo:PROTOCOL", "", "it calls itself 'toyservo'"),
    "lss": ("it_breaks:PROTOCOL", "", "that name is taken by a built-in one"),
    "auto": ("it_breaks:PROTOCOL", "", "that name is taken by a built-in one"),
    "a b": ("it_breaks:PROTOCOL", "", "a name is made of"),
}


@in_turn(2)
@pytest.mark.parametrize("name", BROKEN)
def test_a_plug_in_that_cannot_be_used_is_told_in_one_warning_and_left_out(
    name: str, tmp_path: Path
) -> None:
    value, code, told = BROKEN[name]
    install(tmp_path)
    write_facts(tmp_path, f"{name} = {value}", package="sniffer-broken 0.1")
    (tmp_path / "it_breaks.py").write_text(code, encoding="utf-8")
    ran = python(
        "import warnings; warnings.simplefilter('always')\n"
        "from sniffer import PROTOCOLS\n"
        "for _ in range(2): print(*[p.name for p in PROTOCOLS.values()])\n"
        "print(*[p.name for p in PROTOCOLS.candidates()])",
        {"PYTHONPATH": str(tmp_path)},
    )
    assert ran.stdout.splitlines() == [f"mightyzap lss rs30x wck {NAME}"] * 3, ran.stderr
    (line,) = [row for row in ran.stderr.splitlines() if "PluginWarning" in row]
    assert f"the plug-in {name!r} of sniffer-broken 0.1 is left out: " in line
    assert told in line
    assert "Traceback" not in ran.stderr


def test_of_two_plug_ins_of_one_name_the_first_counts(tmp_path: Path) -> None:
    env = install(tmp_path)
    write_facts(tmp_path, f"{NAME} = other:PROTOCOL", package="sniffer-tzervo 1")
    ran = python("import sniffer; print(*sniffer.PROTOCOLS)", env)
    assert ran.stdout == f"mightyzap lss rs30x wck {NAME}\n"
    assert f"'{NAME}' of sniffer-tzervo 1 is left out: {PACKAGE} has that name, too" in ran.stderr


def test_a_plug_in_that_does_not_say_so_is_no_candidate_of_detection(tmp_path: Path) -> None:
    write_module(tmp_path / NAME, behind="PROTOCOL.interface = 1\nPROTOCOL.auto = False\n")
    write_facts(tmp_path, f"{NAME} = {NAME}:PROTOCOL")
    code = "from sniffer import PROTOCOLS; print(*[p.name for p in PROTOCOLS.candidates()])"
    ran = python(code, {"PYTHONPATH": str(tmp_path)})
    assert ran.stdout == "mightyzap lss rs30x wck\n", ran.stderr


# --- tables ------------------------------------------------------------------------------------


def test_a_table_is_read_from_any_file_and_keeps_its_text(tmp_path: Path) -> None:
    path = tmp_path / "toy-b.toml"
    path.write_text(table("toy-b"), encoding="utf-8")
    got = RegisterMap.from_toml(path)
    assert (got.model, got.protocol, got.title) == ("toy-b", NAME, "Toy servo")
    assert got.text == table("toy-b")
    assert got.register("angle").scale == 0.5
    (same,) = load_models(path)
    assert same.registers == got.registers


def test_the_tables_that_are_built_in_keep_their_text_too() -> None:
    for protocol in PROTOCOLS.values():
        for model in protocol.models:
            file = schema_path("registers", f"{model.model}.toml")
            assert model.text.encode() == file.read_bytes()
            assert model.protocol == protocol.name


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('model = "toy-a"', "model =", "Invalid value"),
        ('model = "toy-a"', "model = 7", "no name of a model: '7'"),
        ('model = "toy-a"', 'model = "../x"', "no name of a model"),
        ('"u16le"\nunit', '"u17le"\nunit', "register goal_position: no type 'u17le': one of u8"),
        ('role = "commanded"', 'role = "told"', "register goal_position: no role 'told'"),
        ('name = "angle"', "", "register 2: it has no name"),
        ('name = "angle"', 'name = "supply"', "register supply: there are two of that name"),
        ("0x92", "0x8D", "register supply: it overlaps angle"),
        ("0x92", "-7", "register supply: no address -7"),
        ("0x92", '"x"', "register supply: no address 'x'"),
        ("[[register]]\nname = \"supply\"", "[[regster]]", "there is no key 'regster'"),
        ("unit = \"V\"", "units = \"V\"", "register supply: there is no key 'units'"),
        ("unit = \"V\"", "range = [1]", "register supply: "),
        ("unit = \"V\"", "values = { x = 1 }", "register supply: "),
        (
            "unit = \"V\"",
            'scale_by = { register = "mode", scale = { 0 = 1 } }',
            "register supply: no register mode to select its scale",
        ),
    ],
)  # fmt: skip
def test_a_line_that_cannot_be_understood_is_told_with_its_file_and_register(
    old: str, new: str, told: str, tmp_path: Path
) -> None:
    path = tmp_path / "toy.toml"
    text = table()
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(SnifferError) as error:
        RegisterMap.from_toml(path)
    assert str(error.value).startswith(f"{path}: ")
    assert told in str(error.value)
    assert "\n" not in str(error.value)


def test_a_table_that_is_no_file_or_no_text_is_told(tmp_path: Path) -> None:
    with pytest.raises(SnifferError, match=r"nix\.toml: cannot be read"):
        RegisterMap.from_toml(tmp_path / "nix.toml")
    with pytest.raises(SnifferError, match="is a directory: give the file in it"):
        RegisterMap.from_toml(tmp_path)
    (tmp_path / "odd.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(SnifferError, match="text in UTF-8"):
        RegisterMap.from_toml(tmp_path / "odd.toml")


@pytest.mark.parametrize("name", ["mightyzap", "rs30x"])
def test_a_protocol_with_addresses_takes_further_models(name: str) -> None:
    protocol = PROTOCOLS[name]
    own = RegisterMap.from_text(table("toy-m", name), "toy-m.toml")
    more = with_tables(protocol, [own, RegisterMap.from_text(table(), "toy-a.toml")])
    assert [m.model for m in more.models] == [*(m.model for m in protocol.models), "toy-m"]
    first = len(protocol.registers)
    assert more.models[-1].first == first
    assert more.registers[first].model == "toy-m"
    assert protocol is PROTOCOLS[name]
    assert "toy-m" not in [m.model for m in protocol.models]


def test_a_table_that_a_protocol_cannot_take_is_told() -> None:
    own = RegisterMap.from_text(table("toy-m", "lss"), "toy-m.toml")
    with pytest.raises(SnifferError, match="toy-m: lss takes no further tables"):
        with_tables(PROTOCOLS["lss"], [own])


def test_what_a_protocol_has_against_a_table_is_told_in_one_line() -> None:
    class Choosy:
        name = "choosy"
        models = ()

        def with_models(self, tables: object) -> None:
            raise TypeError("two tables\ndiffer")

    own = RegisterMap.from_text(table("toy-m", "choosy"), "toy-m.toml")
    with pytest.raises(SnifferError, match=r"toy-m: choosy: two tables.differ"):
        with_tables(cast("BusProtocol", Choosy()), [own])


def test_a_model_that_is_there_is_not_taken_twice() -> None:
    taken = RegisterMap.from_text(table("mightyzap-12lf", "mightyzap"), "x.toml")
    with pytest.raises(SnifferError, match="mightyzap has a model mightyzap-12lf: name the one"):
        with_tables(PROTOCOLS["mightyzap"], [taken])
