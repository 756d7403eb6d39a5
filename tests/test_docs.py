"""The documentation is true: examples run, links lead somewhere, nothing is left out."""

from __future__ import annotations

import dataclasses
import importlib
import re
import tomllib
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import pytest

import sniffer
from sniffer.anomalies.catalogue import CATALOGUE
from sniffer.decoding.rows import AnomalyRow, FrameRow, GapRow, SampleRow, TransactionRow
from sniffer.decoding.summary import Summary
from sniffer.ground.model import Frames, Samples, Transactions
from sniffer.protocols import PROTOCOLS
from sniffer.sinks import SINKS
from sniffer.sinks.tables import FRAMES, SAMPLES
from sniffer.sources import SOURCES
from tests.test_readme import HINT
from tests.transcripts import PAGES, ROOT, Stage, agrees, is_run, shown

if TYPE_CHECKING:
    from pathlib import Path

    from sniffer.ground.columnar import Columns

DOCS = ROOT / "docs"
WRITTEN = sorted(
    [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", *DOCS.rglob("*.md")]
)
ROWS: tuple[Any, ...] = (FrameRow, GapRow, TransactionRow, SampleRow, AnomalyRow)
_LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")
_CODE = re.compile(r"`([^`]+)`")
_FENCED = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)


def text_of(name: str) -> str:
    return (DOCS / name).read_text(encoding="utf-8")


def section(text: str, title: str) -> str:
    """Return what stands under a heading, up to the next one of its rank."""
    found = re.search(rf"^(#+) {re.escape(title)}.*?$(.*?)(?=^#{{1,3}} |\Z)", text, re.M | re.S)
    assert found, f"no heading {title!r}"
    return found[2]


def in_code(text: str) -> set[str]:
    """Return every text that stands in backquotes, fenced blocks aside."""
    return set(_CODE.findall(_FENCED.sub("", text)))


def commands(name: str) -> set[str]:
    """Return the commands a protocol's grammar declares, and those of the manuals' examples."""
    grammar = importlib.import_module(f"sniffer.protocols.{name}.grammar")
    vectors = tomllib.loads((ROOT / "tests/vectors" / f"{name}.toml").read_text(encoding="utf-8"))
    out = {v["op"] for v in vectors["vector"] if v["verdict"] == "good"}
    table = getattr(grammar, "COMMANDS", None)
    if isinstance(table, Mapping):
        out |= {c.name for c in table.values()}
    ops = getattr(grammar, "OPS", ())
    out |= set(ops.values()) if hasattr(ops, "values") else {op.name for op in ops}
    for word in getattr(grammar, "WORDS", {}):
        out.add(word)
    return out | set(getattr(grammar, "MODIFIERS", {}))


