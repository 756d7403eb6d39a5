"""What is said of a call that cannot be: what was meant, which command does it, where to read."""

from __future__ import annotations

import re
from typing import Final

import click

from sniffer.ground.wording import and_, nearly


def with_help(error: click.ClickException) -> str:
    """Return what is wrong with a call, and where to read how it is right unless that is said."""
    from sniffer.cli.profiles import blamed

    told = blamed(error, error.format_message())
    if isinstance(error, click.NoSuchOption) and not error.option_name.startswith("--h"):
        told = told.removesuffix(" Did you mean '--help'?")  # some of its letters are in any
    if isinstance(error, click.BadParameter) and (meant := _meant(error)):
        return told.rstrip(".") + meant
    if isinstance(error, click.NoSuchOption) and (why := _otherwise(error)):
        return f"No such option '{error.option_name}': {why}"
    unknown = _NO_COMMAND.match(told)
    if unknown and (others := _who_does(error, unknown[1])):
        return f"{unknown[0]}: {others}"
    if unknown and told == f"{unknown[0]}.":  # nothing is like it
        return f"{unknown[0]}: `sniffer --help` lists those there are"
    vague = isinstance(error, click.MissingParameter | click.NoSuchOption | click.BadOptionUsage)
    if not (vague or told.startswith("Got unexpected extra argument")):
        return told
    ctx = error.ctx if isinstance(error, click.UsageError) else None
    if isinstance(error, click.NoSuchOption) and (others := _who_takes(error)):
        told = f"No such option '{error.option_name}': {others};"
    else:
        told = f"{told.rstrip('.')}:"
    path = ctx.command_path if ctx else "sniffer"
    if ctx and any("--example" in param.opts for param in ctx.command.params):
        return f"{told} see `{path} --help`, and `{path} --example` for rules to begin with"
    return f"{told} see `{path} --help`"


_NO_COMMAND: Final = re.compile(r"No such command '([^']+)'")


def _who_does(error: click.ClickException, word: str) -> str:
    """Return which commands say of themselves in a line that they do what a word says."""
    group = error.ctx.command if isinstance(error, click.UsageError) and error.ctx else None
    if not isinstance(group, click.Group):
        return ""
    told = {name: command.get_short_help_str(200) for name, command in group.commands.items()}
    does = [name for name, words in _ALSO_CALLED.items() if word.lower() in words.split()]
    does = does or [
        n for n, line in told.items() if word.lower() in re.findall(r"\w+", line.lower())
    ]
    if not 0 < len(does) <= _FEW:
        return ""
    meant = [f"'{name}' ({told[name].rstrip('.')})" for name in does]
    return f"did you mean {' or '.join(meant)}?"


_ALSO_CALLED: Final = {
    "decode": "show print cat dump parse log read filter grep search find",
    "stats": "info summary statistics measure rates latency timing jitter",
    "record": "tail watch monitor capture listen sniff live",
    "convert": "export save transform csv parquet",
    "view": "plot graph chart rerun",
    "cut": "trim slice split extract crop",
    "merge": "join concat combine",
    "check": "test verify validate assert ci",
    "query": "sql select duckdb",
    "state": "servos settings config",
    "ports": "devices adapters",
    "open": "browse tui inspect",
}
"""What else people call what a command does, where its line of help does not say so."""

_FEW: Final = 3
"""More commands than that are not named: nobody could choose."""


def _who_takes(error: click.NoSuchOption) -> str:
    """Return which other commands have an option, where they are few."""
    group = error.ctx.parent.command if error.ctx and error.ctx.parent else None
    if not isinstance(group, click.Group):
        return ""
    takers = [
        f"`sniffer {name}`"
        for name, command in group.commands.items()
        if any(error.option_name in (*p.opts, *p.secondary_opts) for p in command.params)
    ]
    if not 0 < len(takers) <= _FEW:
        return ""
    return f"{and_(takers)} {'take' if len(takers) > 1 else 'takes'} it"


_BEFORE_END: Final = "--from", "--from -5s begins 5 s before the end"
_BEHIND_BEGIN: Final = "--to", "--to 5s ends 5 s behind the beginning"
_OTHERWISE: Final = {
    **dict.fromkeys(("--last", "--tail"), _BEFORE_END),
    **dict.fromkeys(("--first", "--head"), _BEHIND_BEGIN),
    **dict.fromkeys(("--since", "--start", "--begin"), ("--from", "--from 10s begins there")),
    **dict.fromkeys(("--until", "--end", "--stop"), ("--to", "--to 20s ends there")),
    **dict.fromkeys(("--id", "--servos"), ("--servo", "--servo 3,5 selects servos")),
    **dict.fromkeys(
        ("--at", "--time", "--when"),
        ("--around", "--from 20s --around 1s is the time about it, --to 20s all before"),
    ),
    **dict.fromkeys(
        ("--error", "--errors"), ("--where", "--where \"severity = 'error'\" selects them")
    ),
    **dict.fromkeys(
        ("--quantity", "--register"),
        ("--where", "--where \"quantity = 'voltage'\" selects what is said of it"),
    ),
}
"""What others call an option: the one that a command has, and what it does."""


def _otherwise(error: click.NoSuchOption) -> str | None:
    """Return what a command has for an option that others call so, or why it has none.

    That may be a form of what is printed: ``--format jsonl`` for ``--json``.
    """
    option, does = _OTHERWISE.get(error.option_name, ("", ""))
    params = error.ctx.command.params if error.ctx else ()
    if any(option in param.opts for param in params):
        return does
    forms = [
        form
        for param in params
        if "--format" in param.opts
        for form in getattr(param.type, "choices", ())
        if f"--{form}".startswith(error.option_name) and error.option_name.startswith("--")
    ]
    return f"--format {forms[0]} prints that" if forms else _selects_no_rows(error)


_JUDGES: Final = (
    "all that was said is judged; `sniffer decode` and `sniffer stats` take rows, --from and --to "
    "a part here, too"
)
_NO_ROWS: Final = {
    "diagnose": _JUDGES,
    "report": _JUDGES,
    "check": _JUDGES,
    "cut": "a part has every byte of its buses; `sniffer convert FILE x.log` writes frames alone",
}
"""Why commands that read captures select no rows."""


def _selects_no_rows(error: click.NoSuchOption) -> str | None:
    """Return why a command has none of the options that select rows in others."""
    from sniffer.cli.selecting import row_options

    name = error.ctx.command.name if error.ctx else None
    return _NO_ROWS.get(name or "") if error.option_name in row_options() else None


_FILES: Final = ("csv", "parquet", "mcap", "rrd", "log", "bin", "hex")
"""What many look for among the forms of text: the suffixes of files."""


def _meant(error: click.BadParameter) -> str:
    """Return the question whether another of an option's words was meant, or nothing."""
    words = getattr(error.param.type if error.param else None, "choices", ())
    given = re.match(r"'([^']*)' is not one of", error.message)
    if not given or not words:
        return ""
    suffix = {"candump": "log"}.get(given[1], given[1])
    if error.ctx and error.ctx.command.name == "decode" and suffix in _FILES:
        return f"; files are made by `sniffer convert FILE x.{suffix}`"
    return nearly(given[1], map(str, words))
