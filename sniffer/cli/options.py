"""Options that several commands share, and what they mean for the pipeline."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from sniffer.cli.profiles import with_profile
from sniffer.cli.servos import models, with_names, with_registers
from sniffer.cli.wires import WIRES, wiring_of
from sniffer.ground.amounts import period_in, time_as, time_in
from sniffer.ground.limits import BAUDS
from sniffer.ground.registers import RegisterMap
from sniffer.ground.wording import nearly
from sniffer.protocols import PROTOCOLS

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

    from sniffer.anomalies.alarms import Alarm
    from sniffer.decoding.called import Named
    from sniffer.decoding.options import Options
    from sniffer.protocols.base import BusProtocol

    _Name = click.ParamType[str]
else:
    _Name = click.ParamType  # click 8.1 has no other name for it

Command = Callable[..., Any]
Gather = Callable[[dict[str, Any]], dict[str, Any]]

SHARED: Final = "Open a port that another program has open, too; its settings change under it."
"""What ``--shared`` does, in the commands that open ports."""


def with_format(*forms: str, about: str = "What is printed.") -> Callable[[Command], Command]:
    """Return ``--format``, the first form being the usual one: for people, or for scripts."""
    return click.option(
        "--format",
        "output_format",
        type=click.Choice(forms),
        default=forms[0],
        show_default=True,
        help=about,
    )


def gathered(
    command: Command, options: Sequence[Callable[[Command], Command]], gather: Gather
) -> Command:
    """Add options to a command, which gets what ``gather`` makes of all that is given."""
    import functools

    @functools.wraps(command)
    def called(**given: Any) -> Any:
        return command(**gather(given))

    out: Command = called
    for option in reversed(options):
        out = option(out)
    return out


class Renamed(click.Option):
    """An option that was called otherwise before; its ``former`` names work and are not listed."""

    def __init__(self, *names: Any, former: tuple[str, ...], **attributes: Any) -> None:
        super().__init__(*names, **attributes)
        self._former = former

    def add_to_parser(self, parser: Any, ctx: click.Context) -> None:
        """Have the parser know all names; help and errors tell the present ones."""
        super().add_to_parser(parser, ctx)
        present, self.opts = self.opts, [*self._former]
        try:
            super().add_to_parser(parser, ctx)
        finally:
            self.opts = present


def _colored(context: click.Context, parameter: click.Parameter, given: str | None) -> bool | None:
    """Read ``--color``; None leaves it to the stream."""
    return {"always": True, "never": False}.get(given or "")


with_color = click.option(
    "--color",
    type=click.Choice(["auto", "always", "never"]),
    callback=_colored,
    help="Colours: auto has them on a terminal, unless NO_COLOR is set.  [default: auto]",
)
"""Of every command that prints colours on standard output."""


with_times = click.option(
    "--time",
    "times",
    type=click.Choice(["abs", "rel", "delta"]),
    default="abs",
    show_default=True,
    help="Times in the table: of the clock, since the first line of all, shown or not, since the "
    "line before of the same bus.",
)
"""Of every command that prints a line a frame."""


with_together = click.option(
    "--together",
    is_flag=True,
    help="The FILEs are one capture, read in the order of their times, as decode takes them: such "
    "as those of a rotation.",
)
"""Of every command that takes its files one by one, as captures of their own."""


def captures_in(files: tuple[str, ...], *, together: bool) -> list[tuple[str, ...]]:
    """Return the files of each capture."""
    return [files] if together else [(file,) for file in files]


def with_every(least_ns: int, about: str) -> Callable[[Command], Command]:
    """Return ``--every``, a step of time in ns (``every_ns``), None where none is asked for."""

    def read(context: click.Context, parameter: click.Parameter, given: str | None) -> int | None:
        ns = None if given is None else time_in(given, bare=True, least=least_ns)
        if given is not None and ns is None:
            least = f"{least_ns / 1e6:g} ms or more"
            period_ns = period_in(given, least=least_ns)
            such = "such as 1s or 100ms" if period_ns is None else f"here {time_as(period_ns)}"
            raise click.BadParameter(f"{given!r}: write a time of {least}, {such}")
        return ns

    return click.option("--every", "every_ns", callback=read, metavar="TIME", help=about)


with_force = click.option("--force", is_flag=True, help="Replace files that are there.")
"""Of every command that writes a file."""


def with_quiet(command: Command) -> Command:
    """Add -q to a command, which gets ``tell``: what it says beside its data goes through that."""

    def gather(given: dict[str, Any]) -> dict[str, Any]:
        from sniffer.cli.streams import say
        from sniffer.jobs.telling import Teller

        tell = Teller(say, quiet=given.pop("quiet"))
        return {**given, "tell": tell}

    quiet = click.option("-q", "--quiet", is_flag=True, help="Say only what goes wrong.")
    return gathered(command, [quiet], gather)


with_anonymise = click.option(
    "--anonymise",
    is_flag=True,
    help="Times count from zero; names, ports and serial numbers are left out.",
)
"""Of every command that makes captures of captures."""


def with_outputs(about: str) -> Callable[[Command], Command]:
    """Return ``-o``, of commands whose files are what is asked for."""
    return click.option(
        "-o",
        "--output",
        "outputs",
        required=True,
        multiple=True,
        type=click.Path(path_type=Path),
        help=f"{about}; the suffix says what (see sniffer convert). May be repeated.",
    )


class Whole(click.IntRange):
    """A whole number in a range."""

    name = "integer"


class Finite(click.FloatRange):
    """A number in a range; NaN and infinity are in none."""

    name = "number"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """Read a number."""
        number = float(super().convert(value, param, ctx))
        if not math.isfinite(number):
            self.fail(f"{value!r} is no number to reckon with.", param, ctx)
        return number


class ProtocolName(_Name):
    """A protocol: a name, the file of a plug-in, or two that share a wire (``a+b``).

    Plug-ins are listed when names are asked for.

    ``beside`` are words that may stand there instead; ``plugins``: more than the built-in ones.
    """

    name = "protocol"

    def __init__(self, *beside: str, plugins: bool = True) -> None:
        self._beside = beside
        self._plugins = plugins

    def get_metavar(self, param: click.Parameter, ctx: click.Context | None = None) -> str:
        """Return the names, as help shows them."""
        names = (*self._beside, *(PROTOCOLS if self._plugins else PROTOCOLS.built_in))
        if param.param_type_name == "argument":
            return f"{{{'|'.join(names)}}}"
        return f"[{'|'.join((*names, 'FILE.py'))}]"

    def shell_complete(
        self, ctx: click.Context, param: click.Parameter, incomplete: str
    ) -> list[CompletionItem]:
        """Return the names that begin so."""
        from click.shell_completion import CompletionItem

        names = (*self._beside, *(PROTOCOLS if self._plugins else PROTOCOLS.built_in))
        return [CompletionItem(name) for name in names if name.startswith(incomplete)]

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Take a name that is known; one that cannot be used says why."""
        from sniffer.decoding.names import is_known, protocols_named

        named = str(value)
        if named not in self._beside:
            if not is_known(named):
                known = (*self._beside, *PROTOCOLS)
                listed = ", ".join(map(repr, known))
                others = "; others are declared in a FILE.py of yours (docs/plugins.md)"
                told = f"{named!r} is not one of {listed}{nearly(named, known) or others}"
                if param is None or param.param_type_name != "argument":
                    self.fail(told, param, ctx)
                # its metavar has all names once more
                raise click.BadParameter(told, ctx, param_hint=f"'{param.human_readable_name}'")
            protocols_named(named)
        return named


