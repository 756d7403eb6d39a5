"""LSS talk, labelled: the words of the register table, as wiki v106.1 lists them."""

from __future__ import annotations

import tomllib
from typing import Any, Final

from sniffer.ground.registers import schema_path
from sniffer.protocols.lss.grammar import WORDS, command, reply
from sniffer.testing import Exchange, Talk
from tests.talks import due, of_vectors


def _table() -> list[dict[str, Any]]:
    """Return the default model's registers, and those of the sibling's words that it has not."""
    own, more = (
        tomllib.loads(schema_path("registers", f"{model}.toml").read_text(encoding="utf-8"))[
            "register"
        ]
        for model in ("lss", "lss-pro")
    )
    known = {q.rstrip("0123456789") for r in own for q in (r["word"], *r.get("queries", ()))}
    return [*own, *(r for r in more if not known & {r["word"], *r.get("queries", ())})]


TABLE: Final = _table()


def _asked(query: str, register: dict[str, Any], value: int, who: int) -> Exchange:
    """Ask for a register, by word and selector."""
    word = query.rstrip("0123456789")
    selector = int(query[len(word) :] or 0) or None
    raw = command(who, word, selector)
    return Exchange(word, raw, (reply(who, word, value),), {register["name"]: value})


def _queries() -> list[Exchange]:
    out = []
    for k, r in enumerate(TABLE):
        asks = r.get("queries") or ([r["word"]] if r["kind"] == "query" else [])
        for query in asks:
            if r["type"] == "decimal":
                out += [_asked(query, r, 10 + k, who) for who in (1, 2)]
    return out


def _statements() -> list[Exchange]:
    out = []
    for k, r in enumerate(TABLE):
        if r["kind"] in ("query", "modifier"):
            continue
        number = 10 + k if r["type"] == "decimal" else None
        labels = {} if number is None else {r["name"]: number}
        out.append(Exchange(r["word"], command(1, r["word"], number), (), labels))
        out += [
            Exchange(r["word"], command(2, alias, number), (), labels)
            for alias in r.get("aliases", ())
        ]
    return out


def _modified() -> list[Exchange]:
    out = []
    for r in TABLE:
        if r["kind"] == "modifier":
            name, word = r["name"], (r.get("modifies") or ["D"])[-1]
            goal = next(x["name"] for x in TABLE if x["word"] == word and x["kind"] == "action")
            raw = command(1, word, -450, {r["word"]: 25})
            out.append(Exchange(word, raw, (), {goal: -450, name: 25}))
    return out


OTHERS: Final = [
    # all of them asked, and moved; the one whose button was pressed
    Exchange(
        "QD",
        command(254, "QD"),
        tuple(reply(k, "QD", 100 + k) for k in (1, 2, 3)),
        {(k, "present_position"): 100 + k for k in (1, 2, 3)},
    ),
    Exchange("QV", command(254, "QV"), (reply(2, "QV", 11200),), {(2, "present_voltage"): 11200}),
    Exchange("QID", command(255, "QID"), (reply(None, "QID", 5),)),
    Exchange("QD", command(255, "QD"), (reply(5, "QD", -31),), {(5, "present_position"): -31}),
    Exchange("D", command(254, "D", 450), (), {"goal_position": 450}),
    Exchange("D", command(255, "D", 450), (), {"goal_position": 450}),
    Exchange("QMS", command(1, "QMS"), (reply(1, "QMS", "LSS-HS1"),), {}),
    Exchange("QMS", command(2, "QMS"), (reply(2, "QMS", "LSS-ST1"),), {}),
    Exchange("QDT", command(1, "QDT"), (reply(1, "QDT", None),), {}),
    Exchange("QFD", command(1, "QFD"), (reply(1, "QFD", "DIS"),), {}),
    Exchange("CID", command(1, "CID", 7), (), {"servo_id": 7}),
    Exchange("D", command(1, "D", -1), (), {"goal_position": -1}),
    Exchange("D", command(1, "D", -18000), (), {"goal_position": -18000}),
    Exchange("QD", command(1, "qd"), (reply(1, "QD", 5),), {"present_position": 5}),
    Exchange("QABC", command(1, "QABC"), None, {}),
    Exchange("ABC", command(1, "ABC", 5), (), {}),
    Exchange("D", b"#1D45" + b"T00000000000000025" * 5 + b"\r", (), None),
]

TALK: Final = Talk(
    due([*of_vectors("lss"), *_queries(), *_statements(), *_modified(), *OTHERS], "Q*"),
    commands=list(dict.fromkeys(w.name for w in WORDS.values())),
    absent={
        "* one byte less": "a line ends with a carriage return, whatever its length",
        "* one byte more": "a line ends with a carriage return, whatever its length",
        "data that * the header": "a line ends where another mark comes",
        "a frame that ends as the header begins": "it ends with a carriage return",
        "data that hold a whole request": "a line ends where another mark comes",
        "a scene: staged, then released": "nothing is staged",
        "a reset *": "no reset changes what is decoded: the id is kept, and there are no modes",
        "arranged: * damaged": "lines have no checksum",
    },
)
