"""The command line: one file a command, nothing in them but arguments and wiring.

Exit status: 0 done; 1 anomalies at or above ``--fail-on``; 2 the user's mistake, told in one line;
3 the input is damaged beyond use, or the program is not up to it: what could be read was written.
stdout is data, stderr is talk.
"""

from __future__ import annotations

import contextlib
import functools
import importlib
import io
import os
import sys
import warnings
from collections.abc import Callable, Iterator, MutableMapping, Sequence
from typing import Any, Final, TextIO

import click

from sniffer import __version__
from sniffer.cli.statuses import DAMAGED, DONE, INTERRUPTED, MISTAKE
from sniffer.cli.streams import say, silence_stdout
from sniffer.ground.loading import Loading, PluginWarning
from sniffer.ground.naming import worded
from sniffer.ground.streams import silence

DEBUG: Final = "SNIFFER_DEBUG"
"""Set to anything, it has what nobody has foreseen shown with its traceback."""


COMMANDS: Final = {
    "record": "Listen to ports and record what is said.",
    "decode": "Decode a capture, a dump, a log or a recording.",
    "diagnose": "Name what is wrong with a bus, and why.",
    "open": "Look inside a capture or a port, frame by frame.",
    "stats": "Count and measure: load, rates, times, errors.",
    "state": "Tell what each register of each servo held.",
    "query": "Ask captures in SQL.",
    "fleet": "Make one data set of many captures.",
    "compact": "Copy a data set into few large files.",
    "discover": "Find registers that no table names.",
    "view": "Show a recording or a capture in Rerun.",
    "replay": "Play a recording or a capture again.",
    "layout": "Print the Foxglove layout of a recording.",
    "convert": "Make other files of a capture, by their suffixes.",
    "cut": "Cut a part out of a capture.",
    "merge": "Make one capture of several, by time.",
    "diff": "Compare two runs, servo by servo.",
    "recover": "Repair a recording that was cut off.",
    "report": "Write a page on a capture: what was wrong, and the bytes.",
    "check": "Hold captures to rules, for CI.",
    "explain": "Draw one frame byte by byte, or tell what a code means.",
    "ports": "List the serial ports.",
    "doctor": "Check whether a port is fit to record from.",
    "simulate": "Play a bus without hardware.",
    "wireshark": "Teach Wireshark to read servo buses.",
    "protocols": "List the protocols with their models and baud rates.",
    "registers": "Show the register table of a model.",
    "completion": "Print the completion of a shell.",
    "manual": "Print the manual page.",
}
"""What each command does: loading all of them to say so would take ten times as long."""

_HOMES: Final = {"protocols": "known", "registers": "known"}
"""The files of commands that have none of their own name."""


class _Shelf(MutableMapping[str, click.Command]):
    """The commands by name, each loaded when it is taken."""

    def __init__(self) -> None:
        self._loaded: dict[str, click.Command] = {}

    def __getitem__(self, name: str) -> click.Command:
        if name not in COMMANDS:
            raise KeyError(name)
        if name not in self._loaded:
            with Loading():
                module = importlib.import_module(f"sniffer.cli.{_HOMES.get(name, name)}")
            self._loaded[name] = getattr(module, name)
        return self._loaded[name]

    def __setitem__(self, name: str, command: click.Command) -> None:
        raise TypeError("a command is a line in COMMANDS and a file")

    def __delitem__(self, name: str) -> None:
        raise TypeError("a command is a line in COMMANDS and a file")

    def __contains__(self, name: object) -> bool:
        return name in COMMANDS

    def __iter__(self) -> Iterator[str]:
        return iter(COMMANDS)

    def __len__(self) -> int:
        return len(COMMANDS)


class _Commands(click.Group):
    """Keeps Ctrl-C and what has ended from click, which has answers of its own to them.

    And loads no command but the one that is called.
    """

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl(sorted(COMMANDS.items()))

    def invoke(self, ctx: click.Context) -> object:
        try:
            with _noted(ctx):
                return super().invoke(ctx)
        except click.BadOptionUsage as error:
            if error.ctx is None and (name := ctx.invoked_subcommand) is not None:
                # click's parser knows of no command: where its help is, this one says
                command = self.get_command(ctx, name)
                error.ctx = click.Context(command, ctx, info_name=name) if command else None
            raise
        except KeyboardInterrupt:
            raise _InterruptedError from None
        except BrokenPipeError:
            raise _NobodyListensError from None
        except EOFError as error:  # nobody is asked anything: click would say that this was Ctrl-C
            raise _EndedError(error) from error


@contextlib.contextmanager
def _noted(ctx: click.Context) -> Iterator[None]:
    """Have an error say that a profile was in use: what is wrong may stand there."""
    try:
        yield
    except Exception as error:
        if (profile := ctx.meta.get("sniffer.profile")) is not None:
            error.add_note(f"profile {profile.name} of {profile.file} is in use")
        raise