def files_here(
    context: click.Context, parameter: click.Parameter, incomplete: str
) -> list[CompletionItem]:
    """Have a shell complete an argument by the files there are."""
    from click.shell_completion import CompletionItem

    return [CompletionItem(incomplete, type="file")]


def completing(
    words: Callable[[], Iterable[str]],
) -> Callable[[click.Context, click.Parameter, str], list[CompletionItem]]:
    """Return what has a shell complete one of some words, or the last of a list of them."""

    def complete(
        context: click.Context, parameter: click.Parameter, incomplete: str
    ) -> list[CompletionItem]:
        from click.shell_completion import CompletionItem

        before, comma, last = incomplete.rpartition(",")
        return [
            CompletionItem(f"{before}{comma}{word}") for word in words() if word.startswith(last)
        ]

    return complete


with_files = click.argument(
    "files", shell_complete=files_here, metavar="FILE...", nargs=-1, required=True
)
"""Of every command that reads several captures, or one in several files."""


def examples(*lines: str) -> str:
    """Return the end of a command's help, in lines as they are."""
    return "\b\nExamples:\n" + "\n".join(f"  {line}" for line in lines)


def decoding(command: Command) -> Command:
    """Add the options that say how bytes are to be read; ``options`` is what they say.

    So it is of ``with_alarms``, where a command has it. What servos are called is said, too.
    """
    return decoding_unnamed(with_names(command))


def decoding_unnamed(command: Command) -> Command:
    """Add the same for a command that shows servos to nobody."""
    from sniffer.decoding.options import AUTO
    from sniffer.sources import SOURCES

    return gathered(
        command,
        (
            click.option(
                "--protocol",
                type=ProtocolName(AUTO),
                default=AUTO,
                show_default=True,
                help="What is spoken on the bus (a+b: two share it); auto tells it from the bytes.",
            ),
            click.option(
                "--input-format",
                type=click.Choice(["auto", *SOURCES]),
                default="auto",
                metavar="FORM",
                help=f"Form of the input: {', '.join(SOURCES)}; auto tells it.  [default: auto]",
            ),
            click.option("--baud", type=Whole(*BAUDS), help="Bits per second."),
            click.option(
                "--model",
                "models",
                multiple=True,
                callback=models,
                metavar="[ID=]MODEL",
                help="Register table of a servo (or of all); may be repeated.",
            ),
            with_registers,
            click.option(
                "--latency",
                type=Finite(0, 1000),
                metavar="MS",
                help="How long the adapter may have held bytes back.",
            ),
            *WIRES,
            with_profile,
        ),
        _options,
    )


def _options(given: dict[str, Any]) -> dict[str, Any]:
    told = {name: given.pop(name) for name in _DECODING if name in given}
    wiring = wiring_of(given)
    return {**given, "options": replace(pipeline_options(**told), wiring=wiring)}


_DECODING: Final = ("protocol", "baud", "models", "latency", "tables", "alarms", "names")


def pipeline_options(
    protocol: str,
    baud: int | None,
    models: dict[int | None, str],
    latency: float | None,
    tables: tuple[RegisterMap, ...],
    also: Iterable[str | BusProtocol] = (),
    alarms: tuple[Alarm, ...] = (),
    names: Mapping[Named, str] | None = None,
) -> Options:
    """Return the options as the pipeline takes them; ``also`` are protocols of single buses.

    Raises:
        SnifferError: a model is not known, or a table or a rule is of no use.
    """
    from sniffer.decoding.options import Options

    options = Options(
        protocol=protocol,
        baud=baud,
        models=models,
        latency_ns=None if latency is None else int(latency * 1e6),
        tables=tables,
        alarms=alarms,
        names=names or {},
    )
    options.check(also)
    return options
