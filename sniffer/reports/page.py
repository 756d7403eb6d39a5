"""The report as a page: one file, nothing of which is fetched from anywhere.

A policy in its head forbids the browser to ask any address; its script is allowed by its digest, so
that no text of a capture could run even if it became markup. All that is essential is there without
the script.
"""

from __future__ import annotations

import base64
import hashlib
from pathlib import Path
from typing import TYPE_CHECKING, Final

from sniffer.ground.amounts import lasting
from sniffer.ground.model import Clock
from sniffer.ground.wording import counted
from sniffer.reports import tables, words
from sniffer.reports.boxes import drawing
from sniffer.reports.content import SOUND, found_of, tale
from sniffer.reports.curves import STEPS_S, Charts
from sniffer.reports.histograms import TimeScale, histogram
from sniffer.reports.markup import Markup, joined, sentence, tag
from sniffer.reports.shapes import shape

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sniffer.decoding.drawing import Drawn
    from sniffer.diagnosis.model import Incident
    from sniffer.reports.content import Content
    from sniffer.reports.evidence import Exhibit
    from sniffer.statistics.figures import ServoFigures

SERVOS: Final = 32
"""Servos that have curves and a histogram, those with incidents first: a page stays below 3 MB."""

BUSES: Final = 16
"""Buses that have curves and a table of anomalies, the first ones."""

INCIDENTS: Final = 50
"""Incidents that are told with their bytes, the worst ones."""

WIDE: Final = 24
"""Bytes of a frame that is told in a line."""

ROWS: Final = 512
"""Rows of a table."""

LIKELY: Final = 3
"""Causes of an incident that are told."""


def page(content: Content) -> str:
    """Return the whole page."""
    folder = Path(__file__).parent
    style = (folder / "page.css").read_text(encoding="utf-8")
    script = (folder / "page.js").read_text(encoding="utf-8")
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    policy = (
        f"default-src 'none'; style-src 'unsafe-inline'; script-src 'sha256-{digest}'; "
        "img-src data:; base-uri 'none'; form-action 'none'"
    )
    head = tag(
        "head",
        tag("meta", charset="utf-8"),
        tag("meta", http_equiv="Content-Security-Policy", content=policy),
        tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
        tag("meta", name="color-scheme", content="light dark"),
        tag("meta", name="generator", content=content.tool),
        tag("title", f"{content.name}: what was wrong on the bus"),
        tag("style", Markup(style)),
    )
    body = tag("body", *_body(content), tag("script", Markup(script)))
    return f"<!doctype html>\n{tag('html', head, body, lang='en')}\n"


def _body(content: Content) -> Iterator[Markup]:
    drawn = _drawn(content)
    charts = Charts(content.collector, len(drawn), content.clock)
    yield tag("header", tag("h1", content.name), tag("p", _about(content), cls="dim"))
    yield _verdict(content)
    yield _contents(content)
    yield from _incidents(content)
    yield _section("bus", "The bus over time", *_buses(content, charts))
    yield _section("servos", "The servos", *_servos(content))
    yield _section("curves", "Servo by servo", *_curves(content, charts, drawn))
    yield _section("times", "Response times", *_times(content, drawn))
    yield _section("anomalies", "All anomalies", *_anomalies(content))
    yield _section("bytes", "Where the bytes are", *_bytes(content))
    yield _section("recorded", "How it was recorded", *_recorded(content))
    yield tag(
        "footer",
        tag("p", f"Made by {content.tool} on {content.made}. "),
        tag(
            "p",
            "Times are UTC. A response time is told as a number only where the stamps carry "
            "one: 2.10-3.40 lies between both, <1.20 is at most that.",
        ),
    )


def _section(name: str, title: str, *parts: Markup) -> Markup:
    return tag("section", tag("h2", title), *parts, id=name)


def _about(content: Content) -> str:
    """Return in a line what the capture is."""
    span = content.span_ns
    parts = [f"{bus}: {b.protocol}" for bus, b in content.summary.buses.items()]
    out = [words.listed(parts, 4)]
    if span is not None and content.clock != Clock.NONE:
        out += [f"from {words.dated(span[0])}", f"over {lasting(content.lasted_ns)}"]
    out.append(counted(sum(b.bytes for b in content.summary.buses.values()), "byte"))
    return ", ".join(out)


def _verdict(content: Content) -> Markup:
    worst = content.worst
    broken = [tag("p", f"The input broke off: {content.damage}")] if content.damage else []
    judged = tag("p", f"Judged on {content.judged}.", cls="dim")
    left = f"No cause can be told of {content.rest.told}."
    act = tag("p", tag("b", "Do next: "), sentence(content.rest.next), cls="next")
    rest = [tag("p", left), act] if content.rest.told else []
    if worst is None:
        told = [tag("h2", "No incident"), *(rest or [tag("p", SOUND)])]
        how = "warn" if rest else "sound"
        return tag("section", *told, *broken, judged, cls=f"verdict {how}", id="verdict")
    others = len(content.incidents) - 1
    more = counted(others, "further incident")
    return tag(
        "section",
        tag("h2", shape(worst.severity), f" {content.titled(worst)}"),
        tag("p", tale(worst), cls="story"),
        tag("p", tag("b", "Do next: "), sentence(worst.next), cls="next"),
        *([tag("p", tag("a", f"and {more}", href="#incidents"))] if others else []),
        *(tag("p", sentence(each.told)) for each in content.shared),
        *rest,
        *broken,
        judged,
        cls=f"verdict {worst.severity.name.lower()}",
        id="verdict",
    )


