"""The command line: one file a command, nothing in them but arguments and wiring.

Exit status: 0 done; 1 anomalies at or above ``--fail-on``; 2 the user's mistake, told in one line;
3 the input is damaged beyond use, what could be read was written. stdout is data, stderr is talk.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from typing import Final

import click

from sniffer import __version__
from sniffer.cli.decode import decode
from sniffer.cli.explain import explain
from sniffer.cli.known import protocols, registers
from sniffer.cli.recover import recover
from sniffer.cli.replay import replay
from sniffer.cli.view import view
from sniffer.model import DamagedInputError, SnifferError

DONE: Final = 0
MISTAKE: Final = 2
DAMAGED: Final = 3
INTERRUPTED: Final = 130


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="sniffer")
def cli() -> None:
    """Listen in on robot-servo buses: decode, check, record and plot what is said there."""


for _command in (decode, view, replay, recover, explain, protocols, registers):
    cli.add_command(_command)


def run(arguments: Sequence[str]) -> int:
    """Run the command line; return the exit status. No traceback reaches the user."""
    try:
        status = cli.main(list(arguments), prog_name="sniffer", standalone_mode=False)
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.format_message())
        return MISTAKE
    except click.ClickException as error:
        return _tell(error.format_message(), MISTAKE)
    except click.Abort:
        return _tell("interrupted", INTERRUPTED)
    except KeyboardInterrupt:
        return _tell("interrupted", INTERRUPTED)
    except DamagedInputError as error:
        return _tell(str(error), DAMAGED)
    except SnifferError as error:
        return _tell(str(error), MISTAKE)
    except BrokenPipeError:
        quiet_stdout()
        return DONE
    except OSError as error:
        return _tell(f"{error.filename or 'output'}: {error.strerror or error}", MISTAKE)
    return status if isinstance(status, int) else DONE


def _tell(message: str, status: int) -> int:
    line = " ".join(message.split())
    click.echo(f"sniffer: {line}", err=True)
    return status


def quiet_stdout() -> None:
    """Let nothing complain about the closed pipe when the interpreter flushes at its end."""
    devnull = os.open(os.devnull, os.O_WRONLY)
    os.dup2(devnull, sys.stdout.fileno())
    os.close(devnull)
