"""``sniffer layout``: what Foxglove shows of a recording, held to what the recording has."""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING, Any

import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from sniffer.mcapfile.layout import ATTACHED, layout
from tests.commands import within
from tests.lists import each_in_turn, in_turn
from tests.recordings import record, talk
from tests.test_convert import CAPTURES, LOG, Capsys
from tests.test_mcap_live import live

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

PATH = re.compile(r'(?:"((?:[^"\\]|\\.)+)"|([A-Za-z0-9_/-]+))(?:\.(\w+))?')
"""A path as Foxglove reads it: a topic, in quotes where it has other signs, and a field."""


def printed(capsys: Capsys, path: Path) -> dict[str, Any]:
    done = within(capsys, "layout", path)
    assert (done.status, done.err) == (0, "")
    made: dict[str, Any] = json.loads(done.out)
    return made


def attached(path: Path) -> dict[str, Any] | None:
    with path.open("rb") as stream:
        found = [a for a in make_reader(stream).iter_attachments() if a.name == ATTACHED]
    assert len(found) <= 1
    assert all(a.media_type == "application/json" for a in found)
    return json.loads(found[0].data) if found else None


def said(path: Path) -> dict[str, set[str]]:
    """Return which fields the messages of each topic have somewhere."""
    out: dict[str, set[str]] = {}
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        for _, channel, _, message in reader.iter_decoded_messages():
            fields = {f.name for f in message.DESCRIPTOR.fields if not f.has_presence}
            fields |= {f.name for f, _ in message.ListFields()}
            out.setdefault(channel.topic, set()).update(fields)
    return out


def paths(made: dict[str, Any]) -> Iterator[tuple[str, str | None]]:
    """Yield topic and field of all paths in a layout."""
    for panel in made["configById"].values():
        for one in (*panel.get("paths", ()), {"value": panel.get("topicPath")}):
            if one["value"]:
                found = PATH.fullmatch(one["value"])
                assert found, one["value"]
                yield (found[2] or re.sub(r"\\(.)", r"\1", found[1])), found[3]
        if "topicToRender" in panel:
            yield panel["topicToRender"], None


def in_window(part: Any) -> list[str]:
    """Return the panels that share the window."""
    if isinstance(part, str):
        return [part]
    assert part.keys() == {"direction", "first", "second", "splitPercentage"}
    assert 0 < part["splitPercentage"] < 100
    return [*in_window(part["first"]), *in_window(part["second"])]


@in_turn(2)
@pytest.mark.parametrize("capture", ["mightyzap_damaged.log", "wck_clean.log"])
@pytest.mark.parametrize("options", [(), ("--topics", "flat,log")], ids=["all", "flat"])
def test_every_path_of_a_layout_leads_to_something_that_the_recording_has(
    tmp_path: Path, capsys: Capsys, capture: str, options: tuple[str, ...]
) -> None:
    run = tmp_path / "run.mcap"
    within(capsys, "convert", CAPTURES / capture, run, *options)
    made, there = printed(capsys, run), said(run)
    assert made == attached(run)
    found = list(paths(made))
    assert len(found) > 5
    for topic, field in found:
        assert topic in there, topic
        assert field is None or field in there[topic], (topic, field)
    assert sorted(in_window(made["layout"])) == sorted(made["configById"])
    kinds = {name.partition("!")[0] for name in made["configById"]}
    assert kinds >= ({"Plot"} if options else {"Plot", "Table"})
    assert "Plot!response_time" in made["configById"]


def test_panels_have_the_keys_that_foxglove_itself_writes(tmp_path: Path, capsys: Capsys) -> None:
    keys = pytest.importorskip("foxglove.layouts", reason="foxglove-sdk is not installed")
    run = tmp_path / "run.mcap"
    within(capsys, "convert", LOG, run)
    configs = {
        "Plot": (keys.PlotConfig(), keys.PlotSeries(value="")),
        "StateTransitions": (keys.StateTransitionsConfig(), keys.StateTransitionsSeries(value="")),
        "RosOut": (keys.LogConfig(), None),
        "Table": (keys.TableConfig(), None),
    }
    made = printed(capsys, run)
    assert {name.partition("!")[0] for name in made["configById"]} == configs.keys()
    for name, panel in made["configById"].items():
        config, series = configs[name.partition("!")[0]]
        titles = {"foxglovePanelTitle", "lichtblickPanelTitle"}
        assert panel.keys() - titles <= config._to_dict().keys()
        for one in panel.get("paths", ()):
            assert one.keys() <= series._to_dict().keys()