def _contents(content: Content) -> Markup:
    places = {
        **({"incidents": "incidents"} if content.incidents else {}),
        "bus": "bus",
        "servos": "servos",
        "curves": "curves",
        "times": "response times",
        "anomalies": "anomalies",
        "bytes": "bytes",
        "recorded": "how it was recorded",
    }
    links = [tag("a", title, href=f"#{name}") for name, title in places.items()]
    whole = tag(
        "button",
        "whole time",
        type_="button",
        id="whole",
        hidden="",
        data_steps=" ".join(f"{step:g}" for step in STEPS_S),
    )
    return tag("nav", *(joined([link, " "]) for link in links), whole)


def _incidents(content: Content) -> Iterator[Markup]:
    if not content.incidents:
        return
    told = content.incidents[:INCIDENTS]
    yield tag(
        "section",
        tag("h2", counted(len(content.incidents), "incident")),
        *(_incident(content, i, content.exhibits.get(i.number, ())) for i in told),
        *_more(len(content.incidents) - len(told), "incidents", "`sniffer diagnose` tells them"),
        id="incidents",
    )


def _incident(content: Content, incident: Incident, shown: Sequence[Exhibit]) -> Markup:
    clock = content.clock_of(incident.bus)
    first, last = words.period(incident.first_ns, incident.last_ns, clock)
    when = first if first == last else f"{first} to {last}"
    who = ", ".join(content.names.label(incident.bus, servo) for servo in incident.servo_ids)
    facts = [
        incident.bus,
        *([f"servo {who}"] if who else []),
        when,
        counted(incident.count, "time"),
    ]
    causes = [
        tag(
            "tr",
            tag("td", f"{c.percent} %", cls="number"),
            tag("td", tag("span", style=f"width:{c.percent}%"), cls="share"),
            tag("td", tag("b", c.cause)),
            tag("td", sentence(c.why)),
        )
        for c in incident.likely[:LIKELY]
    ]
    told, more = found_of(incident, content.names)
    found = [
        tag("tr", tag("td", f.code), tag("td", f.count, cls="number"), tag("td", sentence(f.what)))
        for f in told
    ]
    parts = [
        tag("h3", shape(incident.severity), f" {incident.number}. {content.titled(incident)}"),
        tag("p", " · ".join(facts), cls="dim"),
        tag("p", tale(incident), cls="story"),
        tag("p", tag("b", "Do next: "), sentence(incident.next), cls="next"),
        tag("h4", "Causes that were weighed"),
        _wide(tag("table", tag("tbody", *causes), cls="causes")),
        *([tag("p", incident.against)] if incident.against else []),
        tag("h4", "What was found"),
        _wide(tag("table", tag("tbody", *found))),
        *_more(more, "findings"),
    ]
    if shown:
        parts += [tag("h4", "The bytes"), *(_exhibit(e, clock) for e in shown)]
    return tag(
        "article",
        *parts,
        id=f"incident-{incident.number}",
        cls=f"incident {incident.severity.name.lower()}",
    )


def _exhibit(exhibit: Exhibit, clock: Clock) -> Markup:
    place = exhibit.place
    when = words.moment(place.t_ns, clock)
    caption = tag("figcaption", tag("b", when), sentence(f" byte {place.offset}: {place.what}"))
    return tag(
        "figure",
        caption,
        *_beside("before it", exhibit.before),
        *map(drawing, exhibit.pieces),
        *_beside("behind it", exhibit.behind),
        cls="exhibit",
    )


def _beside(where: str, frames: Sequence[Drawn]) -> Iterator[Markup]:
    """Yield frames in a line each."""
    for frame in frames:
        shown = frame.raw[:WIDE].hex(" ").upper() + (" …" if len(frame.raw) > WIDE else "")
        yield tag("p", f"{where}: {frame.title} ", tag("code", shown), cls="beside")


def _buses(content: Content, charts: Charts) -> Iterator[Markup]:
    several = len(content.collector.wires) > 1
    for bus, wire in list(content.collector.wires.items())[:BUSES]:
        names = {bus, *content.collector.lanes_of(bus)}
        mine = [i for i in content.incidents if i.bus in names]
        if several:
            yield tag("h3", bus)
        if wire.clock == Clock.NONE:
            why = "The input has no clock: how busy the line was is not known."
            yield tag("p", why, cls="dim")
        yield charts.bus(wire, mine)
    yield from _more(len(content.collector.wires) - BUSES, "buses", "without curves")
    yield from (tag("p", told, cls="dim") for told in tables.outcomes(content))


