"""The servos of a recording: they answer a controller as they did."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sniffer.ground.codes import NEVER
from sniffer.ground.codes import REQUEST as ASKS
from sniffer.ground.model import NS
from sniffer.ground.wording import counted
from sniffer.playback.exchanges import RequestKey
from sniffer.playback.recollection import Ground, Recollection
from sniffer.simulation.hearing import Ears
from sniffer.simulation.listener import LineListener, Uttered
from sniffer.simulation.talk import NOISE, REQUEST, RESPONSE, TrueFrame

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sniffer.playback.exchanges import RecordedExchange
    from sniffer.protocols.base import BusProtocol


class ServoAnswers:
    """What became of a controller's requests.

    ``answered`` as recorded, ``alike`` by the reply to a request with other contents, ``missing``
    because the recording has no reply either, ``unanswerable`` where nothing can be expected.
    ``unknown`` are kinds of requests that the recording has nothing like, with how often and their
    first bytes.
    """

    def __init__(self) -> None:
        self.answered = self.alike = self.missing = self.unanswerable = 0
        self.noise_bytes = 0
        self.unknown: dict[str, int] = {}
        self.examples: dict[str, bytes] = {}

    def lines(self) -> list[str]:
        """Return it for people: one line in all, and one for each kind that is not known."""
        parts = [f"{counted(self.answered, 'request')} answered as recorded"]
        if self.alike:
            parts.append(f"{self.alike} as others of the same servo and registers")
        if self.missing:
            parts.append(f"{self.missing} left without answer as recorded")
        if self.unanswerable:
            parts.append(f"{self.unanswerable} that need none")
        if self.noise_bytes:
            parts.append(f"{counted(self.noise_bytes, 'byte')} of no request")
        out = [", ".join(parts)]
        for kind, count in self.unknown.items():
            example = self.examples[kind].hex(" ").upper()
            out.append(f"never asked in the recording: {kind}: {count} times, as {example}")
        return out


class RecordedServos(LineListener):
    """Hears requests and says what was said to them; see ``Recollection`` for which.

    One thing is on the line at a time: what comes while a reply is under way has its turn behind
    it. ``carried``: bytes that are heard have already taken their time on a wire.
    """

    def __init__(
        self,
        protocol: BusProtocol,
        exchanges: Sequence[RecordedExchange],
        *,
        baud: int,
        carried: bool,
        models: Mapping[int | None, str],
    ) -> None:
        super().__init__(protocol)
        self.answers = ServoAnswers()
        self._recollection = Recollection(exchanges)
        self._ears = Ears(protocol, models)
        self._baud = baud
        self._carried = carried
        self._free_ns = 0
        self._before = b""  # the request before, if that is what was heard last

    def noise(self, data: bytes, now_ns: int) -> list[Uttered]:
        """Let bytes of nobody take their time."""
        if not data:
            return []
        self.answers.noise_bytes += len(data)
        return [Uttered(self._heard(data, NOISE, now_ns), False)]

    def frame(self, raw: bytes, kind: int, now_ns: int) -> list[Uttered]:
        """Answer a request as it was answered."""
        heard, message = self._ears.read(raw, kind, self._before)
        asks = heard.kind == ASKS
        self._before = raw if asks else b""
        out = [Uttered(self._heard(raw, REQUEST if asks else RESPONSE, now_ns), False)]
        if not asks:
            return out
        asked_ns = self._free_ns
        key = RequestKey.heard(heard)
        found = self._recollection.find(raw, key)
        if found is None:
            self._unknown(key, message.op, raw, heard.reply == NEVER)
            return out
        replies = found.exchange.replies
        said = ((reply.data, RESPONSE, asked_ns + reply.delay_ns) for reply in replies)
        out += [Uttered(self._say(*one), True) for one in said]
        told = self.answers
        if not replies:
            told.missing += found.exchange.waits
            told.unanswerable += not found.exchange.waits
        elif found.ground == Ground.SAME:
            told.answered += 1
        else:
            told.alike += 1
        return out

    def _unknown(self, key: RequestKey, op: str, raw: bytes, needs_none: bool) -> None:
        if needs_none:
            self.answers.unanswerable += 1
            return
        who = f"servo {key.servo_id}" if key.servo_id >= 0 else "all servos"
        place = f" at {key.address:#04x}" if key.address >= 0 else ""
        kind = f"{op} of {who}{place}"
        self.answers.unknown[kind] = self.answers.unknown.get(kind, 0) + 1
        self.answers.examples.setdefault(kind, raw)

    def _heard(self, data: bytes, kind: str, now_ns: int) -> TrueFrame:
        began = now_ns - self._wire_ns(len(data)) if self._carried else now_ns
        return self._say(data, kind, began)

    def _say(self, data: bytes, kind: str, at_ns: int) -> TrueFrame:
        start = max(at_ns, self._free_ns)
        self._free_ns = start + self._wire_ns(len(data))
        return TrueFrame(start, self._free_ns, data, data, kind, -1, "")

    def _wire_ns(self, size: int) -> int:
        return -(-size * 10 * NS // self._baud)
