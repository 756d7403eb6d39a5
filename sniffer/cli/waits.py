"""What a recording waits for, as people write it: ``--until``, ``--trigger``, ``--on``."""

from __future__ import annotations

import click

from sniffer.ground.model import InputError
from sniffer.tap.watching import Awaited, awaited_in


def waited_for(
    context: click.Context, parameter: click.Parameter, given: tuple[str, ...]
) -> tuple[Awaited, ...]:
    """Read what is waited for: codes, causes, rules, ``any``."""
    try:
        return tuple(map(awaited_in, given))
    except InputError as error:
        raise click.BadParameter(str(error)) from None


def commands_on(
    context: click.Context, parameter: click.Parameter, given: tuple[tuple[str, str], ...]
) -> tuple[tuple[Awaited, str], ...]:
    """Read ``--on no-response 'notify-send ...'``."""
    wanted = waited_for(context, parameter, tuple(what for what, _ in given))
    return tuple(zip(wanted, (command for _, command in given), strict=True))
