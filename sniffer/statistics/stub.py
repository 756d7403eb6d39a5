"""A register table to begin with: the one a servo is read by, and what was found beside it."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final

from sniffer.statistics.guesses import place, runs

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.ground.registers import RegisterMap
    from sniffer.statistics.guesses import FieldGuess

_HEAD: Final = re.compile(r"^(model|title|identifies)\s*=.*\n", re.MULTILINE)
"""Lines that the new table says itself, or may not: what a servo says of itself is its own
model's."""


def stub(base: RegisterMap, found: Sequence[FieldGuess], model: str, source: str) -> str:
    """Return a table in TOML that ``--registers`` takes.

    Of fields of several servos the one that was heard most often is taken; one that is read and
    written is one register.
    """
    best: dict[int, FieldGuess] = {}
    written = {guess.address for guess in found if guess.is_write}
    for guess in sorted(found, key=lambda g: (-g.count, g.is_write, g.servo_id)):
        span = range(guess.address, guess.address + guess.width)
        if not any(_covers(known, address) for known in best.values() for address in span):
            best[guess.address] = guess
    head = [
        f"# The table of {base.model}, and behind it what `sniffer discover` found in {source}.",
        "# Names are addresses, types are guesses: what they mean is yours to say.",
        "",
        f'model = "{model}"',
        f'title = "{model}: {base.model} and registers that no table names"',
    ]
    text = _HEAD.sub("", base.text)
    moving = [at for at in sorted(best) if not best[at].is_constant]
    blocks = [_block(best[at], is_written=at in written, source=source) for at in moving]
    still = runs([best[at] for at in sorted(best) if best[at].is_constant])
    if still:
        told = [f"#   {place(run)} {run[0].low}" for run in still]
        blocks = ["", "# Bytes that were always the same, and have no entry:", *told, *blocks]
    return "\n".join([*head, text.strip(), *blocks]) + "\n"


def _covers(guess: FieldGuess, address: int) -> bool:
    return guess.address <= address < guess.address + guess.width


def _block(guess: FieldGuess, *, is_written: bool, source: str) -> str:
    said = guess.sentence().replace("\\", "/").replace('"', "'")
    lines = [
        "",
        "[[register]]",
        f'name = "unknown_{guess.address:02x}"',
        f"address = 0x{guess.address:02X}",
        f'type = "{guess.type}"',
        f'role = "{"config" if is_written else "measured"}"',
        f'access = "{"rw" if is_written else "r"}"',
        "volatile = true",
        f'source = "sniffer discover, {source}"',
        f'doubt = "guessed from {guess.count} readings of servo {guess.servo_id}: {said}"',
    ]
    return "\n".join(lines)
