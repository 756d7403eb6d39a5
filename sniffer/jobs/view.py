"""Any capture or recording in the Rerun viewer: what ``sniffer view`` calls."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from sniffer.decoding.pipeline import Options
from sniffer.ground.needs import need_rerun
from sniffer.jobs.asked import Extract
from sniffer.jobs.convert import Converted, convert_opened
from sniffer.jobs.telling import Teller
from sniffer.sources.several import inputs_of, joined, open_capture
from sniffer.viewers import viewer

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.jobs.session import Patience
    from sniffer.selection.places import Window
    from sniffer.selection.selection import Selection


def view(
    source: str | Path | Sequence[str | Path],
    options: Options | None = None,
    *,
    input_format: str = "auto",
    web: bool = False,
    port: int | None = None,
    selection: Selection | None = None,
    window: Window | None = None,
    patience: Patience | None = None,
    tell: Teller | None = None,
) -> Converted:
    """Decode a capture and show it; return when the viewer's window is closed.

    Args:
        source: a path, or ``"-"`` for standard input; several are one capture, read in the order
            of their times.
        options: how it is decoded.
        input_format: ``"auto"`` or a name of ``sniffer.sources.SOURCES``.
        web: serve it for a browser on this machine, until Ctrl-C, instead of opening a window.
        port: of the web page.
        selection: which records are shown.
        window: which part of the capture, all of it where None.
        patience: takes interruptions while it is decoded.
        tell: takes what should be told, the page's address among it.

    Raises:
        InputError: the input cannot be read, or its protocol cannot be told.
        OutputError: there is no display, or the viewer does not start.
    """
    need_rerun()
    options = options or Options()
    options.check()
    tell = tell or Teller(lambda line: None, quiet=True)
    asked = Extract.of(selection, window)
    again = asked is not None and asked.seeks
    inputs = inputs_of(source)
    with open_capture(inputs, input_format, again=again, wiring=options.wired) as opened:
        if not web:
            viewer.need_display(joined(inputs))
        with tempfile.TemporaryDirectory(prefix="sniffer-") as folder:
            path = Path(folder) / f"{Path(inputs[0]).stem or 'stdin'}.rrd"
            done = convert_opened(
                opened,
                inputs,
                [path],
                options,
                overwrite=True,
                asked=asked,
                patience=patience,
                tell=tell,
            )
            viewer.show(path, web=web, port=port, say=tell.warn)
    return done
