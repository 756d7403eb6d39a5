"""``sniffer wireshark``: what Wireshark needs to read servo buses, put where it looks for it."""

from __future__ import annotations

import click

from sniffer.cli.options import examples, with_force
from sniffer.cli.statuses import DONE
from sniffer.cli.streams import say
from sniffer.wireshark.install import install, pieces, uninstall
from sniffer.wireshark.places import PROFILE, places


@click.command(
    short_help="Teach Wireshark to read servo buses.",
    epilog=examples(
        "sniffer wireshark install",
        "sniffer wireshark path",
        "sniffer wireshark uninstall",
    ),
)
@click.argument("what", type=click.Choice(["install", "path", "uninstall"]))
@with_force
def wireshark(what: str, force: bool) -> int:
    """Put a dissector, a profile and a capture interface where Wireshark finds them.

    Or tell where they are and whether they are there (path), or remove them (uninstall). Only this
    user's folders are written, those that tshark names where it is there to be asked; files that
    are not of this command are left alone. Exit status: 0 done; 2 something is in the way.
    """
    where = places()
    if not where.program and what != "uninstall":
        say("there is no tshark to ask for Wireshark's folders: these are the usual ones")
    if what == "path":
        for piece in pieces(where):
            click.echo(f"{piece.what:18} {piece.state:18} {piece.path}")
    elif what == "install":
        for piece in install(where, overwrite=force):
            click.echo(f"wrote {piece.path}")
        say(f"restart Wireshark; its profile is {PROFILE!r}: wireshark -C {PROFILE} FILE.pcapng")
    else:
        removed, left = uninstall(where)
        for piece in removed:
            click.echo(f"removed {piece.path}")
        for piece in left:
            say(f"{piece.path} is not ours, or was changed since: it stays")
        if not removed:
            say("nothing of ours was there")
    return DONE
