"""Verdicts on what came over the line: bytes, protocol, baud, errors, losses."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sniffer.decoding.detect import WORTH_TELLING, ranked
from sniffer.decoding.names import AND
from sniffer.decoding.understanding import FEW, GOOD, POOR, Understanding, usual_bauds
from sniffer.doctor.records import Level, Listened, Observation, Trial
from sniffer.ground.model import MarkKind
from sniffer.ground.wording import Sentence

if TYPE_CHECKING:
    from collections.abc import Iterator

WRONG_BAUD_ERRORS: Final = 0.05
"""Share of bytes with line errors from which on the baud is suspected. Simulated buses read at 1/12
to 4 times their baud show 9 to 79 %, at their own none."""

FLAT: Final = 0.69
"""Share of bytes with one edge at most (00, FF, 80, F0 ...) from which on a line is read too fast:
simulated buses show 70 to 85 % at four times their baud, less than this nearer to it."""

NOISY: Final = 0.01
"""Share of bytes with line errors from which on a recording is of little use."""

_FLAT_BYTES: Final = frozenset(b for b in range(256) if ((b ^ b >> 1) & 0x7F).bit_count() <= 1)


def percent(share: float) -> str:
    """Return a share in words; 100% and 0% are said of nothing less and nothing more."""
    if 0 < share < 0.001:
        return "less than 0.1%"
    if 0.999 < share < 1:
        return "99.9%"
    return f"{100 * share:.{0 if share in (0, 1) else 1}f}%"


def about_bytes(heard: Listened) -> Iterator[Observation]:
    """Is there anything at all?"""
    size, seconds = heard.size, heard.seconds
    numbers = {"bytes": size, "seconds": round(seconds, 3), "reads": len(heard.chunks)}
    if heard.gone_s is not None:
        yield Observation(
            Level.BAD,
            "bytes",
            f"the port went away after {heard.gone_s:.1f} s; {size} bytes had come",
            "look at the cable, the hub and the supply; `dmesg` tells what the system saw",
            numbers=numbers,
        )
        return
    if not size:
        text = f"no byte in {seconds:.1f} s"
        advice = (
            "is the bus talking now? The adapter's RX belongs on the data line (A and B on RS-485) "
            "and its ground on the bus's ground; `sniffer ports` tells whether this is the adapter"
        )
        if heard.line_errors:
            text += f", but {heard.line_errors} line errors: something moves there"
            advice = Sentence(
                "try another {baud}; if that does not help, A and B are swapped or TTL inverted"
            )
        yield Observation(Level.BAD, "bytes", text, advice, numbers=numbers)
        return
    load = size * 10 / heard.baud / seconds
    numbers["load"] = round(load, 4)
    part = percent(min(load, 1.0))
    text = f"{size} bytes in {seconds:.1f} s, {part} of what {heard.baud} baud carry"
    if load > 1.1:
        text = f"{size} bytes in {seconds:.1f} s: more than {heard.baud} baud carry"
        advice = (
            "no UART keeps the time here (a pseudo terminal, or an adapter that ignores the baud)"
        )
        yield Observation(Level.NOTE, "bytes", text, advice, numbers=numbers)
    elif size < FEW:
        text += ": too few to judge by"
        advice = Sentence("listen longer: {seconds:30}")
        yield Observation(Level.NOTE, "bytes", text, advice, numbers=numbers)
    else:
        yield Observation(Level.OK, "bytes", text, numbers=numbers)


def about_line(heard: Listened, found: Understanding) -> Iterator[Observation]:
    """Is it understood, at this baud, without errors and whole?"""
    if found.size:
        yield _protocol(heard, found)
        yield _baud(heard, found)
    yield _errors(heard, found)
    yield _losses(heard)


def _protocol(heard: Listened, found: Understanding) -> Observation:
    scores = {name: round(share, 4) for name, share in found.scores.items()}
    numbers = {"protocol": found.protocol, "share": round(found.share, 4), "scores": scores}
    least = 0.0 if found.protocol is None else WORTH_TELLING
    rest = [name for name in ranked(found.scores) if name not in (found.protocol or "").split(AND)][
        :2
    ]
    others = ", ".join(
        f"{name} {percent(found.scores[name])}" for name in rest if found.scores[name] >= least
    )
    best = max(found.scores, key=lambda name: found.scores[name])
    if found.protocol is None:
        text = f"none explains these {found.size} bytes: {others}"
        advice = "the baud may be wrong (see there), or it is none of the protocols known here"
        level = Level.NOTE if found.size < FEW else Level.BAD
        return Observation(level, "protocol", text, advice, numbers=numbers)
    text = f"{found.protocol} explains {percent(found.share)} of the bytes"
    text += f" ({others})" if others else ""
    if found.share >= GOOD:
        return Observation(Level.OK, "protocol", text, numbers=numbers)
    if best != found.protocol and found.scores[best] >= GOOD:
        advice = f"this is {best}: sniffer doctor {heard.path}={best}@{heard.baud}"
        return Observation(Level.BAD, "protocol", text, advice, numbers=numbers)
    level = Level.NOTE if found.size < FEW else Level.WARN if found.share >= POOR else Level.BAD
    advice = "the rest is damaged or of another kind: `sniffer decode` shows it byte by byte"
    return Observation(level, "protocol", text, advice, numbers=numbers)


def _baud(heard: Listened, found: Understanding) -> Observation:
    baud = heard.baud
    flat = sum(byte in _FLAT_BYTES for chunk in heard.chunks for byte in chunk.data) / heard.size
    faulty = min(heard.line_errors / heard.size, 1.0)
    best = max(heard.trials, key=lambda t: t.found.share, default=None)
    numbers = {
        "baud": baud,
        "flat_bytes": round(flat, 4),
        "errors_per_byte": round(faulty, 4),
        "trials": [_tried(t) for t in heard.trials],
    }
    if not heard.has_line:
        text = f"no line, so any baud will do; times are reckoned at {baud}"
        return Observation(Level.OK, "baud", text, numbers=numbers)
    if max(found.scores.values()) >= GOOD and found.size >= FEW:
        return Observation(Level.OK, "baud", f"{baud} is right: frames hold", numbers=numbers)
    if best is not None and _better(best, found):
        now = f"{best.baud} baud explain {percent(best.found.share)} of the bytes as "
        text = f"{now}{best.found.protocol}, {baud} only {percent(found.share)}"
        command = f"sniffer doctor {heard.path}={heard.named(best.found.protocol)}@{best.baud}"
        return Observation(Level.BAD, "baud", text, "it is most likely:", (command,), numbers)
    signs = [f"{percent(faulty)} of the bytes with line errors"] if faulty else []
    signs.append(f"{percent(flat)} are 00, FF, 80 or alike, with one edge at most")
    told = ", ".join(signs)
    if faulty < WRONG_BAUD_ERRORS and flat < FLAT:
        doubt = found.size >= FEW and found.share < POOR
        advice = _others(heard, "if it is wrong, try") if doubt else ""
        text = f"{baud} can be neither proved nor ruled out ({told})"
        return Observation(
            Level.WARN if doubt else Level.NOTE, "baud", text, advice, numbers=numbers
        )
    side = "too high" if flat >= FLAT else "wrong"
    level = Level.BAD if found.share < POOR else Level.WARN
    text = f"{baud} is most likely {side}: {told}"
    return Observation(
        level, "baud", text, _others(heard, "try", lower=flat >= FLAT), numbers=numbers
    )


def _tried(trial: Trial) -> dict[str, int | float | str | None]:
    found = trial.found
    share = round(found.share, 4)
    return {
        "baud": trial.baud,
        "bytes": found.size,
        "protocol": found.protocol,
        "share": share,
    }


def _better(trial: Trial, found: Understanding) -> bool:
    told = trial.found.protocol is not None and trial.found.size >= FEW
    return told and trial.found.share >= POOR and trial.found.share > 1.5 * found.share


def _others(heard: Listened, word: str, *, lower: bool = False) -> str:
    """Return which bauds are left to try."""
    if heard.trials:
        tried = ", ".join(str(t.baud) for t in heard.trials)
        told = "none of {tried} is better; give the controller's own with {baud}"
        return Sentence(told, tried=tried)
    bauds = [b for b in usual_bauds(heard.protocol, heard.baud) if not lower or b < heard.baud]
    if not bauds:
        return ""
    return Sentence("{word} {baud} with {bauds}", word=word, bauds=", ".join(map(str, bauds)))


def _errors(heard: Listened, found: Understanding) -> Observation:
    errors, size = heard.line_errors, heard.size
    counted = heard.counts_errors if heard.risen is not None else False
    risen = heard.risen is not None and bool(
        heard.risen.frame + heard.risen.parity + heard.risen.brk
    )
    marked = heard.marked(MarkKind.FRAMING, MarkKind.PARITY, MarkKind.BREAK) > 0
    told = [
        *(["marked in the stream"] if heard.marks_errors or marked else []),
        *(["counted by the driver"] if counted or risen else []),
    ]
    if not heard.has_line:
        return Observation(Level.OK, "errors", "no line, so no errors of one")
    numbers = {
        "line_errors": errors if told else None,
        "marked": heard.marks_errors,
        "counted": counted,
    }
    if not told:
        text = "this port neither marks nor counts errors of the line: only checksums show damage"
        if heard.marks_errors is None or counted is None:
            text = f"{_how(heard)}: only checksums are sure to show damage"
        return Observation(Level.NOTE, "errors", text, numbers=numbers)
    if not errors:
        text = f"no framing error, parity error or break ({', '.join(told)})"
        return Observation(Level.OK, "errors", text, numbers=numbers)
    share = errors / size if size else 1.0
    text = f"{errors} line errors in {size} bytes ({_kinds(heard)}; {', '.join(told)})"
    if share >= WRONG_BAUD_ERRORS and found.share < POOR:
        advice = "the baud is the first suspect"
    else:
        advice = (
            "noise: look at ground, termination and the length of the wires; two that talk at once "
            "look the same"
        )
    level = Level.BAD if share >= NOISY else Level.WARN
    return Observation(level, "errors", text, advice, numbers=numbers)


def _how(heard: Listened) -> str:
    """Return what the port says of its errors, where that is not much."""
    how = heard.facts.get("line_errors", "")
    return how if how.startswith("unknown") else "whether this port tells of errors is not known"


def _kinds(heard: Listened) -> str:
    risen = heard.risen
    counts = {
        "framing": heard.marked(MarkKind.FRAMING),
        "parity": heard.marked(MarkKind.PARITY),
        "break": heard.marked(MarkKind.BREAK),
    }
    if risen is not None and (risen.frame or risen.parity or risen.brk):
        counts = {"framing": risen.frame, "parity": risen.parity, "break": risen.brk}
    return ", ".join(f"{kind} {n}" for kind, n in counts.items() if n)


def _losses(heard: Listened) -> Observation:
    marked = heard.marked(MarkKind.OVERRUN)
    risen = heard.risen
    counted = risen.overrun + risen.buf_overrun if risen is not None else 0
    lost = counted or marked
    counts = risen is not None and heard.counts_errors
    numbers = {"lost": lost if counts or lost else None}
    if lost:
        text = f"bytes were lost {lost} times on this side, between adapter and program"
        advice = "another USB port, without a hub; less load on this machine; close other programs"
        return Observation(Level.BAD, "losses", text, advice, numbers=numbers)
    if risen is None and not heard.has_line:
        return Observation(Level.OK, "losses", "none are known", numbers=numbers)
    if risen is None:
        text = "this driver does not count them: they would look like damaged frames"
        return Observation(Level.NOTE, "losses", text, numbers=numbers)
    if not counts:
        text = "none are told, but whether this adapter counts them is not known"
        return Observation(Level.NOTE, "losses", text, numbers=numbers)
    return Observation(Level.OK, "losses", "no byte lost on this side", numbers=numbers)
