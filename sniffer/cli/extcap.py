"""What Wireshark's capture interface runs: it asks for the options, then it captures.

``python -m sniffer.cli.extcap``, called by the program that ``sniffer wireshark install`` writes
(``wireshark/files/extcap``). Contract: Wireshark Developer's Guide, 8.2, Adding Capture Interfaces
And Log Sources Using Extcap. Standard output is answers; errors are a line on standard error and a
status that is not 0; SIGTERM, or that nobody reads the pipe any more, is how a capture ends.
"""

from __future__ import annotations

import argparse
import datetime
import io
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from sniffer.cli.statuses import DONE, MISTAKE
from sniffer.cli.streams import say
from sniffer.ground.limits import BAUDS
from sniffer.ground.model import SnifferError
from sniffer.protocols import PROTOCOLS
from sniffer.protocols.registry import AUTO

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

BUS: Final = "servo-bus"
"""The interface, and so the bus."""

FOLDER: Final = "servo-captures"
"""Where in the user's home captures are recorded, if nobody says where."""


def main(arguments: Sequence[str]) -> int:
    """Answer one call of Wireshark."""
    parser = argparse.ArgumentParser(prog=BUS, allow_abbrev=False)
    for flag in ("--extcap-config", "--capture", "--no-recording"):
        parser.add_argument(flag, action="store_true")
    for option in ("--extcap-reload-option", "--fifo", "--port", "--path", "--recording"):
        parser.add_argument(option, default="")
    parser.add_argument("--protocol", default=AUTO)
    parser.add_argument("--baud", type=int, default=0)
    told, _ = parser.parse_known_args(arguments)  # what newer ones ask for as well is left alone
    try:
        if told.capture:
            return _capture(told)
        for line in _options(told.extcap_reload_option):
            click.echo(line)
    except KeyboardInterrupt:
        return DONE  # before there was anything to capture
    except SnifferError as error:
        say(str(error))
        return MISTAKE
    return DONE


def _options(reloaded: str) -> Iterator[str]:
    """Yield the options that the dialogue asks for; of one that is looked up again its values."""
    where = f"~/{FOLDER}"
    if not reloaded:
        yield from (
            _arg(0, "port", "selector", "Serial port", group="Bus", reload="true"),
            _arg(1, "path", "string", "Or another", group="Bus", tooltip="Any port by its path"),
            _arg(2, "protocol", "selector", "Protocol", group="Bus", tooltip="auto: told by bytes"),
            _arg(
                3, "baud", "unsigned", "Baud rate", group="Bus", range=f"0,{BAUDS[1]}", default="0"
            )
            + "{tooltip=0: looked for}",
            _arg(4, "recording", "fileselect", "Record to", group="Recording", mustexist="false")
            + f"{{fileext=MCAP (*.mcap)}}{{tooltip=Left empty: a file of its own in {where}}}",
            _arg(5, "no-recording", "boolflag", "No recording", group="Recording", default="false"),
        )
        for name in (AUTO, *PROTOCOLS.built_in):
            yield _value(2, name, name, is_default=name == AUTO)
    if reloaded in ("", "port"):
        from sniffer.ports.listing import ports

        found = ports()
        for nth, port in enumerate(found):
            words = " ".join(filter(None, (port.path, port.product, port.chip)))
            yield _value(0, port.path, words, is_default=nth == 0)
        if not found:
            yield _value(0, "", "no serial port found", is_default=True)


def _arg(number: int, name: str, kind: str, title: str, **more: str) -> str:
    head = f"arg {{number={number}}}{{call=--{name}}}{{display={title}}}{{type={kind}}}"
    return head + "".join(f"{{{key}={value}}}" for key, value in more.items())


def _value(number: int, value: str, words: str, *, is_default: bool) -> str:
    shown = words.replace("{", "(").replace("}", ")")
    default = "true" if is_default else "false"
    return f"value {{arg={number}}}{{value={value}}}{{display={shown}}}{{default={default}}}"


def _capture(told: argparse.Namespace) -> int:
    """Record what a port says, and write it into the pipe, until nobody reads it any more."""
    from sniffer.cli.signals import signals
    from sniffer.decoding.options import Options
    from sniffer.jobs.files import Files
    from sniffer.jobs.outputs import session_facts
    from sniffer.jobs.record import Shown, record
    from sniffer.jobs.telling import Teller
    from sniffer.pcapfile.sink import PcapngSink
    from sniffer.tap.recorder import Wishes
    from sniffer.tap.tap import PortSpec
    from sniffer.wireshark.fifo import opened

    port = told.path or told.port
    if not port:
        raise SnifferError("choose a serial port, or give the path of one, in the options of it")
    if not told.fifo:
        raise SnifferError("Wireshark gave no --fifo to write to")
    slowest, fastest = BAUDS
    if told.baud and not slowest <= told.baud <= fastest:
        raise SnifferError(f"--baud {told.baud}: {slowest} to {fastest}, or 0: it is looked for")
    if told.protocol != AUTO and told.protocol not in PROTOCOLS:
        raise SnifferError(f"--protocol: there is no {told.protocol[:40]!r}")
    options = Options(protocol=told.protocol, baud=told.baud or None)
    recording = recording_of(told.recording, is_wanted=not told.no_recording)
    wishes = Wishes()
    with signals(wishes):

        def hung_up() -> None:
            wishes.stop = wishes.stop or "Wireshark"

        with io.BufferedWriter(opened(Path(told.fifo), hung_up)) as fifo:
            wishes.is_heard = "://" not in port
            sink = PcapngSink(fifo, session_facts(port, options))
            sink.begin()
            done = record(
                [PortSpec(BUS, port)],
                Files(recording),
                options,
                shown=Shown(None),
                sinks=[sink],
                wishes=wishes,
                tell=Teller(say, quiet=True),
            )
    return MISTAKE if done.failure is not None or done.gone else DONE


def recording_of(said: str, *, is_wanted: bool) -> Path | None:
    """Return where it is recorded; nothing is overwritten.

    A folder, or nothing said, gets a file that says when. So does a file that is there already:
    Wireshark hands on what was said once, capture after capture.
    """
    if not is_wanted:
        return None
    now = f"{datetime.datetime.now():%Y%m%d-%H%M%S}"
    path = Path(said) if said else Path.home() / FOLDER
    if said and not path.is_dir():
        file = path if path.suffix else path.with_suffix(".mcap")
        return file.with_stem(f"{file.stem}-{now}") if file.exists() else file
    path.mkdir(exist_ok=True)
    return path / f"servo-{now}.mcap"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
