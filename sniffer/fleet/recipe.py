"""How captures are decoded, as a text: for other processes, and for the name of the decoder.

Options hold objects that are no one's but this process's. What they were made of is text and
numbers; the same text is the same decoding wherever it is read.
"""

from __future__ import annotations

import functools
import hashlib
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from sniffer.anomalies.alarms import alarm_in
from sniffer.decoding.names import AND, apart
from sniffer.decoding.options import Options
from sniffer.ground.model import SnifferError
from sniffer.ground.registers import RegisterMap, schema_path
from sniffer.ground.wiring import Wiring
from sniffer.protocols import PROTOCOLS, is_file
from sniffer.protocols.plugins import installed
from sniffer.selection.selection import Selection

if TYPE_CHECKING:
    from sniffer.protocols.base import BusProtocol

LAYOUT: Final = 1
"""The number of the data set's layout; another one makes every capture be decoded again."""

DIGITS: Final = 8
"""Hexadecimal digits of a decoder's name: there are few of them in a data set."""


def write_recipe(options: Options, selection: Selection | None, input_format: str) -> str:
    """Return how captures are decoded, as JSON.

    Raises:
        SnifferError: a protocol is an object that cannot be named.
    """
    o = options
    told = {
        "protocol": _named(o.protocol),
        "protocols": {bus: _named(protocol) for bus, protocol in o.protocols.items()},
        "baud": o.baud,
        "bauds": dict(o.bauds),
        "models": [[servo, model] for servo, model in o.models.items()],
        "latency_ns": o.latency_ns,
        "latencies": dict(o.latencies),
        "tables": [table.text for table in o.tables],
        "alarms": [str(alarm) for alarm in o.alarms],
        "begins": dict(o.begins),
        "names": [[servo, name] for servo, name in o.names.items()],
        "wiring": {
            "channels": dict(o.wiring.channels),
            "invert": o.wiring.invert,
            "glitch_us": o.wiring.glitch_us,
        },
        "where": None if selection is None else selection.text,
        "input_format": input_format,
    }
    return json.dumps(told, sort_keys=True)


@functools.lru_cache(maxsize=4)
def read_recipe(text: str) -> tuple[Options, Selection | None, str]:
    """Return options, selection and input format of a recipe.

    Raises:
        SnifferError: what it names is not here.
    """
    told: dict[str, Any] = json.loads(text)
    where, input_format = told.pop("where"), told.pop("input_format")
    told["tables"] = tuple(RegisterMap.from_text(t, "a table") for t in told["tables"])
    told["alarms"] = tuple(map(alarm_in, told["alarms"]))
    told["models"] = dict(told["models"])
    told["names"] = {tuple(w) if isinstance(w, list) else w: n for w, n in told["names"]}
    told["wiring"] = Wiring(**told["wiring"])
    return Options(**told), None if where is None else Selection.parse(where), input_format


def decoder_name(recipe: str) -> str:
    """Return the name of what decodes by a recipe: of the program's sources, tables and plug-ins.

    It is the same on every machine that has the same of them, wherever they lie.

    Raises:
        SnifferError: the file of a protocol cannot be read.
    """
    told: dict[str, Any] = json.loads(recipe)
    told["protocol"] = _told(told["protocol"])
    told["protocols"] = {bus: _told(name) for bus, name in told["protocols"].items()}
    told["plugins"] = sorted(f"{plugin.name} {plugin.package}" for plugin in installed())
    plain = json.dumps(told, sort_keys=True)
    return hashlib.sha256(f"{LAYOUT} {_program()} {plain}".encode()).hexdigest()[:DIGITS]


@functools.cache
def _program() -> str:
    """Return a digest of the program's sources and register tables."""
    package = Path(__file__).parents[1]
    tables = schema_path("registers")
    # an installed package has its tables inside, a checkout beside: names count from each folder
    files = {path.relative_to(package).as_posix(): path for path in package.rglob("*.py")}
    files |= {f"registers/{path.relative_to(tables).as_posix()}": path
              for path in tables.rglob("*.toml")}  # fmt: skip
    digest = hashlib.sha256()
    for name, path in sorted(files.items()):
        text = path.read_bytes().replace(b"\r\n", b"\n")  # as some checkouts have it
        digest.update(f"{name} {len(text)}\n".encode() + text)
    return digest.hexdigest()


def _named(protocol: str | BusProtocol) -> str:
    """Return what another process knows a protocol by: names, files by their whole path."""
    if isinstance(protocol, str):
        names = (str(Path(n).resolve()) if is_file(n) else n for n in apart(protocol))
        return AND.join(names)
    if PROTOCOLS.get(protocol.name) is not protocol:
        told = "is an object of this process: name it, or give the file that defines it"
        raise SnifferError(f"the protocol {protocol.name} {told}")
    return protocol.name


def _told(protocol: str) -> str:
    """Return what tells a protocol from others on any machine: of a file what it holds."""
    return AND.join(_content(Path(n)) if is_file(n) else n for n in apart(protocol))


def _content(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise SnifferError(f"{path}: cannot be read ({error.strerror})") from None
