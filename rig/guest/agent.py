"""Do what the host asks for, one JSON object a line over a virtio port.

    {"id": 1, "run": "shell text", "timeout": 60}
    {"id": 2, "sniffer": ["record", ...], "user": "tapper", "timeout": 60}
        -> {"id": 1, "rc": 0, "out": "", "err": ""}

``sniffer`` is forked from a process that has imported it already: on a translated processor the
imports take 12 s. Its process id is in /tmp/pid.ID.
"""

from __future__ import annotations

import importlib
import json
import os
import pkgutil
import pwd
import selectors
import signal
import subprocess
import sys
import time
import traceback
from pathlib import Path
from typing import Any, Final

PORTS: Final = ("/dev/virtio-ports/rig", "/dev/vport0p1")
ENV: Final = {
    "HOME": "/root",
    "LC_ALL": "C.UTF-8",
    "COLUMNS": "100",
    "OPENBLAS_NUM_THREADS": "1",
    "PATH": "/opt/sniffer/bin:/usr/sbin:/usr/bin:/sbin:/bin",
}
NOT_LOADED: Final = ("rerun", "view", "watch", "demo", "__main__", "parquet")
"""Modules that need what is not installed here, or that recording does not need."""

POLL_S: Final = 0.02

Asked = dict[str, Any]


def shell(asked: Asked) -> Asked:
    """Run shell text."""
    try:
        done = subprocess.run(
            ["/bin/sh", "-c", asked["run"]],
            capture_output=True,
            timeout=asked.get("timeout", 60),
            stdin=subprocess.DEVNULL,
            check=False,
        )
        rc, out, err = done.returncode, done.stdout, done.stderr
    except subprocess.TimeoutExpired as late:
        rc, out, err = 124, late.stdout or b"", (late.stderr or b"") + b"\ntimed out"
    return {"rc": rc, "out": out.decode(errors="replace"), "err": err.decode(errors="replace")}


def become(asked: Asked, out: int, err: int) -> None:
    """In the child: be ``sniffer``, as the user that was asked for."""
    code = 99
    try:
        os.setsid()
        null = os.open("/dev/null", os.O_RDONLY)
        for at, fd in ((0, null), (1, out), (2, err)):
            os.dup2(fd, at)
        os.closerange(3, 64)
        Path("/proc/self/comm").write_text("sniffer")
        if user := asked.get("user"):
            known = pwd.getpwnam(user)
            os.initgroups(user, known.pw_gid)
            os.setgid(known.pw_gid)
            os.setuid(known.pw_uid)
        os.chdir("/tmp")
        from sniffer.cli import run

        code = run(list(asked["sniffer"]))
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 1
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code or 0)


def sniffer(asked: Asked) -> Asked:
    """Fork ``sniffer`` and wait for its end."""
    names = [Path(f"/tmp/{kind}.{asked['id']}") for kind in ("out", "err")]
    flags = os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
    files = [os.open(name, flags, 0o666) for name in names]
    pid = os.fork()
    if not pid:
        become(asked, *files)
    Path(f"/tmp/pid.{asked['id']}").write_text(str(pid))
    until = time.monotonic() + asked.get("timeout", 60)
    rc = None
    while rc is None:
        done, status = os.waitpid(pid, os.WNOHANG)
        if done:
            rc = os.waitstatus_to_exitcode(status)
        elif time.monotonic() > until:
            os.kill(pid, signal.SIGKILL)
            until += 5
        else:
            time.sleep(POLL_S)
    out, err = (name.read_text(errors="replace") for name in names)
    return {"rc": rc, "out": out, "err": err}


def fork(asked: Asked) -> tuple[int, int]:
    """Do it in a child; its answer comes through the pipe that is returned."""
    reads, writes = os.pipe()
    pid = os.fork()
    if pid:
        os.close(writes)
        return reads, pid
    try:
        told = sniffer(asked) if "sniffer" in asked else shell(asked)
    except BaseException:
        told = {"rc": 98, "out": "", "err": traceback.format_exc()}
    with os.fdopen(writes, "w") as pipe:
        pipe.write(json.dumps({"id": asked["id"], **told}) + "\n")
    os._exit(0)


def preload() -> str:
    """Import all that recording needs; return what could not be imported."""
    import sniffer as package

    skipped = []
    for found in pkgutil.walk_packages(package.__path__, "sniffer."):
        if any(word in found.name for word in NOT_LOADED):
            continue
        try:
            importlib.import_module(found.name)
        except Exception as error:
            skipped.append(f"{found.name}: {error}")
    return "; ".join(skipped)


def connected() -> int:
    """Wait for the port to the host."""
    while True:
        for port in PORTS:
            try:
                return os.open(port, os.O_RDWR)
            except OSError:
                time.sleep(POLL_S)


def main() -> None:
    """Obey for ever."""
    os.environ.update(ENV)
    os.umask(0o022)
    fd = connected()
    with selectors.DefaultSelector() as selector:
        try:
            told = preload()
        except ImportError as error:
            told = f"not loaded: {error}"
        os.write(fd, json.dumps({"ready": told}).encode() + b"\n")
        selector.register(fd, selectors.EVENT_READ, None)
        rest = b""
        while True:
            for key, _ in selector.select():
                data = os.read(key.fd, 1 << 20)
                if key.data is None:
                    if not data:
                        time.sleep(POLL_S)
                    *lines, rest = (rest + data).split(b"\n")
                    for line in lines:
                        pipe, pid = fork(json.loads(line))
                        selector.register(pipe, selectors.EVENT_READ, [pid, b""])
                elif data:
                    key.data[1] += data
                else:
                    selector.unregister(key.fd)
                    os.close(key.fd)
                    os.waitpid(key.data[0], 0)
                    answer = key.data[1]
                    while answer:
                        answer = answer[os.write(fd, answer) :]


if __name__ == "__main__":
    main()
