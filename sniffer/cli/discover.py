"""``sniffer discover``: registers that no table names, by what their bytes do."""

from __future__ import annotations

import click

from sniffer.cli.options import decoding, examples, with_files, with_format, with_quiet
from sniffer.cli.selecting import say_selected, with_part, with_rows
from sniffer.cli.signals import patient
from sniffer.cli.statuses import status_of
from sniffer.decoding.options import Options
from sniffer.ground.registers import RegisterMap
from sniffer.ground.wording import and_, plain
from sniffer.jobs.discover import Discovered
from sniffer.jobs.discover import discover as find
from sniffer.jobs.telling import Teller
from sniffer.selection.places import Window
from sniffer.selection.selection import Selection
from sniffer.statistics.guesses import FieldGuess, place, runs


@click.command(
    short_help="Find registers that no table names.",
    epilog=examples(
        "sniffer discover run.mcap",
        "sniffer discover run.mcap --servo 3 --from 10 --to 20",
        "sniffer discover run.mcap --format toml --model-name my-servo > my_servo.toml",
        "sniffer decode run.mcap --registers my_servo.toml --model my-servo",
    ),
)
@with_files
@with_part
@with_rows
@decoding
@with_format("text", "toml", about="What is printed: toml is a register table to begin with.")
@click.option(
    "--model-name",
    default="my-servo",
    show_default=True,
    metavar="MODEL",
    help="The model of that table.",
)
@with_quiet
def discover(
    files: tuple[str, ...],
    options: Options,
    input_format: str,
    output_format: str,
    model_name: str,
    window: Window | None,
    selection: Selection | None,
    tell: Teller,
) -> int:
    """Say of bytes in FILE that no register table names what they do.

    Several are one capture, read in the order of their times: such as the files of a rotation.

    Which are constant, which count, which two are one number, which bits flip together, and which
    known values (goals, positions, loads ...) they go with. With --format toml it is a register
    table, the one that the servos are read by with what was found behind it; --registers takes it.
    """
    with patient() as patience:
        done = find(
            files,
            options,
            input_format=input_format,
            window=window,
            selection=selection,
            patience=patience,
            tell=tell,
        )
    say_selected(done.summary, tell)
    if output_format == "toml":
        table = done.stub(model_name)
        RegisterMap.from_text(table, model_name)  # a name that is none is told here
        click.echo(table, nl=False)
    else:
        _print(done)
    return status_of(done.ending, is_lost=False)


def _print(done: Discovered) -> None:
    """Print what was found, servos of which the same is said together."""
    for bus, found in done.found.items():
        if not found:
            click.echo(f"{bus}: a table names every byte that was read or written")
        alike: dict[tuple[str, ...], list[int]] = {}
        for servo in dict.fromkeys(guess.servo_id for guess in found):
            mine = [guess for guess in found if guess.servo_id == servo]
            head = f"that {done.tables[bus, servo].model} does not name"
            ordered = sorted(runs(mine), key=lambda run: run[0].is_constant)  # what moves first
            alike.setdefault((head, *map(_line, ordered)), []).append(servo)
        for (head, *lines), servos in alike.items():
            who = and_([done.summary.names.label(bus, servo) for servo in servos])
            several = "s" if len(servos) > 1 else ""
            click.echo(plain(f"{bus}: bytes of servo{several} {who} {head}"))
            for line in lines:
                click.echo(plain(line))


def _line(run: list[FieldGuess]) -> str:
    first = run[0]
    how = "written" if first.is_write else "read"
    return f"  {place(run):<10} {first.type:<5} {how} {first.count}×  {first.sentence()}"
