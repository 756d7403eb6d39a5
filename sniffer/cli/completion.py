"""``sniffer completion``: what a shell needs to complete commands, options and their words."""

from __future__ import annotations

import click
from click.shell_completion import ShellComplete, get_completion_class

from sniffer.cli.options import examples

VARIABLE = "_SNIFFER_COMPLETE"
"""By this the script asks the command, as click has it."""


@click.command(
    short_help="Print the completion of a shell.",
    epilog=examples(
        "sniffer completion bash > ~/.local/share/bash-completion/completions/sniffer",
        "sniffer completion zsh > ~/.zfunc/_sniffer",
        "sniffer completion fish > ~/.config/fish/completions/sniffer.fish",
    ),
)
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
def completion(shell: str) -> None:
    """Print the script that completes `sniffer` in SHELL: put it where the shell looks for it."""
    from sniffer.cli import cli

    known = get_completion_class(shell)
    assert known is not None  # they are click's own three
    # that of bash looks at the version of the bash that is here: the script may be for elsewhere
    click.echo(ShellComplete.source(known(cli, {}, "sniffer", VARIABLE)))