def anchors(path: Path) -> set[str]:
    """Return the anchors of a page's headings, as GitHub makes them."""
    titles = re.findall(r"^#+ (.+)$", path.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", t.lower()).replace(" ", "-") for t in titles}


@pytest.mark.parametrize("page", [p for p in PAGES if p != "README.md"])
def test_every_example_runs_and_prints_what_the_page_says(page: str, tmp_path: Path) -> None:
    examples = [one for one in shown((ROOT / page).read_text(encoding="utf-8")) if is_run(one)]
    assert examples
    with Stage(tmp_path) as stage:
        for one in examples:
            got = stage.run(one)
            printed = f"{one.source}\nprints\n{chr(10).join(got)}\n{HINT}"
            assert stage.status in (0, 1), f"{stage.status}: {printed}"
            if one.told:
                assert agrees(one.output, got, live=one.live), printed


@pytest.mark.parametrize("page", WRITTEN, ids=lambda p: str(p.relative_to(ROOT)))
def test_every_link_leads_somewhere(page: Path) -> None:
    for target in _LINK.findall(page.read_text(encoding="utf-8")):
        if "://" in target:
            continue
        file, _, anchor = target.partition("#")
        there = (page.parent / file).resolve() if file else page
        assert there.is_relative_to(ROOT), target
        assert there.exists(), target
        if anchor:
            assert anchor in anchors(there), target


@pytest.mark.parametrize("name", PROTOCOLS)
def test_every_protocol_has_a_page_that_names_all_its_commands(name: str) -> None:
    page = text_of(f"protocols/{name}.md")
    assert commands(name) - in_code(page) == set()


@pytest.mark.parametrize("name", PROTOCOLS)
def test_every_page_of_a_protocol_has_its_sections(name: str) -> None:
    page = text_of(f"protocols/{name}.md")
    for title in ("Line", "Frames", "Commands", "Replies", "State", "Mistakes", "Limits"):
        assert section(page, title).strip()
    assert "\nSource" in page


@pytest.mark.parametrize("name", PROTOCOLS)
def test_every_page_of_a_protocol_names_rates_models_and_states(name: str) -> None:
    page = text_of(f"protocols/{name}.md")
    protocol = PROTOCOLS[name]
    for rate in protocol.bauds:
        assert str(rate) in section(page, "Line")
    for model in protocol.models:
        assert f"`{model.model}`" in page
    for bit in range(9):
        for status in protocol.status_names(1 << bit):
            if not re.fullmatch(r"bit\d+", status):
                assert status.upper() in page.upper()


@pytest.mark.parametrize("code", CATALOGUE)
def test_every_code_is_on_the_page_of_anomalies(code: str) -> None:
    assert f"`{code}`" in text_of("anomalies.md")


def test_every_code_a_page_names_exists() -> None:
    for page in WRITTEN:
        for found in in_code(page.read_text(encoding="utf-8")):
            if re.fullmatch(r"device-[a-z-]+|[a-z]+-(?:response|frame|checksum|form)", found):
                assert found in CATALOGUE, f"{page.name}: {found}"


@pytest.mark.parametrize("row", ROWS, ids=lambda r: str(r.type))
def test_every_key_of_the_json_lines_is_documented(row: Any) -> None:
    told = in_code(section(text_of("formats.md"), f"`{row.type}`"))
    assert {"type", *(f.name for f in dataclasses.fields(row))} - told == set()


def test_every_key_of_the_summary_is_documented() -> None:
    summary = Summary()
    capture = sniffer.decode(str(ROOT / "sample_captures/mightyzap_damaged.log"), "mightyzap")
    for bus, protocol, batch in capture.batches:
        summary.add(bus, protocol, batch)
    out = summary.as_dict()
    told = in_code(section(text_of("formats.md"), "`summary`"))
    assert set(out) | set(out["buses"]["bus0"]) <= told
    times = next(iter(out["buses"]["bus0"]["response_times_ns"].values()))
    assert set(times) <= told


@pytest.mark.parametrize("schema", [SAMPLES, FRAMES], ids=["samples", "frames"])
def test_every_column_of_the_tables_is_documented(schema: Any) -> None:
    assert set(schema.names) <= in_code(section(text_of("formats.md"), "Tables"))


def test_every_input_and_output_format_is_documented() -> None:
    formats, readme = text_of("formats.md"), (ROOT / "README.md").read_text(encoding="utf-8")
    assert set(SOURCES) <= in_code(section(formats, "Inputs"))
    assert set(SINKS) <= in_code(section(readme, "Outputs"))


def test_every_topic_of_a_recording_is_documented(tmp_path: Path) -> None:
    from mcap.reader import make_reader

    from sniffer.decoding.pipeline import Options, Pipeline
    from sniffer.sinks import open_sink
    from sniffer.sources import open_source

    path = tmp_path / "x.mcap"
    pipeline = Pipeline(Options(protocol="mightyzap"), [open_sink(path, {"tool": "test"})])
    for group in open_source(ROOT / "sample_captures/mightyzap_damaged.log"):
        pipeline.feed(group)
    pipeline.close()
    pipeline.finish()
    told = in_code(section(text_of("formats.md"), "Recordings"))
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
        assert summary is not None
        for channel in summary.channels.values():
            topic = re.sub(r"/servo/\w+/", "/servo/<id>/", channel.topic)
            assert topic.replace("/bus0/", "/<bus>/") in told
            assert summary.schemas[channel.schema_id].name in told


@pytest.mark.parametrize("columns", [Frames, Transactions, Samples], ids=lambda c: c.__name__)
def test_every_column_of_a_batch_is_documented(columns: type[Columns]) -> None:
    told = in_code(section(text_of("api.md"), "Batches and columns"))
    assert {f.name for f in dataclasses.fields(columns)} <= told


@pytest.mark.parametrize("name", [n for n in sniffer.__all__ if not n.startswith("__")])
def test_every_public_name_occurs_in_the_documentation(name: str) -> None:
    pages = [text_of("api.md"), text_of("design.md"), text_of("formats.md")]
    assert any(re.search(rf"\b{name}\b", page) for page in pages)


@pytest.mark.parametrize("page", WRITTEN, ids=lambda p: str(p.relative_to(ROOT)))
def test_no_page_names_a_machine(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert not re.search(r"(?<![\w.])/(?:home|root|work|tmp|Users)/", text)
