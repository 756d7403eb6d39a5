"""Amounts and ports as people write them on a command line."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click
import pytest

from sniffer.cli.amounts import Duration, Size, port_spec, port_specs, sizes_and_times
from sniffer.tap.tap import PortSpec

if TYPE_CHECKING:
    from pathlib import Path

CONTEXT = click.Context(click.Command("record"))
ROTATE = click.Option(["--rotate"])


@pytest.mark.parametrize(
    ("text", "seconds"),
    [
        ("90", 90),
        ("90s", 90),
        ("90 s", 90),
        (".5", 0.5),
        ("1.5min", 90),
        ("2m", 120),
        ("10sec", 10),
        ("250ms", 0.25),
        ("2h", 7200),
        ("1d", 86400),
    ],
)
def test_a_time_is_a_number_with_a_unit_or_in_seconds(text: str, seconds: float) -> None:
    assert Duration()(text) == seconds * 1e9


@pytest.mark.parametrize(
    ("text", "size"),
    [
        ("512", 512),
        ("512b", 512),
        ("512MB", 512_000_000),
        ("512mb", 512_000_000),
        ("1.5 kB", 1500),
        ("2GiB", 2 << 30),
        ("1TB", 10**12),
        ("10K", 10_000),
        ("3M", 3_000_000),
    ],
)
def test_a_size_is_a_number_with_a_unit_or_in_bytes(text: str, size: int) -> None:
    assert Size()(text) == size


@pytest.mark.parametrize(
    "text", ["", "s", "-1", "0", "1e5", "ten", "5 years", "1,5", "1MB", "1M", "nan", "9" * 400]
)
def test_what_is_no_time_is_refused(text: str) -> None:
    with pytest.raises(click.BadParameter, match="is no time: write it like 90s"):
        Duration()(text)


@pytest.mark.parametrize("text", ["", "MB", "-1", "0", "0.4", "10min", "10m", "5 PB", "9" * 400])
def test_what_is_no_size_is_refused(text: str) -> None:
    with pytest.raises(click.BadParameter, match="is no size: write it like 512MB"):
        Size()(text)


def test_a_limit_of_a_file_is_a_size_or_a_time_or_one_of_each() -> None:
    assert sizes_and_times(CONTEXT, ROTATE, ()) == {}
    assert sizes_and_times(CONTEXT, ROTATE, ("512MB",)) == {"bytes": 512_000_000}
    assert sizes_and_times(CONTEXT, ROTATE, ("10m", "5M")) == {
        "ns": 600_000_000_000,
        "bytes": 5_000_000,
    }
    for wrong in (("10",), ("much",), ("1MB", "ten")):
        with pytest.raises(click.BadParameter, match="is no size or time"):
            sizes_and_times(CONTEXT, ROTATE, wrong)
    with pytest.raises(click.BadParameter, match="one size and one time at most"):
        sizes_and_times(CONTEXT, ROTATE, ("1MB", "2MB"))


@pytest.mark.parametrize(
    ("text", "spec"),
    [
        ("/dev/ttyUSB0", ("bus0", "/dev/ttyUSB0", None, None)),
        ("/dev/ttyUSB0=wck", ("bus0", "/dev/ttyUSB0", "wck", None)),
        ("/dev/ttyUSB0@9600", ("bus0", "/dev/ttyUSB0", None, 9600)),
        ("/dev/ttyUSB0=wck@9600", ("bus0", "/dev/ttyUSB0", "wck", 9600)),
        ("left=/dev/ttyUSB0", ("left", "/dev/ttyUSB0", None, None)),
        ("left=/dev/ttyUSB0=auto@115200", ("left", "/dev/ttyUSB0", "auto", 115200)),
        ("left=COM3=lss", ("left", "COM3", "lss", None)),
        ("COM3=wck", ("bus0", "COM3", "wck", None)),
        ("left=COM3", ("left", "COM3", None, None)),
        ("adapter", ("bus0", "adapter", None, None)),
        ("wck", ("bus0", "wck", None, None)),
        (
            "/dev/serial/by-path/pci-0000:00:14.0-usb-0:1:1.0-port0=rs30x",
            ("bus0", "/dev/serial/by-path/pci-0000:00:14.0-usb-0:1:1.0-port0", "rs30x", None),
        ),
        ("socket://host:4000", ("bus0", "socket://host:4000", None, None)),
        ("a=socket://h:1=lss@115200", ("a", "socket://h:1", "lss", 115200)),
        ("a=socket://h:1?logging=debug", ("a", "socket://h:1?logging=debug", None, None)),
        ("socket://user@h:1", ("bus0", "socket://user@h:1", None, None)),
    ],
)
def test_a_port_may_have_a_name_a_protocol_and_a_baud_rate(
    text: str, spec: tuple[str, str, str | None, int | None]
) -> None:
    assert port_spec(text, "bus0") == PortSpec(*spec)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("/dev/ttyUSB0=frob", "no protocol 'frob': one of auto, mightyzap, lss, rs30x, wck"),
        ("left=/dev/ttyUSB0=frob@9600", "no protocol 'frob'"),
        ("/dev/ttyUSB0=", r"write \[NAME=\]PORT"),
        ("left=", r"write \[NAME=\]PORT"),
        ("=wck", "there is no port in it"),
        ("left==wck", "there is no port in it"),
        ("@9600", "there is no port in it"),
        ("", "there is no port in it"),
        ("/dev/ttyUSB0@299", r"299 is no baud rate \(300..10000000\)"),
        ("/dev/ttyUSB0=wck@99999999999", "99999999999 is no baud rate"),
    ],
)
def test_what_is_no_port_is_refused_with_the_reason(text: str, why: str) -> None:
    with pytest.raises(click.BadParameter, match=why) as caught:
        port_spec(text, "bus0")
    assert caught.value.message.startswith(f"{text!r}: ")


def test_ports_without_a_name_are_numbered(tmp_path: Path) -> None:
    def buses(*given: str) -> list[str]:
        return [spec.bus for spec in port_specs(CONTEXT, ROTATE, given)]

    assert buses("/dev/a", "leg=/dev/b", "/dev/c") == ["bus0", "leg", "bus2"]
    link = tmp_path / "link"
    link.symlink_to("/dev/null")
    for given, why in (
        (("/dev/a", "/dev/a=wck"), "/dev/a is named twice"),
        (("/dev/null", str(link)), f"{link} is named twice, as /dev/null too"),
        (("a=/dev/a", "a=/dev/b"), "two ports are called a"),
        (("/dev/a", "bus0=/dev/b"), "two ports are called bus0"),
    ):
        with pytest.raises(click.BadParameter) as caught:
            buses(*given)
        assert caught.value.message.startswith(why)
