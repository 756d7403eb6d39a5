"""Object stores: captures are read from one, and a data set in one is right whatever is refused."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import pyarrow.parquet as pq
import pytest

import sniffer
from sniffer.fleet.inputs import find_captures
from sniffer.fleet.objects import AT_ONCE, find_objects, send_object
from sniffer.fleet.rows import UndoneError
from sniffer.fleet.store import Store
from tests.commands import damaged, log, talk, within
from tests.fleets import content, serial
from tests.stores import ObjectServer, copied, serving

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

Capsys = pytest.CaptureFixture[str]


@pytest.fixture(scope="module")
def server() -> Iterator[ObjectServer]:
    with serving() as server:
        yield server


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A capture that all tables have something of."""
    path = tmp_path_factory.mktemp("capture") / "run.log"
    path.write_text(log(talk(4)) + log(damaged(talk(8))), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def local(capture: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """What is made of it on a disk."""
    data = tmp_path_factory.mktemp("local") / "data"
    assert serial(capture, data).is_whole
    held = content(data)
    assert len(held) == 5
    return held


def tables(held: dict[str, str]) -> dict[str, str]:
    return {name: digest for name, digest in held.items() if name.endswith(".parquet")}


def test_captures_and_data_set_in_an_object_store_are_what_they_are_on_a_disk(
    server: ObjectServer,
    capture: Path,
    local: dict[str, str],
    tmp_path: Path,
    capsys: Capsys,
) -> None:
    there = "s3://bucket/in/100% of it?/a b.log"  # no URI has such a path
    send_object(find_objects(there), capture)
    server.requests.clear()
    ran = within(capsys, "fleet", "s3://bucket/in", "-o", "s3://bucket/out", "--workers", "1")
    assert ran.err == ""
    assert ran.status == 0
    written = [path for method, path in server.requests if method == "PUT"]
    held = copied("s3://bucket/out", tmp_path / "out")
    assert tables(content(held)) == tables(local)
    assert pq.read_table(held / "captures.parquet").column("path").to_pylist() == [there]
    assert len(written) == len(local) + 1  # the list of captures; each file in one request

    server.requests.clear()
    ran = within(capsys, "fleet", "s3://bucket/in/**/*.log", "-o", "s3://bucket/out")
    assert ran.out == "1 capture: 1 ok (0 decoded, 1 there already)\n"
    folders = find_captures(["s3://bucket/i*"], Store.of("s3://bucket/out")).captures
    assert [capture.uri for capture in folders] == [there]
    assert not [path for method, path in server.requests if method == "PUT"]
    assert not [path for _, path in server.requests if "a b.log" in path]


def test_a_capture_that_is_replaced_while_it_is_copied_is_copied_again(
    server: ObjectServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    there, file = find_objects("s3://bucket/replaced/a.log"), tmp_path / "next"
    lengths = iter(range(4, 40))

    def replaced() -> None:
        file.write_text(log(talk(next(lengths))), encoding="utf-8")
        send_object(there, file)

    fetch, left = Store.fetch, 0

    def slowly(store: Store, path: str, folder: Path) -> Path:
        nonlocal left
        copy = fetch(store, path, folder)
        if left:
            left -= 1
            replaced()
        return copy

    monkeypatch.setattr(Store, "fetch", slowly)
    monkeypatch.setattr("sniffer.fleet.task.SENT_AT_ONCE", 0)  # it comes with many requests
    for left, statuses in ((1, {"ok": 1}), (9, {})):
        replaced()
        done = serial("s3://bucket/replaced", tmp_path / f"{left}")
        assert done.statuses == statuses
    assert "it is changed again and again while it is copied" in done.reasons[0]
    (row,) = pq.read_table(tmp_path / "1" / "captures.parquet").to_pylist()
    assert row["bytes"] == len(log(talk(5)))


def nth_write(nth: int) -> Callable[[str, str], bool]:
    writes = itertools.count()
    return lambda method, path: method == "PUT" and next(writes) == nth


def test_whichever_write_is_refused_the_next_run_completes_the_data_set(
    server: ObjectServer, capture: Path, local: dict[str, str], tmp_path: Path
) -> None:
    nth = 0
    while True:
        data = f"s3://bucket/refused{nth}"
        server.refuses = nth_write(nth)
        done = serial(capture, data)
        server.refuses = lambda method, path: False
        if done.is_whole:
            break
        assert "refused" in done.reasons[0]
        held = content(copied(data, tmp_path / f"{nth}-first"))
        assert held.items() <= local.items()
        assert held == local or not any(name.startswith("_done/") for name in held)
        assert serial(capture, data).is_whole
        held = content(copied(data, tmp_path / f"{nth}-second"))
        assert held == local
        assert (tmp_path / f"{nth}-second" / "captures.parquet").exists()
        nth += 1
    assert nth == len(local) + 1


def test_whichever_write_of_a_copy_is_refused_the_next_one_completes_it(
    server: ObjectServer, capture: Path, tmp_path: Path
) -> None:
    assert serial(capture, "s3://bucket/whole").is_whole
    serial(capture, tmp_path / "data")
    sniffer.compact_fleet(tmp_path / "data", tmp_path / "compact")
    wanted = tables(content(tmp_path / "compact"))
    nth = 0
    while True:
        copy = f"s3://bucket/compact{nth}"
        server.refuses = nth_write(nth)
        told = ""
        try:
            sniffer.compact_fleet("s3://bucket/whole", copy)
        except UndoneError as error:
            told = str(error)
        server.refuses = lambda method, path: False
        if not told:
            break
        assert "refused" in told
        held = content(copied(copy, tmp_path / f"{nth}-first"))
        assert held.items() <= wanted.items()
        done = sniffer.compact_fleet("s3://bucket/whole", copy)
        assert done.written == len(wanted) - nth or nth == len(wanted)
        assert content(copied(copy, tmp_path / f"{nth}-second")) == wanted
        nth += 1
    assert nth == len(wanted) + 1
    server.requests.clear()
    sniffer.compact_fleet("s3://bucket/whole", "s3://bucket/compact0")
    got = [path for method, path in server.requests if method == "GET" and ".parquet" in path]
    assert {path.rpartition("/")[2].partition("?")[0] for path in got} == {"captures.parquet"}


def test_an_upload_that_is_refused_half_way_leaves_what_was_there(
    server: ObjectServer, tmp_path: Path
) -> None:
    small, big = tmp_path / "small", tmp_path / "big"
    small.write_bytes(b"what was there")
    big.write_bytes(bytes(AT_ONCE + 1))
    place = find_objects("s3://bucket/upload/x")
    store = Store.of("s3://bucket/upload")
    send_object(place, small)
    for part in ("partNumber=1&", "partNumber=2&"):  # of an upload without parts arrow makes one

        def refuses(method: str, path: str, part: str = part) -> bool:
            return part in path or (method == "POST" and "uploadId=" in path)

        server.refuses = refuses
        with pytest.raises(OSError, match="refused"):
            send_object(place, big)
        server.refuses = lambda method, path: False
        assert [file.path for file in store.files()] == ["x"]
        assert store.get_bytes("x") == b"what was there"
    send_object(place, big)
    assert [(file.path, file.size) for file in store.files()] == [("x", AT_ONCE + 1)]


def test_a_place_that_is_none_is_told_in_a_line(
    server: ObjectServer, good: Path, tmp_path: Path, capsys: Capsys
) -> None:
    ran = within(capsys, "fleet", good, "-o", "nowhere://bucket/out")
    assert ran.status == 2
    assert ran.complaint.startswith("nowhere://bucket/out: no place for files (")
    ran = within(capsys, "fleet", good, "-o", "s3://nobody/out")
    assert ran.status == 2
    assert ran.complaint.startswith("s3://nobody/out: cannot be written (there is no bucket nobody")
    for nothing in ("s3://nobody/in", "s3://bucket/none"):
        ran = within(capsys, "fleet", nothing, "-o", tmp_path / "data")
        assert ran.status == 2
        assert ran.complaint.startswith(f"{nothing}: there are no captures: ")
    server.refuses = lambda method, path: method == "GET"
    ran = within(capsys, "fleet", "s3://bucket/in", "-o", tmp_path / "data")
    server.refuses = lambda method, path: False
    assert ran.status == 2
    assert ran.complaint.startswith("s3://bucket/in: cannot be read (")
