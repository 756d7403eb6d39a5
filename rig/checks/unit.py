"""The systemd unit, installed as its head says; in a machine that systemd has booted."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Final

from rig.checks.hearing import BY_ID
from rig.listening import talk
from tests.recorder import heard

if TYPE_CHECKING:
    from rig.machine import Machine
    from rig.report import Report

UNIT: Final = "sniffer-record@arm"
INSTALL: Final = f"""
useradd --system --no-create-home --shell /usr/sbin/nologin sniffer
install -D -m 644 /src/docs/sniffer-record@.service /etc/systemd/system/sniffer-record@.service
mkdir -p /etc/sniffer
echo 'PORTS=arm={BY_ID}=mightyzap@57600' > /etc/sniffer/arm.conf
echo 'OPTIONS=--rotate 512MB --rotate 1h --keep 100' >> /etc/sniffer/arm.conf
systemctl daemon-reload
systemctl start --no-block {UNIT}
"""
PID: Final = f"$(systemctl show -p MainPID --value {UNIT})"
FILES: Final = "/var/lib/sniffer/arm/*.mcap"


def unit(rig: Machine, report: Report) -> None:
    """It records, reloads, may only read, and begins when the adapter is there."""
    rig.sh(INSTALL)
    rig.until(f"ls {FILES}")
    time.sleep(3)
    sent = rig.wires["ftdi1"].play(talk(2, 9))
    time.sleep(6)
    report.fact(rig.sh(f"grep -E '^(Uid|Groups|CapEff|NoNewPrivs|Seccomp):' /proc/{PID}/status"))
    opened = rig.sh(f"for f in /proc/{PID}/fdinfo/*; do ls -l /proc/{PID}/fd/${{f##*/}}; done")
    report.check("ttyUSB0" in opened and "lr-x" in opened, "the port is open for reading")
    rig.sh(f"systemctl kill -s USR1 {UNIT}; sleep 1; systemctl reload {UNIT}; sleep 3")
    sent += rig.wires["ftdi1"].play(talk(1, 10))
    time.sleep(6)
    rig.sh(f"systemctl stop {UNIT}")
    data = b""
    for number, path in enumerate(rig.sh(f"ls {FILES}").split()):
        here = rig.dir / f"unit{number}.mcap"
        here.write_bytes(rig.fetch(path))
        data += b"".join(chunk.data for chunk in heard(here))
    report.check(data == sent, f"{len(data)} of {len(sent)} bytes in two files")
    rig.pull_out()
    rig.until("! test -e /dev/ttyUSB0")
    rig.sh(f"systemctl start --no-block {UNIT}")
    rig.until(f"test $(systemctl show -p NRestarts --value {UNIT}) -ge 1")
    rig.plug_in()
    rig.until(f"ls -l /proc/{PID}/fd | grep -q ttyUSB")
    report.check(True, "it begins once the adapter is there")
    rig.sh(f"systemctl stop {UNIT}")