def test_buses_are_told_apart_and_odd_names_quoted_and_servos_called_by_their_names() -> None:
    topics = ["/arm/servo/1/state", '/a.b "c"/servo/1/state']
    fields = ("position_deg", "goal_position_deg")
    made = layout(topics, dict.fromkeys(topics, fields), {1: "hip"})
    assert made is not None
    (plot,) = made["configById"].values()
    assert plot["foxglovePanelTitle"] == "Position [deg]"
    assert {(p["label"], p["value"]) for p in plot["paths"]} == {
        ("arm hip", "/arm/servo/1/state.position_deg"),
        ("arm hip goal", "/arm/servo/1/state.goal_position_deg"),
        ('a.b "c" hip', r'"/a.b \"c\"/servo/1/state".position_deg'),
        ('a.b "c" hip goal', r'"/a.b \"c\"/servo/1/state".goal_position_deg'),
    }
    assert {topic for topic, _ in paths(made)} == {*topics}


def test_what_a_live_recording_does_not_index_is_not_listed(tmp_path: Path, capsys: Capsys) -> None:
    run, whole = tmp_path / "run.mcap", tmp_path / "whole.mcap"
    live(run, talk("mightyzap")).close()
    made = printed(capsys, run)
    assert made == attached(run)
    assert {t.rpartition("/")[2] for t, _ in paths(made)} & {"transactions", "frames"} == set()
    assert "Table!anomalies_of_bus0" in made["configById"]
    within(capsys, "convert", run, whole)
    assert "Table!transactions_of_bus0" in printed(capsys, whole)["configById"]


@each_in_turn(2, "how", [{}, {"size": 1, "flush_ns": 0}])
def test_a_recording_that_was_cut_off_has_one_too(
    how: dict[str, int], tmp_path: Path, capsys: Capsys
) -> None:
    run, cut = tmp_path / "run.mcap", tmp_path / "cut.mcap"
    live(run, talk("mightyzap", 1.0), **how).close()
    whole = run.read_bytes()  # how much is in which chunk depends on the machine: all chunks stay
    summary_at = int.from_bytes(whole[-28:-20], "little")
    cut.write_bytes(whole[:summary_at])
    made = printed(capsys, cut)
    assert made.keys() == printed(capsys, run).keys()
    assert set(paths(made)) <= set(paths(printed(capsys, run)))
    assert any(field == "position_mm" for _, field in paths(made))


def test_a_recording_of_raw_bytes_has_nothing_to_show(tmp_path: Path, capsys: Capsys) -> None:
    run = tmp_path / "raw.mcap"
    record(run, "mightyzap", talk("mightyzap", 0.2), topics=["raw"])
    assert attached(run) is None
    done = within(capsys, "layout", run)
    assert (done.status, done.out) == (2, "")
    assert "has nothing that viewers show: `sniffer convert" in done.complaint


@pytest.mark.parametrize("name", ["mightyzap_clean.log", "missing.mcap"])
def test_what_is_no_recording_is_refused_with_what_to_do(capsys: Capsys, name: str) -> None:
    done = within(capsys, "layout", CAPTURES / name)
    assert (done.status, done.out) == (2, "")
    assert ("convert" in done.complaint) == name.endswith(".log")


def test_a_folder_and_a_file_that_is_not_there_are_told_as_everywhere(
    tmp_path: Path, capsys: Capsys
) -> None:
    said = [within(capsys, "layout", path) for path in (tmp_path, tmp_path / "no.mcap")]
    assert [(done.status, done.out) for done in said] == [(2, ""), (2, "")]
    assert [done.complaint for done in said] == [
        f"{tmp_path} is a directory: give the recording in it",
        f"{tmp_path / 'no.mcap'}: there is no such file",
    ]


def test_an_empty_recording_is_said_to_be_empty(tmp_path: Path, capsys: Capsys) -> None:
    (tmp_path / "none.mcap").touch()
    done = within(capsys, "layout", tmp_path / "none.mcap")
    assert done.status == 2
    assert done.complaint.endswith("none.mcap is empty: there is nothing to show")
