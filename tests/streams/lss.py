"""LSS talk."""

from __future__ import annotations

from hypothesis import strategies as st

from sniffer.protocols.lss.grammar import MODIFIERS, TEXT_WORDS, WORDS, command, reply

BYTES = [*b"##**\r\r\r\n -QDTSFIMP0125\x00"]

_QUERIES = sorted(w for w, word in WORDS.items() if word.is_query)
_OTHERS = sorted(w for w, word in WORDS.items() if not word.is_query)
_id = st.one_of(st.sampled_from([0, 1, 5, 5, 250, 254, 255]), st.integers(0, 250))
_number = st.one_of(
    st.integers(-2500, 2500),
    st.sampled_from([0, 1, -1, 12_345_678, -12_345_678, 123_456_789, 2**31, -(2**31)]),
    st.integers(-(10**18) + 1, 10**18 - 1),
)
_letters = st.text("QDPACSTabcz", min_size=1, max_size=14)
_word = st.one_of(st.sampled_from(_OTHERS), st.sampled_from(_OTHERS), _letters)
_text = st.text("DIS-.LHT19 !~", min_size=1, max_size=24)


@st.composite
def _exchange(draw: st.DrawFn) -> bytes:
    """Draw a query with its selector, and what one or several servos answer."""
    who = draw(_id)
    word = draw(
        st.one_of(
            st.sampled_from(_QUERIES),
            st.sampled_from(["Q", "QSD", "QAR", "QID", "QZ", "QABCDEFGHIJKL"]),
        )
    )
    selector = draw(st.sampled_from([None, None, 0, 1, 2, 3, 9, 10, 32768]))
    out = command(who, word.lower() if draw(st.integers(0, 9)) == 0 else word, selector)
    for _ in range(draw(st.sampled_from([0, 1, 1, 1, 2, 4]))):
        servo = who if who <= 250 and draw(st.integers(0, 9)) else draw(st.integers(0, 3))
        told = draw(st.sampled_from([word, word, word, word, word[1:] or word, "QD", word.lower()]))
        value = draw(st.one_of(st.none(), _number, _number))
        match draw(st.integers(0, 9)):
            case 0:
                out += reply(None, "QID", servo)
            case 1:
                out += reply(servo, draw(st.sampled_from(TEXT_WORDS)), draw(_text))
            case 2:
                out += b"*" + str(servo).encode() + told.encode() + draw(_text).encode() + b"\r"
            case _:
                out += reply(servo, told, value)
    return out


@st.composite
def _statement(draw: st.DrawFn) -> bytes:
    """Draw an action or a configuration, whole or nearly so."""
    word, value = draw(_word), draw(st.one_of(st.none(), _number, _number, _number))
    line = b"#" + str(draw(_id)).encode() + word.encode()
    if value is not None:
        line += str(value).encode()
        names = st.one_of(st.sampled_from(sorted(MODIFIERS)), st.sampled_from(["T", "S"]), _letters)
        for _ in range(draw(st.sampled_from([0, 0, 0, 1, 1, 2, 3, 6]))):
            line += draw(names).encode() + str(abs(draw(_number))).encode()
    return line + draw(st.sampled_from([b"\r", b"\r", b"\r", b"\r\n", b" \r", b"\r  ", b""]))


_LINES = [
    *(b"#5CRC*\r", b"*5QDT\r", b"*5QFPDIS\r", b"*5QFDXX\r", b"#1D200T15000CL400\r", b"#5SCSL100\r"),
    *(
        b"*QD5\r",
        b"*QID\r",
        b"*QID251\r",
        b"#251D5\r",
        b"#0005D5\r",
        b"#005qd\r",
        b"*5QF368.29.14\r",
    ),
    *(
        b"#5D--5\r",
        b"#5D5-3\r",
        b"#5D1T\r",
        b"#5" + b"A" * 100 + b"\r",
        b"*5QN" + b"7" * 30 + b"\r",
    ),
    *(b"#5D" + b"0" * 80 + b"\r", b"#5D1" + b"T1" * 45 + b"\r", b"*5QMS" + b"x" * 90 + b"\r"),
    *(b"#\r", b"*\r", b"##5Q#5QD\r", b"\x80\xff#5QV\r*5QV11\xff00\r"),
]

_STRINGS = ["LSS-P-S1", "LSS-P-S1", "LSS-P-X9", "LSS-HS1", "LSS-HS1", "LSS-ST2", "LSS-2IO", "123"]
_ANSWERED = ["QIX", "QTCW", "QEF", "QP", "QFP", "QAS", "QFD"]


@st.composite
def _told(draw: st.DrawFn) -> bytes:
    """Draw talk that tells an LSS from an LSS-PRO, has values of both, and gives new ids."""
    who = draw(st.sampled_from([1, 1, 1, 2, 2, 254]))
    by = who if who != 254 else draw(st.sampled_from([1, 2]))
    match draw(st.sampled_from(["name", "name", "word", "value", "value", "move", "id", "reset"])):
        case "name":
            by = draw(st.sampled_from([by, by, by, by, 1, 2, 254]))
            said = reply(by, "QMS", draw(st.sampled_from(_STRINGS)))
            asked = command(who, draw(st.sampled_from(["QMS", "QMS", "qms", "QD"])))
            return asked + (said if draw(st.integers(0, 5)) else b"")
        case "word":
            word = draw(st.sampled_from(_ANSWERED))
            answer = reply(by, word, draw(st.sampled_from([None, 0, -3, 44])))
            return command(who, word) + (answer if draw(st.integers(0, 5)) else b"")
        case "value":
            word = draw(st.sampled_from(["QD", "QV", "Q", "QSD", "QWD"]))
            return command(who, word) + reply(by, word, draw(st.integers(-18000, 18000)))
        case "move":
            return command(who, "D", draw(st.integers(-18000, 18000)), {"SD": 600})
        case "id":
            return command(who, "CID", draw(st.integers(1, 3)))
        case _:
            return command(who, draw(st.sampled_from(["RESET", "DEFAULT", "CONFIRM"])))


MODELS = st.lists(_told(), max_size=40).map(b"".join)
"""Long talk with servos whose model shows itself on the way."""

TALK = st.one_of(
    _exchange(), _exchange(), _exchange(), _statement(), st.sampled_from(_LINES), _told()
)


@st.composite
def _asked(draw: st.DrawFn) -> tuple[bytes, list[bytes]]:
    """Draw a query to one servo or to all, or a move, and the lines that answer it."""
    who = draw(st.sampled_from([1, 2, 3]))
    word = draw(st.sampled_from(["QD", "QV", "QC", "Q", "QSD"]))
    value = draw(st.integers(-999, 999))
    match draw(st.integers(0, 9)):
        case 0:
            return command(254, word), [reply(i, word, value) for i in (1, 2, 3)]
        case 1:
            return command(255, word), [reply(who, word, value)]
        case 2:
            return command(254, "D", value), []
        case 3:
            return command(who, "D", value), []
        case _:
            return command(who, word), [reply(who, word, value)]


ASKED = _asked()
