"""An object store on this machine, which refuses what it is told to refuse."""

from __future__ import annotations

import contextlib
import logging
import threading
from typing import TYPE_CHECKING, Any

import pytest

from sniffer.fleet.store import Store

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator
    from pathlib import Path

REFUSED = b"<Error><Code>AccessDenied</Code><Message>refused</Message></Error>"


class ObjectServer:
    """S3 as moto has it, behind a door: requests are noted, and some are refused."""

    def __init__(self) -> None:
        from moto.moto_server.werkzeug_app import DomainDispatcherApplication, create_backend_app

        self._behind: Any = DomainDispatcherApplication(create_backend_app)
        self.requests: list[tuple[str, str]] = []
        self.refuses: Callable[[str, str], bool] = lambda method, path: False

    def __call__(self, environ: dict[str, Any], start: Any) -> Iterable[bytes]:
        from werkzeug.wsgi import get_input_stream

        method = environ["REQUEST_METHOD"]
        path = f"{environ['PATH_INFO']}?{environ['QUERY_STRING']}"
        self.requests.append((method, path))
        if self.refuses(method, path):
            get_input_stream(environ).read()
            start("403 Forbidden", [("Content-Type", "application/xml")])
            return [REFUSED]
        answer: Iterable[bytes] = self._behind(environ, start)
        return answer


@contextlib.contextmanager
def serving() -> Iterator[ObjectServer]:
    """Serve a store with a bucket ``bucket`` on this machine, to this process."""
    pytest.importorskip("moto", reason="moto, the object store, is not installed")
    import pyarrow.fs as pafs
    from moto.moto_server.werkzeug_app import MotoRequestHandler
    from werkzeug.serving import make_server

    logging.getLogger("werkzeug").setLevel(logging.ERROR)  # a line a request
    door = ObjectServer()
    server = make_server("127.0.0.1", 0, door, threaded=True, request_handler=MotoRequestHandler)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("AWS_ENDPOINT_URL", f"http://127.0.0.1:{server.port}")
        patch.setenv("AWS_ACCESS_KEY_ID", "nobody")
        patch.setenv("AWS_SECRET_ACCESS_KEY", "nothing")
        patch.setenv("AWS_DEFAULT_REGION", "us-east-1")
        patch.delenv("AWS_ENDPOINT_URL_S3", raising=False)
        system = pafs.S3FileSystem(
            endpoint_override=f"http://127.0.0.1:{server.port}", allow_bucket_creation=True
        )
        system.create_dir("bucket")
        try:
            yield door
        finally:
            server.shutdown()
            thread.join()
            server.server_close()


def copied(uri: str, folder: Path) -> Path:
    """Copy what lies below a place of the store into a folder of this machine."""
    store = Store.of(uri)
    for file in store.files(deep=True):
        target = folder / file.path
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(store.get_bytes(file.path))
    return folder