def _servos(content: Content) -> Iterator[Markup]:
    table = tables.servos(content)
    if table.rows:
        yield _wide(_table(table, "servos named" if content.names else "servos"))
        yield from _more(len(table.rows) - ROWS, "servos")
    else:
        yield tag("p", "No servo was heard.", cls="dim")
    if told := tables.silent(content):
        yield tag("p", told)


def _drawn(content: Content) -> list[tuple[str, int, ServoFigures]]:
    """Return the servos that have curves: those with incidents first, then by bus and id."""
    found = list(tables.present(content))
    struck = [bool(content.incidents_of(lane, servo)) for lane, servo, _ in found]
    order = sorted(range(len(found)), key=lambda k: (not struck[k], k))
    return [found[k] for k in sorted(order[:SERVOS])]


def _curves(
    content: Content, charts: Charts, drawn: Sequence[tuple[str, int, ServoFigures]]
) -> Iterator[Markup]:
    yield tag(
        "p",
        "Time counts from the beginning. Lines are means, areas reach from the least to the "
        "greatest value; dotted lines are the beginnings of incidents.",
        cls="dim",
    )
    left_out = sum(1 for _ in tables.present(content)) - len(drawn)
    for lane, servo, mine in drawn:
        title = tables.servo_name(content, lane, servo)
        yield tag(
            "article",
            tag("h3", title),
            charts.servo(mine, content.incidents_of(lane, servo)),
            cls="servo",
        )
    yield from _more(left_out, "servos", "figures above, no curves")


def _times(content: Content, drawn: Sequence[tuple[str, int, ServoFigures]]) -> Iterator[Markup]:
    known = [
        (tables.servo_name(content, lane, servo), times)
        for lane, servo, _ in drawn
        if (times := content.totals_of(lane).times.get(servo)) is not None and times.count
    ]
    if not known:
        yield tag("p", "No response time is known: the input has no clock, or no answer.")
        return
    yield tag(
        "p",
        "From the end of a request to the start of its answer. Stamps bound a time from both "
        "sides: the truth lies between the two outlines.",
        cls="dim",
    )
    scale = TimeScale([times for _, times in known])
    yield tag("div", *(histogram(title, times, scale) for title, times in known), cls="grid")


def _anomalies(content: Content) -> Iterator[Markup]:
    found = tables.anomalies(content)
    if not found:
        yield tag("p", "None.")
    for bus, kinds in found[:BUSES]:
        if len(content.summary.buses) > 1:
            yield tag("h3", bus)
        rows = [
            tag(
                "tr",
                tag("td", shape(k.severity), f" {k.severity.name.lower()}", cls="keep"),
                tag("td", k.code, cls="keep"),
                tag("td", k.times, cls="number"),
                tag("td", k.servos),
                tag("td", k.first, cls="long"),
                tag("td", k.remedy, cls="long"),
            )
            for k in kinds
        ]
        head = ("level", "code", "count", "servos", "the first one", "try")
        titles = tag("thead", tag("tr", *(tag("th", name) for name in head)))
        yield _wide(tag("table", titles, tag("tbody", *rows), cls="anomalies"))
    yield from _more(len(found) - BUSES, "buses")


def _bytes(content: Content) -> Iterator[Markup]:
    for bus, b in content.summary.buses.items():
        if not b.bytes:
            continue
        inside = round(100 * b.bytes_in_frames / b.bytes, 2)
        yield tag(
            "div",
            tag("i", cls="inside", style=f"width:{inside}%"),
            tag("i", cls="outside", style=f"width:{round(100 - inside, 2)}%"),
            cls="stack",
            role="img",
            aria_label=f"{bus}: {inside} % of the bytes are in frames",
        )
    yield _wide(_table(tables.accounted(content)))


def _recorded(content: Content) -> Iterator[Markup]:
    rows = [tag("tr", tag("th", key), tag("td", value)) for key, value in tables.recorded(content)]
    yield _wide(tag("table", tag("tbody", *rows), cls="facts"))


def _table(table: tables.Table, name: str | None = None) -> Markup:
    def cell(name: str, k: int, value: str) -> Markup:
        is_several = " / " in table.head[k]  # figures in one cell, which want room for two
        style = "number figures" if is_several else "number"
        return tag(name, value, cls=style if k in table.numbers else None)

    head = tag("tr", *(cell("th", k, title) for k, title in enumerate(table.head)))
    rows = [
        tag("tr", *(cell("td", k, value) for k, value in enumerate(r))) for r in table.rows[:ROWS]
    ]
    return tag("table", tag("thead", head), tag("tbody", *rows), cls=name)


def _more(n: int, what: str, how: str = "") -> Iterator[Markup]:
    """Yield that ``n`` more are not told; nothing where there are none."""
    if n > 0:
        one = what.removesuffix("es" if what == "buses" else "s")
        told = f"and {n} further {what if n > 1 else one}"
        yield tag("p", sentence(f"{told}: {how}." if how else f"{told}."), cls="dim")


def _wide(table: Markup) -> Markup:
    """Return a table that is moved sideways where it does not fit."""
    return tag("div", table, cls="wide", tabindex=0)
