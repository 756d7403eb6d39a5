"""Ctrl-C, from the moment on at which the program begins: one line, one status, no traceback."""

from __future__ import annotations

import subprocess
import sys
from typing import TYPE_CHECKING, Final

import pytest

if TYPE_CHECKING:
    from pathlib import Path

posix = pytest.mark.skipif(sys.platform == "win32", reason="needs signals of POSIX")


@posix
def test_ctrl_c_while_the_program_loads_is_one_line(good: Path) -> None:
    loads = f"""
import os, signal, sys
import sniffer.__main__ as program
class Interrupts:
    def find_spec(self, name, path=None, target=None):
        if name == "sniffer.cli.decode":
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Interrupts())
sys.argv = ["sniffer", "decode", {str(good)!r}]
program.main()
"""
    done = subprocess.run(
        [sys.executable, "-c", loads], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "sniffer: interrupted\n")


PRESSED: Final = """
import signal, sys, time
from sniffer.__main__ import SAME_S, Interruptions

def press(times=1):
    for _ in range(times):
        signal.raise_signal(signal.SIGINT)

class Lost:
    def __del__(self):
        press()

with Interruptions() as interruptions:
    {0}
    status = interruptions.end(7)
{1}
sys.exit(status)
"""

HURRIES: Final = {
    "tidied up": ("try: press()\n    except KeyboardInterrupt: press(5)", "", 7),
    "nobody looks out for it": ("press()", "", 130),
    "tidying up takes too long": (
        "try: press()\n    except KeyboardInterrupt: time.sleep(SAME_S + 0.01); press()", "", 130,
    ),
    "raised where Python lets none out": (
        "try: Lost(); time.sleep(9)\n    except KeyboardInterrupt: press()", "", 7,
    ),
    "it is over": ("pass", "press(3)", 7),
}  # fmt: skip


@posix
@pytest.mark.parametrize("when", HURRIES)
def test_ctrl_c_is_raised_once_however_often_it_is_pressed_in_a_hurry(when: str) -> None:
    *code, status = HURRIES[when]
    done = subprocess.run(
        [sys.executable, "-c", PRESSED.format(*code)], capture_output=True, text=True, check=False
    )
    said = "sniffer: interrupted\n" if status == 130 else ""
    assert (done.returncode, done.stdout, done.stderr) == (status, "", said)


def test_the_program_begins_without_loading_what_takes_long() -> None:
    """Until it does, Ctrl-C would be a traceback."""
    listed = "import sniffer.__main__, sys; print(sum(m.startswith('numpy') for m in sys.modules))"
    assert subprocess.check_output([sys.executable, "-c", listed], text=True) == "0\n"
