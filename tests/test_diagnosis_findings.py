"""What rules find of servos, beside joints: each where it is, and not where it only looks so."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from sniffer.ground.model import Chunk, Clock
from tests.diagnosed import codes, diagnosed, verdicts
from tests.servos import finding, heard, lss, mightyzap_read, mightyzap_write

if TYPE_CHECKING:
    from sniffer.diagnosis import Diagnosis

VOLTAGE, TEMPERATURE, POSITION, FORCE, ID = 0x92, 0x93, 0x8C, 0x80, 0x03


def volts(*levels: float, servo_id: int = 1, every: float = 0.1) -> list[tuple[float, bytes]]:
    """Read a supply voltage over and over."""
    return [
        row
        for k, level in enumerate(levels)
        for row in mightyzap_read(
            servo_id, servo_id / 100 + k * every, VOLTAGE, bytes([round(level * 10)])
        )
    ]


def in_time(*parts: list[tuple[float, bytes]]) -> list[tuple[float, bytes]]:
    return sorted(row for part in parts for row in part)


def test_a_supply_that_breaks_down_for_a_moment_is_a_brownout() -> None:
    d = heard(volts(*[12.1] * 40, 8.0, 7.8, 8.2, *[12.0] * 40), "mightyzap")
    assert verdicts(d.incidents()) == [("brownout", (1,))]
    told = finding(d, "voltage-sag")
    assert told is not None
    assert "7.8 V at least" in told.what


def test_a_supply_that_is_measured_low_time_after_time_is_a_brownout_whatever_else_is_lost() -> (
    None
):
    # four answers are missing with the supply in order before them, as a bad contact has it
    levels = [12.1] * 60 + [6.9] * 12
    said = enumerate(volts(*levels, every=0.05))
    rows = [row for i, row in said if i not in {21, 23, 61, 63}]
    d = heard(rows, "mightyzap")
    told = finding(d, "supply-stays-low")
    assert told is not None
    assert "12 times in a row" in told.what
    assert ("brownout", (1,)) in verdicts(d.incidents())


def test_a_supply_that_is_low_now_and_then_does_not_stay_low() -> None:
    d = heard(volts(*[12.1, 12.1, 12.0, 7.8] * 12), "mightyzap")
    assert "voltage-sag" in codes(d)
    assert "supply-stays-low" not in codes(d)


def test_what_wires_lose_under_load_is_no_brownout() -> None:
    d = heard(volts(*[12.1, 11.2, 11.5] * 30), "mightyzap")
    assert "voltage-sag" not in codes(d)


def test_a_supply_that_is_a_fifth_lower_while_all_motors_start_at_once_is_no_brownout() -> None:
    levels = (9.5, 9.5, *[12.0] * 60)
    parts = [volts(*levels, servo_id=i) for i in range(1, 9)]
    d = heard(in_time(*parts), "mightyzap")
    assert "voltage-sag" in codes(d)
    assert not d.incidents()


def test_what_the_end_of_a_line_has_less_of_while_all_start_is_none_if_it_is_seldom_asked() -> None:
    # eight servos of a sound robot, asked every 0.2 s, as a bench of sound traffic had them
    lost = (0.97, 0.96, 0.95, 0.92, 0.89, 0.87, 0.85, 0.815)
    parts = [
        volts(12.0 * part, 12.0 * (part + 0.05), *[12.0] * 60, servo_id=i, every=0.2)
        for i, part in enumerate(lost, 1)
    ]
    assert not heard(in_time(*parts), "mightyzap").incidents()


@pytest.mark.parametrize("levels", [(9.5,) * 10, (8.5,)])
def test_a_supply_that_is_lower_for_longer_or_deeper_than_motors_take_to_start_is_one(
    levels: tuple[float, ...],
) -> None:
    d = heard(volts(*[12.0] * 40, *levels, *[12.0] * 40), "mightyzap")
    assert verdicts(d.incidents()) == [("brownout", (1,))]


def test_a_supply_that_sags_for_all_servos_at_once_is_one_incident() -> None:
    levels = (*[12.1] * 40, 8.0, 7.8, 8.2, *[12.0] * 40)
    d = heard(in_time(*[volts(*levels, servo_id=i) for i in (1, 2, 3)]), "mightyzap")
    assert verdicts(d.incidents()) == [("brownout", (1, 2, 3))]


def test_a_servo_that_has_less_than_its_peers_all_the_time_has_a_weak_supply() -> None:
    parts = [volts(*[level] * 40, servo_id=i) for i, level in ((1, 12.0), (2, 11.9), (3, 9.0))]
    d = heard(in_time(*parts), "mightyzap")
    assert verdicts(d.incidents()) == [("brownout", (3,))]


def test_one_low_value_without_a_checksum_is_doubt_and_no_brownout() -> None:
    said = [(k * 0.2, f"#5QV *5QV{9000 if k == 20 else 11900}") for k in range(60)]
    d = lss(*said)
    assert "voltage-sag" in codes(d)
    assert not d.incidents()


def degrees(*levels: int) -> list[tuple[float, bytes]]:
    return [
        row
        for k, level in enumerate(levels)
        for row in mightyzap_read(1, k * 0.2, TEMPERATURE, bytes([level]))
    ]


def test_a_servo_at_its_limit_of_temperature_is_too_hot() -> None:
    d = heard(degrees(*range(40, 82), *[81] * 10), "mightyzap")
    assert verdicts(d.incidents()) == [("overheat", (1,))]
    assert {"temperature-high", "temperature-rising"} <= codes(d)


def test_a_servo_that_warms_with_its_work_is_not() -> None:
    d = heard(degrees(*[30 + k // 25 for k in range(200)]), "mightyzap")
    assert not codes(d)


def test_how_fast_a_servo_warms_is_not_told_without_a_clock() -> None:
    """Bytes without times say how much warmer it is, and nothing of how soon."""
    rows = degrees(*[34 + k // 100 for k in range(2500)])
    d = diagnosed([Chunk(b"".join(data for _, data in rows))], "mightyzap")
    assert not d.incidents()
    assert d.sentence().endswith("seconds count bytes, no pauses")


def test_a_temperature_that_jumps_and_comes_back_is_none() -> None:
    said = [(k * 0.2, f"#5QT *5QT{900 if k == 20 else 350}") for k in range(60)]
    d = lss(*said)
    assert "doubtful-value" in codes(d)
    assert not codes(d) & {"temperature-high", "temperature-rising"}
    assert not d.incidents()


def test_the_goal_before_an_alarm_is_told_with_it() -> None:
    goal = mightyzap_write(1, 1.95, 0x86, (3000).to_bytes(2, "little"))
    calm = [row for k in range(40) for row in mightyzap_read(1, k * 0.05, POSITION, b"\0\x04")]
    alarm = [
        row for k in range(20) for row in mightyzap_read(1, 2 + k * 0.05, POSITION, b"\0\x04", 0x20)
    ]
    d = heard(in_time(calm, [(1.957, goal[1])], alarm), "mightyzap")
    told = finding(d, "device-overload")
    assert told is not None
    assert "its goal was 21.98 mm" in told.what
    assert told.brief == "servo 1 reports an overload"


def refused(times: int) -> list[tuple[float, bytes]]:
    out = []
    for k in range(times):
        out += mightyzap_read(1, k * 0.1, POSITION, b"\0\x04")
        out += [mightyzap_write(1, k * 0.1 + 0.02, 0x0E, b"\xff\x07")]
        out += [mightyzap_read(1, k * 0.1 + 0.02, 0, b"", 0x08)[1]]
    return out


def test_a_command_that_is_refused_time_and_again_is_named() -> None:
    d = heard(refused(20), "mightyzap")
    assert verdicts(d.incidents()) == [("servo-refuses", (1,))]
    told = finding(d, "refuses-command")
    assert told is not None
    assert "max_force" in told.what


def test_a_command_that_is_refused_once_is_no_incident() -> None:
    assert not heard(refused(1), "mightyzap").incidents()


def registers(written: bool, *, restart: bool = False) -> list[tuple[float, bytes]]:
    """Read the force and what follows: on and set, then off and at its default."""
    on, off = bytes([1, 4, 8, 8]), bytes([0, 0, 4, 4])
    out = [mightyzap_write(1, 0.0, FORCE, on)]
    for k in range(20):
        out += mightyzap_read(1, 0.1 + k * 0.1, FORCE, on)
    if restart:
        out += [(2.05, b"\xff\xff\xff\x01\x02\xf8\x04")]
    if written:
        out += [mightyzap_write(1, 2.05, FORCE, off)]
    for k in range(20):
        out += mightyzap_read(1, 2.1 + k * 0.1, FORCE, off)
    return out


def test_registers_at_their_defaults_that_nobody_wrote_tell_of_a_restart() -> None:
    d = heard(registers(written=False), "mightyzap")
    assert {"back-at-defaults", "torque-gone"} <= codes(d)
    assert verdicts(d.incidents()) == [("servo-reset-loop", (1,))]


@pytest.mark.parametrize("how", ["written", "restart"])
def test_registers_that_were_written_or_reset_by_command_tell_nothing(how: str) -> None:
    d = heard(registers(written=how == "written", restart=how == "restart"), "mightyzap")
    assert not codes(d) & {"back-at-defaults", "torque-gone"}
    assert not d.incidents()


def test_goals_behind_a_torque_that_was_switched_off_are_named_with_the_frame_that_did_it() -> None:
    out = [mightyzap_write(1, 0.0, FORCE, b"\1"), mightyzap_write(1, 1.0, FORCE, b"\0")]
    for k in range(100):
        out.append(mightyzap_write(1, 1.5 + k * 0.05, 0x86, (1000 + 20 * k).to_bytes(2, "little")))
        out += mightyzap_read(1, 1.52 + k * 0.05, POSITION, b"\0\x02")
    d = heard(in_time(out), "mightyzap")
    assert verdicts(d.incidents()) == [("torque-off", (1,))]
    told = finding(d, "goals-without-torque")
    assert told is not None
    assert told.places[0].offset == 9
    assert "switched off at 1.001 s" in told.what


@pytest.mark.parametrize("follows", [False, True], ids=["nobody looks", "it follows"])
def test_a_force_that_the_next_goal_switches_on_is_not_missed(follows: bool) -> None:
    """So 12Lf IR Protocol, 2.4.6.1, has it: clients of the maker never switch it on themselves."""
    out = [mightyzap_write(1, 0.0, FORCE, b"\1"), mightyzap_write(1, 1.0, FORCE, b"\0")]
    for k in range(100):
        goal = (1000 + 20 * k).to_bytes(2, "little")
        out.append(mightyzap_write(1, 1.5 + k * 0.05, 0x86, goal))
        where = goal if follows else b"\1"
        out += mightyzap_read(1, 1.52 + k * 0.05, POSITION if follows else 0x81, where)
    d = heard(in_time(out), "mightyzap")
    assert "goals-without-torque" not in codes(d)
    assert not d.incidents()


def test_a_torque_that_is_switched_off_at_the_end_is_no_incident() -> None:
    goals = [(1000 + 20 * k).to_bytes(2, "little") for k in range(40)]
    out = [mightyzap_write(1, 0.0, FORCE, b"\1")]
    out += [mightyzap_write(1, 0.5 + k * 0.05, 0x86, goal) for k, goal in enumerate(goals)]
    out += [mightyzap_write(1, 3.0, FORCE, b"\0")]
    out += [row for k in range(40) for row in mightyzap_read(1, 3.1 + k * 0.1, POSITION, b"\0\x02")]
    assert not heard(out, "mightyzap").incidents()


def asked(
    servo_id: int, *, since: float, until: float, answered: bool = True
) -> list[tuple[float, str]]:
    reply = f" *{servo_id}QD100" if answered else ""
    n = round((until - since) / 0.1)
    return [(since + k * 0.1 + servo_id / 1000, f"#{servo_id}QD{reply}") for k in range(n)]


def test_an_old_id_that_is_asked_still_is_named_with_the_new_one() -> None:
    d = lss(
        *asked(2, since=0, until=6),
        *asked(5, since=0, until=2),
        (2.05, "#5CID7"),
        *asked(5, since=2.2, until=6, answered=False),
    )
    assert verdicts(d.incidents()) == [("id-changed", (5,))]
    told = finding(d, "old-id-asked")
    assert told is not None
    assert "given the id 7" in told.what


def test_an_id_that_is_given_to_all_is_named_for_each_that_is_silent_since() -> None:
    d = lss(
        *asked(2, since=0, until=2),
        *asked(5, since=0, until=2),
        (2.05, "#254CID7"),
        *asked(2, since=2.2, until=6, answered=False),
        *asked(5, since=2.2, until=6, answered=False),
    )
    assert verdicts(d.incidents()) == [("id-changed", (2, 5))]


def test_an_id_that_was_changed_and_is_used_is_no_incident() -> None:
    d = lss(
        *asked(2, since=0, until=6),
        *asked(5, since=0, until=2),
        (2.05, "#5CID7"),
        *asked(7, since=2.2, until=6),
    )
    assert not d.incidents()


def test_a_mightyzap_whose_old_id_is_asked_still_is_named_too() -> None:
    def look(servo_id: int, t: float) -> list[tuple[float, bytes]]:
        return mightyzap_read(servo_id, t, POSITION, b"\0\x02")

    out = [row for k in range(40) for row in look(2, 0.05 + k * 0.1)]
    out += [row for k in range(15) for row in look(1, k * 0.1)]
    out += [mightyzap_write(1, 1.51, ID, b"\x09")]
    out += [look(1, 1.6 + k * 0.1)[0] for k in range(24)]
    assert verdicts(heard(in_time(out), "mightyzap").incidents()) == [("id-changed", (1,))]


def test_a_servo_that_is_silent_since_it_was_told_another_rate_is_named() -> None:
    d = lss(
        *asked(2, since=0, until=6),
        *asked(5, since=0, until=2),
        (2.05, "#5CB9600 #5RESET"),
        *asked(5, since=2.2, until=6, answered=False),
    )
    assert verdicts(d.incidents()) == [("baud-changed", (5,))]


def test_a_scan_for_servos_is_no_asking_of_absent_ones() -> None:
    scan = [(0.05 * k, f"#{k}QID" + (f" *{k}QID{k}" if k in (3, 9) else "")) for k in range(1, 40)]
    later = [(t + 3, line) for t, line in scan] + [(t + 6, line) for t, line in scan]
    d = lss(*scan, *later, *[(t + 9, line) for t, line in scan], *[(t + 12, x) for t, x in scan])
    assert "never-answered" not in codes(d)


def test_a_servo_that_never_answers_in_the_loop_is_absent() -> None:
    d = lss(*asked(2, since=0, until=5), *asked(4, since=0, until=5, answered=False))
    assert verdicts(d.incidents())[0] == ("servo-absent", (4,))


def test_single_losses_of_everybody_are_nobodys_absence() -> None:
    said = [x for i in (2, 3, 4) for x in asked(i, since=0, until=20)]
    lost = [
        (t, line.split()[0])
        if round(t * 1000) % 1700 == 2 or round(t * 1000) % 1900 == 3
        else (t, line)
        for t, line in said
    ]
    away = {"away-for-a-while", "away-again-and-again", "misses-now-and-then"}
    assert not codes(lss(*lost)) & away


def test_slowness_is_not_told_where_there_is_no_clock() -> None:
    rows = []
    for k in range(60):
        for i, takes in ((1, 0.0005), (2, 0.0005), (3, 0.006)):
            request, (_, answer) = mightyzap_read(i, k * 0.1 + i / 100, POSITION, b"\0\x02")
            rows += [request, (request[0] + takes + 0.002, answer)]
    assert verdicts(heard(rows, "mightyzap").incidents()) == [("slow-servo", (3,))]
    # stamps, and nobody stated the rate: when answers end tells it, too
    assert verdicts(heard(rows, "mightyzap", Clock.NONE).incidents()) == [("slow-servo", (3,))]
    bare = [Chunk(data) for _, data in rows]
    assert not diagnosed(bare, "mightyzap").incidents()


def test_late_answers_of_one_servo_are_told() -> None:
    said = []
    for k in range(40):
        asks = 0.05 + k * 0.3
        said += [(k * 0.3, "#2QD *2QD100"), (asks, "#5QD"), (asks + 0.17, "*5QD100")]
    d = lss(*said)
    assert {"late-replies", "slower-than-peers"} <= codes(d)
    assert verdicts(d.incidents()) == [("slow-servo", (5,))]


def test_an_answer_that_nobody_asked_for_is_a_lost_request_unless_it_comes_again() -> None:
    calm = [*asked(2, since=0, until=8), *asked(5, since=0, until=8)]
    d = lss(*calm, *[(1.05 + k, "*2QD100") for k in range(6)])
    assert verdicts(d.incidents()) == [("chatty-device", (2,))]
    assert not lss(*calm, (3.05, "*2QD100")).incidents()


def saving(*spells: tuple[float, float], also: tuple[tuple[float, str], ...] = ()) -> Diagnosis:
    """Ask an LSS for its status; it is in safe mode in these spells."""
    said = [
        (k * 0.2, f"#5Q *5Q{10 if any(a <= k * 0.2 < b for a, b in spells) else 6}")
        for k in range(150)
    ]
    return lss(*said, *also)


def test_a_servo_that_leaves_safe_mode_by_itself_within_moments_had_no_supply_and_no_fever() -> (
    None
):
    d = saving((4.0, 5.0), (12.0, 13.2))
    assert "saved-briefly" in codes(d)
    assert verdicts(d.incidents()) == [("brownout", (5,))]


@pytest.mark.parametrize(
    ("spells", "also"),
    [
        ([(4.0, 16.0), (18.0, 29.5)], ()),
        ([(4.0, 5.0)], ()),
        ([(4.0, 5.0), (12.0, 13.2)], ((4.9, "#5RESET"), (13.1, "#5RESET"))),
        ([(4.0, 5.0), (12.0, 13.2)], ((3.9, "#5QT *5QT820"), (5.9, "#5QT *5QT821"))),
    ],
    ids=["cools-down", "once", "was-restarted", "is-hot"],
)
def test_safe_mode_that_heat_may_explain_is_not_over_too_soon_for_it(
    spells: list[tuple[float, float]], also: tuple[tuple[float, str], ...]
) -> None:
    assert "saved-briefly" not in codes(saving(*spells, also=also))
