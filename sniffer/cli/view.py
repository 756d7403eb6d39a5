"""``sniffer view``: any capture or recording in the Rerun viewer."""

from __future__ import annotations

import tempfile
from pathlib import Path

import click

from sniffer.cli.options import Whole, decoding, examples, pipeline_options, with_force
from sniffer.jobs.session import run_source, tell_lost
from sniffer.cli.streams import say
from sniffer.ground.needs import need_rerun
from sniffer.ground.registers import RegisterMap
from sniffer.jobs.outputs import open_outputs, session_facts
from sniffer.sources import open_source


@click.command(
    short_help="Show a recording or a capture in Rerun.",
    epilog=examples(
        "sniffer view recording.mcap",
        "sniffer view dump.hex --protocol rs30x --web",
        "sniffer view capture.bin -o capture.rrd",
    ),
)
@click.argument("file")
@decoding
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    help="Write the .rrd (layout inside) instead of opening a window.",
)
@with_force
@click.option("--web", is_flag=True, help="Serve it for a browser on this machine.")
@click.option("--port", type=Whole(1, 65535), help="Port of the web page.")
def view(
    file: str,
    protocol: str,
    input_format: str,
    baud: int | None,
    models: dict[int | None, str],
    tables: tuple[RegisterMap, ...],
    latency: float | None,
    output: Path | None,
    force: bool,
    web: bool,
    port: int | None,
) -> int:
    """Open FILE (a recording, or any capture) in Rerun: position, load, voltage, alarms."""
    from sniffer.viewers import viewer

    if output is not None and web:
        raise click.UsageError("-o writes a file, --web serves one: choose one")
    if port is not None and not web:
        raise click.UsageError("--port goes with --web")
    need_rerun()
    options = pipeline_options(protocol, baud, models, latency, tables)
    source = open_source(file, input_format)
    options = options.with_facts(source.facts(), source.tables)
    if output is None and not web:
        viewer.need_display(file)
    name = "standard input" if file == "-" else file
    if output is not None:
        if output.suffix != ".rrd":
            raise click.UsageError(f"{output}: the viewer's files end in .rrd")
        sinks = open_outputs([output], session_facts(file, options), file, force=force)
        _, status = run_source(source, options, sinks, name=name)
        if lost := tell_lost([output]):
            return status or lost
        say(f"wrote {output}: open it with `rerun {output}`")
        return status
    with tempfile.TemporaryDirectory(prefix="sniffer-") as folder:
        path = Path(folder) / f"{Path(file).stem or 'stdin'}.rrd"
        sinks = open_outputs([path], session_facts(file, options), file, force=True)
        _, status = run_source(source, options, sinks, name=name)
        viewer.show(path, web=web, port=port, say=say)
        return status
