"""What one can wish of ``sniffer simulate``: faults, servos, and what is refused."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import pytest

from sniffer.ground.model import SnifferError
from sniffer.simulation import Fault
from sniffer.simulation.faults import FAULTS, SPELLED, USUAL, read_fault
from tests.commands import within
from tests.simulations import running, told

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("drop-reply:3:5%", Fault("drop", 0.05, 3)),
        ("drop", Fault("drop", USUAL["drop"])),
        ("flip:0.1%", Fault("flip", 0.001)),
        ("late:2", Fault("late", USUAL["late"], 2)),
        ("duplicate-id:4", Fault("duplicate", 1.0, 4)),
        ("brownout", Fault("brownout", USUAL["brownout"])),
        ("cut", Fault("cut", USUAL["cut"])),
        ("Noise:100%", Fault("noise", 1.0)),
        ("flip:1%@2s", Fault("flip", 0.01, None, 2.0)),
        ("late:2@500ms+1.5s", Fault("late", USUAL["late"], 2, 0.5, 2.0)),
        ("stall:2", Fault("stall", USUAL["stall"], 2)),
        ("stall:2@5s+3s", Fault("stall", 1.0, 2, 5.0, 8.0)),
        ("stall:1%@5", Fault("stall", 0.01, None, 5.0)),
    ],
)
def test_faults_are_spelled_kind_servo_rate_when(text: str, fault: Fault) -> None:
    read = read_fault(text)
    assert (read.kind, read.servo_id) == (fault.kind, fault.servo_id)
    assert read.rate == pytest.approx(fault.rate)
    assert (read.first_s, read.last_s) == pytest.approx((fault.first_s, fault.last_s))


@pytest.mark.parametrize(
    "text",
    ["", "nothing", "drop:", "drop:5%:3", "flip:200%", "flip:0%", "late:x", "late@x", "late@5s+0s"],
)
def test_a_fault_that_makes_no_sense_is_refused_in_one_line(
    text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SnifferError):
        read_fault(text)
    ran = within(capsys, "simulate", "lss", "--fault", text)
    assert (ran.status, ran.out) == (2, "")
    if text in ("", "nothing"):
        assert all(name in ran.complaint for name in ("drop-reply", "duplicate-id", "brownout"))


def test_every_kind_of_fault_has_a_name_and_a_usual_rate() -> None:
    assert set(SPELLED.values()) == set(FAULTS) == set(USUAL)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("mightyzap", "--fault", "duplicate-id:4"), "duplicate-id:4: .*only 1, 2, 3$"),
        (("rs30x", "--servos", "0"), "the ids 1..127"),
        (("mightyzap", "--model", "lss"), "is none of the mightyzap models: mightyzap-l12, "),
        (("mightyzap", "--model", "9=mightyzap-12lf"), "not on the bus, only 1, 2, 3$"),
        (("lss", "--fault", "flip::1%"), "with its colon: write flip:1%$"),
        (("lss", "--fault", "drop:5%:3"), "the servo comes first: write drop:3:5%$"),
        (("lss", "--fault", "late:x"), "write late, late:2 .*, late:1% .* or late:2:1%$"),
        (("lss", "--fault", "cut:2:5"), "a rate ends in %: write cut:2:5%$"),
        (("lss", "--fault", "flipp"), "did you mean flip"),
        (("lss", "--fault", "dead:2@soon"), "write when as dead:2@5s .* or dead:2@5s\\+2s"),
        (("lss", "--fault", "hang:2"), "the controller's, name no servo"),
        (("lss", "--fault", "refuse"), "nothing on a lss bus would show that"),
        (("lss", "--respond", "--fault", "nv-wear"), "plays no controller: --fault nv-wear"),
        (("wck", "--servos", "32"), "room for 1..31"),
        (("wck", "--servos", "one"), "write ids as 1,2,5"),
        (("wck", "--servos", "3-1"), "write the lower id first, as in 3-6"),
        (("wck", "--servos", "250-255"), "wck has the ids 0..253"),
        (("wck", "--servos", "0-99999999"), "is not in the range"),
        (("lss", "--rate", "0"), "write a number of 1..100000, or max"),
        (("lss", "--rate", "9" * 5000), r"'9{30}\.\.\.': write a number of 1..100000, or max"),
        (("lss", "--respond", "--full"), "plays no controller"),
        (("lss", "--tap-link", "x"), "needs --respond"),
        (("lss", "--respond", "--no-tap", "--tap-link", "x"), "leave --no-tap out"),
        (("lss", "--port", "/dev/null", "--link", "x"), "has a name already"),
        (("lss", "--port", "/dev/null", "--yes-transmit"), "is no serial port"),
        (("lss", "--port", "/dev/null"), "servos may move; --yes-transmit if that is meant"),
        (("lss", "--yes-transmit"), "--yes-transmit goes with --port"),
        (("lss", "--port", "/dev/nothing"), "cannot be opened"),
        (("lss", "--truth", "/dev/nothing/truth"), "there is no folder"),
        (("nothing",), "mightyzap"),
    ],
)  # fmt: skip
def test_a_wish_that_cannot_be_is_told_in_one_line(
    arguments: tuple[str, ...], complaint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    ran = within(capsys, "simulate", *arguments)
    assert ran.status == 2
    assert ran.out == ""
    assert re.search(complaint, ran.complaint)


def test_a_folder_that_is_there_is_not_said_to_be_missing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    truth = tmp_path / "truth.jsonl"
    truth.symlink_to(tmp_path / "nowhere" / "truth.jsonl")
    ran = within(capsys, "simulate", "lss", "--truth", str(truth))
    assert (ran.status, ran.out) == (2, "")
    assert f"{truth}: cannot be written (No such file or directory)" in ran.complaint


@pytest.mark.parametrize(
    ("name", "wish", "servos"),
    [
        ("wck", "3", [0, 1, 2]),
        ("lss", "2", [1, 2]),
        ("rs30x", "9,3", [3, 9]),
        ("mightyzap", "7,", [7]),
        ("mightyzap", "0", [0]),
        ("wck", "0,40", [0, 40]),
        ("lss", "2-4,7", [2, 3, 4, 7]),
    ],
)
def test_servos_are_named_or_counted(
    name: str, wish: str, servos: list[int], tmp_path: Path
) -> None:
    truth = tmp_path / "truth.jsonl"
    with running(name, "--servos", wish, "--duration", "300ms", "--truth", truth) as it:
        it.end()
    rows = told(truth)
    assert rows[0]["servos"] == servos
    answered = {row["servo_id"] for row in rows[1:-1] if row["kind"] == "response"}
    assert answered <= set(servos)
    assert min(servos) in answered
