"""Python looks for objects that hold each other seldom in commands, and as usual elsewhere."""

from __future__ import annotations

import gc
import subprocess
import sys
from typing import Final

from sniffer.ground.collecting import SELDOM, USUAL, Promptly, collect_seldom
from tests.golden import CAPTURES

COMMAND: Final = """
import gc, sys
looks = []
gc.callbacks.append(lambda phase, told: looks.append(phase))
from sniffer.__main__ import main
try:
    main()
finally:
    print(looks.count("stop"), file=sys.stderr)
"""


def test_python_hardly_looks_through_what_it_loads_to_decode_a_small_capture() -> None:
    python = [sys.executable, "-c", COMMAND, "decode", str(CAPTURES / "wck_damaged.log")]
    ran = subprocess.run(python, capture_output=True, text=True, check=True)
    assert (
        int(ran.stderr.splitlines()[-1]) < 10
    )  # by itself 150 times; once more where modules are compiled


def test_who_imports_the_library_has_python_look_as_usual() -> None:
    code = (
        "import gc; usual = gc.get_threshold(); import sniffer; print(gc.get_threshold() == usual)"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout == "True\n"


def test_python_looks_as_usual_while_something_is_due_at_its_time_and_as_before_afterwards() -> (
    None
):
    before = gc.get_threshold()
    try:
        collect_seldom()
        with Promptly():
            assert gc.get_threshold() == USUAL
        assert gc.get_threshold()[0] == SELDOM
    finally:
        gc.set_threshold(*before)