class _InterruptedError(Exception):
    """Ctrl-C where nothing was there to be kept."""


class _NobodyListensError(Exception):
    """Standard output is a pipe, and it is closed."""


class _EndedError(Exception):
    """Something had an end that nobody has foreseen."""

    def __init__(self, end: EOFError) -> None:
        super().__init__(end)
        self.end = end


@click.group(
    cls=_Commands,
    commands=_Shelf(),
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="Begin with: sniffer decode FILE. Each command says more with --help.",
)
@click.version_option(__version__, "-V", "--version", prog_name="sniffer")
def cli() -> None:
    """Listen in on robot-servo buses: decode, check, record and plot what is said there."""


def run(arguments: Sequence[str]) -> int:
    """Run the command line; return the exit status. No traceback reaches the user."""
    _prepare_streams()
    with warnings.catch_warnings():
        warnings.simplefilter("always", PluginWarning)
        warnings.showwarning = functools.partial(_show_warning, warnings.showwarning)
        return _run(arguments)


def _run(arguments: Sequence[str]) -> int:
    try:
        status = cli.main(list(arguments), prog_name="sniffer", standalone_mode=False)
        sys.stdout.flush()
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.format_message())
        return MISTAKE
    except click.ClickException as error:
        from sniffer.cli.mistaken import with_help

        return _tell(with_help(error), MISTAKE)
    except (_InterruptedError, click.Abort, KeyboardInterrupt):
        return _tell("interrupted", INTERRUPTED)
    except (_NobodyListensError, BrokenPipeError):
        silence_stdout()
        return DONE
    except OSError as error:
        _debug()
        why = error.strerror or error
        if error.filename is not None:
            return _tell(f"{os.fsdecode(error.filename)}: {why}", MISTAKE)
        silence_stdout()
        return _tell(f"standard output: cannot be written ({why})", MISTAKE)
    except _EndedError as error:
        return _failed(error.end)
    except Exception as error:
        return _failed(error)
    finally:
        _end_stderr()
    return status if isinstance(status, int) else DONE


def _show_warning(
    otherwise: Callable[..., None],
    message: Warning | str,
    category: type[Warning],
    *where: Any,
    **more: Any,
) -> None:
    """Tell of a plug-in that is left out in one line, as of everything else."""
    if issubclass(category, PluginWarning):
        say(str(message))
    else:
        otherwise(message, category, *where, **more)


def _failed(error: Exception) -> int:
    """Tell what became of a command."""
    from sniffer.ground.model import DamagedInputError, SnifferError
    from sniffer.protocols.plugins import PluginError

    if isinstance(error, PluginError):
        _debug()
    if isinstance(error, SnifferError):
        notes = "".join(f" ({note})" for note in getattr(error, "__notes__", ()))
        return _tell(
            worded(error) + notes, DAMAGED if isinstance(error, DamagedInputError) else MISTAKE
        )
    _debug()
    return _last_resort(error)


def _last_resort(error: Exception) -> int:
    """Tell what nobody has foreseen; the outputs have been finished on the way here."""
    if any(isinstance(cause, KeyboardInterrupt) for cause in _chain(error)):
        return _tell("interrupted", INTERRUPTED)  # a library has made something else of it
    if isinstance(error, MemoryError):
        return _tell("there is not enough memory for it; what was decoded is kept", DAMAGED)
    what = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
    return _tell(
        f"a fault of this program ({what[:200]}); what was decoded is kept. {DEBUG}=1 shows where: "
        "please report it",
        DAMAGED,
    )


def _chain(error: BaseException) -> Iterator[BaseException]:
    """Yield an exception and those from which it came."""
    seen: set[int] = set()
    cause: BaseException | None = error
    while cause is not None and id(cause) not in seen:
        seen.add(id(cause))
        yield cause
        cause = cause.__cause__ or cause.__context__


def _debug() -> None:
    """Print where an exception came from, for who asks."""
    if os.environ.get(DEBUG):
        import traceback

        with contextlib.suppress(OSError):
            traceback.print_exc()


def _end_stderr() -> None:
    """Have the interpreter find nothing at its end that cannot be written."""
    try:
        sys.stderr.flush()
    except OSError:
        silence(sys.stderr)


def _prepare_streams() -> None:
    """Make the standard streams fit to be written to, whatever the program was started with."""
    # closed by whoever started the program (`>&-`): an output file must not take their place
    if sys.stdout is None:
        sys.stdout = _devnull()
    if sys.stderr is None:
        sys.stderr = _devnull()
    # a character that the terminal's encoding lacks is no reason to stop
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")


def _devnull() -> TextIO:
    return open(os.devnull, "w", encoding="utf-8")  # noqa: PTH123 - open to the end


def _tell(message: str, status: int) -> int:
    say(message)
    return status
