"""Options that several commands share, and what they mean for the pipeline."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final

import click

from sniffer.decoding.pipeline import AUTO, Options
from sniffer.ground.limits import BAUDS, IDS, number_in
from sniffer.protocols import PROTOCOLS
from sniffer.sources import SOURCES

SHARED: Final = "Open a port that another program has open, too; its settings change under it."
"""What ``--shared`` does, in the commands that open ports."""

printed = click.option(
    "--format",
    "output_format",
    type=click.Choice(["text", "jsonl"]),
    default="text",
    show_default=True,
    help="What is printed.",
)
"""For people, or for scripts."""


with_force = click.option("--force", is_flag=True, help="Replace files that are there.")
"""Of every command that writes a file."""


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


def examples(*lines: str) -> str:
    """Return the end of a command's help, in lines as they are."""
    return "\b\nExamples:\n" + "\n".join(f"  {line}" for line in lines)


def models(
    context: click.Context, parameter: click.Parameter, given: tuple[str, ...]
) -> dict[int | None, str]:
    """Read ``--model ID=MODEL`` (one servo) or ``--model MODEL`` (all of them)."""
    known = {m.model for p in PROTOCOLS.values() for m in p.models}
    out: dict[int | None, str] = {}
    for text in given:
        who, equals, model = text.rpartition("=")
        if model not in known:
            raise click.BadParameter(f"no model {model[:40]!r}: one of {', '.join(sorted(known))}")
        servo = number_in(who, 0, IDS - 1)
        if equals and servo is None:
            raise click.BadParameter(
                f"{text[:40]!r}: write ID=MODEL with an id of 0..255, or MODEL"
            )
        out[servo] = model
    # what is said of one servo wins over what is said of all
    return dict(sorted(out.items(), key=lambda e: e[0] is not None))


def decoding(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options that say how bytes are to be read."""
    for option in reversed(
        (
            click.option(
                "--protocol",
                type=click.Choice([AUTO, *PROTOCOLS]),
                default=AUTO,
                show_default=True,
                help="What is spoken on the bus; auto tells it from the bytes.",
            ),
            click.option(
                "--input-format",
                type=click.Choice(["auto", *SOURCES]),
                default="auto",
                show_default=True,
                help="Form of the input; auto tells it from its beginning.",
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
            click.option(
                "--latency",
                type=Finite(0, 1000),
                metavar="MS",
                help="How long the adapter may have held bytes back.",
            ),
        )
    ):
        command = option(command)
    return command


def pipeline_options(
    protocol: str,
    baud: int | None,
    models: dict[int | None, str],
    latency: float | None,
) -> Options:
    """Return the options as the pipeline takes them."""
    return Options(
        protocol=protocol,
        baud=baud,
        models=models,
        latency_ns=None if latency is None else int(latency * 1e6),
    )
