"""The register tables keep the rules that ``schemas/README.md`` gives their authors."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from sniffer.ground import registers
from sniffer.ground.model import SnifferError
from sniffer.ground.registers import Register, read_identity, read_table, schema_path
from sniffer.protocols import PROTOCOLS

if TYPE_CHECKING:
    from pathlib import Path

TABLES = sorted(p.stem for p in schema_path("registers").glob("*.toml"))
EVERY = pytest.mark.parametrize("model", TABLES)


def test_every_table_is_a_model_of_the_protocol_it_names() -> None:
    known = {m.model: p.name for p in PROTOCOLS.values() for m in p.models}
    assert known == {model: read_table(model)[0]["protocol"] for model in TABLES}


@EVERY
def test_the_head_of_a_table_names_file_people_and_source(model: str) -> None:
    head, _ = read_table(model)
    assert head["model"] == model
    assert head["title"]
    assert head["source"]


@EVERY
def test_what_identifies_a_model_is_a_register_it_has_and_values_no_other_model_has(
    model: str,
) -> None:
    told = read_identity(model)
    if told is None:
        return  # nothing on the wire names it
    register = next(r for r in read_table(model)[1] if r.name == told.register)
    assert bool(told.texts) == (register.type == "text")
    assert bool(told.texts) != bool(told.values)
    assert register.default is None or register.default in told.values
    assert register.values == {}  # the names come from the heads, they stand nowhere else
    others = [o for other in TABLES if other != model and (o := read_identity(other)) is not None]
    assert not [o for o in others if set(told.values) & set(o.values)]
    mine = (*told.texts, *told.begins)
    assert not [text for text in mine for o in others if o.is_text(text)]
    assert not [o for o in others for text in o.begins if text.startswith(told.begins or "-")]


def test_the_register_that_identifies_a_model_has_the_names_of_all_siblings() -> None:
    for model in PROTOCOLS["rs30x"].models:
        told = model.identity
        if told is not None:
            names = model.register(told.register).values
            assert names[0x3050] == "rs305cr"
            assert names[told.values[0]] == model.model
            assert len(names) == 6


@pytest.mark.parametrize("line", ['{ texts = ["X"] }', '{ register = "id", text = ["X"] }'])
def test_a_line_that_identifies_nothing_is_refused(
    line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "odd.toml").write_text(f"identifies = {line}\n")
    monkeypatch.setattr(registers, "schema_path", lambda *parts: tmp_path / parts[-1])
    with pytest.raises(SnifferError, match=r"odd\.toml: identifies"):
        read_identity("odd")


@EVERY
def test_names_are_unique_and_addresses_do_not_overlap(model: str) -> None:
    _, registers = read_table(model)
    names = [r.name for r in registers]
    assert len(set(names)) == len(names)
    taken = [r.address + k for r in registers if r.address >= 0 for k in range(r.width)]
    assert len(set(taken)) == len(taken)


@EVERY
def test_every_entry_has_a_source_and_its_default_lies_in_its_range(model: str) -> None:
    _, registers = read_table(model)
    by_name = {r.name: r for r in registers}
    for r in registers:
        assert r.source, r.name
        if r.default is not None and r.range is not None:
            assert r.range[0] <= r.default <= r.range[1] or r.default in r.special, r.name
        assert not r.on_with or r.on_with in by_name, r.name
        if r.scale_by is not None:
            assert r.scale_by[0] in by_name, r.name


@EVERY
def test_a_word_of_third_party_code_alone_is_doubted(model: str) -> None:
    _, registers = read_table(model)

    def unproved(r: Register) -> bool:
        return "third-party" in r.source or r.source.startswith(("not in", "client lib"))

    assert [r.name for r in registers if unproved(r) and not r.doubt] == []


def test_a_sibling_that_third_party_code_names_is_known_by_its_number() -> None:
    identities = {model: read_identity(model) for model in TABLES if model.startswith("rs")}
    numbers = {model: told.values if told else None for model, told in identities.items()}
    assert numbers["rs204md"] == (0x2040,)
    assert numbers["rs304md"] == (0x3040,)
    assert numbers["rs405cb"] is None  # no source states it
