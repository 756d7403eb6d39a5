"""Build the machine once: kernel, initrd and disk image, from the packages that apt and pip know.

    python -m rig.build [--work DIR]

Debian (bookworm or newer); no network but the registries that apt and pip are set up for. It is
done as root: with sudo, for who is not. Each step leaves a stamp with what it was made from and is
done again when that has changed.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import re
import shutil
import subprocess
import sys
import time
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Callable

HERE: Final = Path(__file__).resolve().parent
SOURCE: Final = HERE.parent
HOST_PACKAGES: Final = ("qemu-system-x86", "mmdebstrap", "busybox-static")
GUEST_PACKAGES: Final = (
    *("systemd", "systemd-sysv", "udev", "kmod", "python3", "python3-venv", "passwd"),
    *("mount", "procps"),
)
KERNEL: Final = "linux-image-amd64"
"""Not the one for clouds, which has neither usbserial nor xhci."""

BOOT_MODULES: Final = ("virtio_pci", "virtio_blk", "ext4", "crc32c_generic")
"""In the initrd; the rest is loaded by udev. What a kernel has built in is left out."""

MODULES: Final = (
    *("virtio_console", "9p", "9pnet_virtio", "xhci_pci", "usbserial", "ftdi_sio", "cp210x"),
    *("ch341", "pl2303", "cdc_acm", "vhci_hcd"),
)
NOT_IN_GUEST: Final = ("rerun-sdk", "pyarrow")
"""Large, and recording does not import them."""

PLATFORMS: Final = ("_2_28", "_2_27", "_2_17", "2014")
SMALLER: Final = [f"--dpkgopt=path-exclude=/usr/share/{d}/*" for d in ("man", "doc", "locale")]
MASKED: Final = (
    *("systemd-timesyncd", "getty@tty1", "serial-getty@ttyS0", "apt-daily.timer"),
    *("apt-daily-upgrade.timer", "dpkg-db-backup.timer", "e2scrub_reap", "fstrim.timer"),
    *("systemd-update-utmp", "systemd-pstore", "systemd-hwdb-update", "systemd-binfmt"),
    *("ldconfig", "modprobe@efi_pstore", "modprobe@drm"),
)
SPARE_MB: Final = 300
"""Room on the disk for what the guest writes."""

INIT: Final = """#!/bin/busybox sh
b=/bin/busybox
$b mount -t devtmpfs d /dev
$b mount -t proc p /proc
{loads}
while ! [ -b /dev/vda ]; do $b usleep 20000; done
$b mount -t ext4 -o noatime /dev/vda /new
for word in $($b cat /proc/cmdline); do
    case $word in rig.init=*) init=${{word#rig.init=}};; esac
done
$b umount /dev; $b umount /proc
exec $b switch_root /new $init
"""

AGENT_UNIT: Final = """[Unit]
DefaultDependencies=no
After=systemd-udevd.service systemd-journald.socket
Wants=systemd-udevd.service
[Service]
ExecStartPre=/sbin/modprobe -a virtio_console 9pnet_virtio 9p xhci_pci
ExecStartPre=/bin/mount -t 9p -o trans=virtio,version=9p2000.L,ro,cache=loose,msize=262144 src /src
ExecStart=/opt/sniffer/bin/python3 -u /src/rig/guest/agent.py
StandardOutput=journal+console
StandardError=journal+console
"""


def cache() -> Path:
    """Return where the image is kept: outside the checkout."""
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "servo-sniffer-rig"


def run(*command: object, cwd: Path | None = None, env: dict[str, str] | None = None) -> str:
    """Run a command that must succeed; return what it printed."""
    words = [str(word) for word in command]
    done = subprocess.run(words, cwd=cwd, env=env, check=True, text=True, stdout=subprocess.PIPE)
    return done.stdout


def host_packages() -> None:
    """Install what this machine needs."""
    missing = [
        package
        for package in HOST_PACKAGES
        if "ok installed"
        not in subprocess.run(
            ["dpkg-query", "-W", "-f", "${Status}", package],
            capture_output=True,
            text=True,
            check=False,
        ).stdout
    ]
    if missing:
        env = os.environ | {"DEBIAN_FRONTEND": "noninteractive"}
        apt = ("apt-get", "-qq", "-o", "DPkg::Lock::Timeout=300", "-o", "Acquire::Retries=3")
        run(*apt, "update", env=env)
        run(*apt, "install", "-y", "--no-install-recommends", *missing, env=env)


def userland(root: Path) -> None:
    """Make a small Debian, of the release that this machine runs and from where it has it."""
    told = Path("/etc/os-release").read_text(encoding="utf-8")
    release = re.search(r"^VERSION_CODENAME=(\S+)", told, re.MULTILINE)
    if release is None:
        sys.exit("rig: the machine is made from Debian's packages, on Debian")
    listed = Path("/etc/apt/sources.list.d/debian.sources")
    listed = listed if listed.exists() else Path("/etc/apt/sources.list")
    shutil.rmtree(root, ignore_errors=True)
    include = "--include=" + ",".join(GUEST_PACKAGES)
    how = ("--quiet", "--variant=minbase", "--mode=root", *SMALLER, include)
    run("mmdebstrap", *how, release[1], root, listed)


def kernel(work: Path, root: Path) -> None:
    """Unpack the kernel, keep the modules that are needed, make the initrd."""
    package = re.search(r"Depends: (linux-image-\S+)", run("apt-cache", "depends", KERNEL))
    assert package is not None, KERNEL
    debs = work / "debs"
    shutil.rmtree(debs, ignore_errors=True)
    debs.mkdir()
    run("apt-get", "-qq", "-o", "APT::Sandbox::User=root", "download", package[1], cwd=debs)
    whole = root / "k"
    shutil.rmtree(whole, ignore_errors=True)
    run("dpkg-deb", "-x", next(debs.glob("*.deb")), whole)
    version = next((whole / "lib/modules").iterdir()).name
    run("chroot", root, "depmod", "-b", "/k", version)
    modules, kept = whole / "lib/modules" / version, root / "lib/modules" / version
    shutil.rmtree(root / "lib/modules", ignore_errors=True)
    order = _copy_modules(modules, kept)
    for name in ("modules.order", "modules.builtin", "modules.builtin.modinfo"):
        shutil.copy(modules / name, kept / name)
    run("chroot", root, "depmod", version)
    shutil.copy(next((whole / "boot").glob("vmlinuz-*")), work / "vmlinuz")
    initrd(work, kept, order)
    shutil.rmtree(whole)
    shutil.rmtree(debs)


def _copy_modules(modules: Path, kept: Path) -> list[str]:
    """Copy modules with what they need; return those of the initrd, in the order of loading."""
    needs: dict[str, list[str]] = {}
    for line in (modules / "modules.dep").read_text(encoding="utf-8").splitlines():
        name, _, rest = line.partition(":")
        needs[Path(name.split(".ko")[0]).name.replace("-", "_")] = [*reversed(rest.split()), name]
    order: list[str] = []
    for module in (*BOOT_MODULES, *MODULES):
        for one in needs.get(module, ()):
            (kept / one).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(modules / one, kept / one)
            if module in BOOT_MODULES and one not in order:
                order.append(one)
    return order


def initrd(work: Path, kept: Path, order: list[str]) -> None:
    """Make what finds the disk and goes on there."""
    tree = work / "initrd.d"
    shutil.rmtree(tree, ignore_errors=True)
    for folder in ("bin", "m", "proc", "dev", "new"):
        (tree / folder).mkdir(parents=True)
    shutil.copy("/bin/busybox", tree / "bin/busybox")
    for one in order:
        shutil.copy(kept / one, tree / "m" / Path(one).name)
    loads = "\n".join(f"/bin/busybox insmod /m/{Path(one).name}" for one in order)
    (tree / "init").write_text(INIT.format(loads=loads), encoding="utf-8")
    (tree / "init").chmod(0o755)
    names = "\n".join(str(path.relative_to(tree)) for path in sorted(tree.rglob("*")))
    with (work / "initrd").open("wb") as out:
        subprocess.run(
            ["busybox", "cpio", "-o", "-H", "newc"],
            cwd=tree,
            input=names.encode(),
            stdout=out,
            stderr=subprocess.DEVNULL,
            check=True,
        )
    shutil.rmtree(tree)


def needed() -> list[str]:
    """Return what ``sniffer`` needs to record, as pip knows it."""
    project = tomllib.loads((SOURCE / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return [one for one in project["dependencies"] if not one.startswith(NOT_IN_GUEST)]


def sniffer(root: Path) -> None:
    """Install that where its unit file expects it, in /opt/sniffer; the code is at /src."""
    shutil.rmtree(root / "opt/sniffer", ignore_errors=True)
    run("chroot", root, "python3", "-m", "venv", "--without-pip", "/opt/sniffer")
    site = next((root / "opt/sniffer/lib").glob("python3.*")) / "site-packages"
    version = site.parent.name.removeprefix("python")
    run(
        *(sys.executable, "-m", "pip", "--disable-pip-version-check", "install", "-qq"),
        *("--root-user-action=ignore", "--target", site, "--only-binary=:all:"),
        *("--python-version", version),
        *(f"--platform=manylinux{one}_x86_64" for one in PLATFORMS),
        *needed(),
    )
    for junk in ("numpy/*/tests", "numpy/tests", "numpy/f2py", "bin"):
        for path in site.glob(junk):
            shutil.rmtree(path)
    (site / "rig.pth").write_text("/src\n", encoding="utf-8")
    (root / "src").mkdir(exist_ok=True)
    script = root / "opt/sniffer/bin/sniffer"
    begin = "#!/opt/sniffer/bin/python3\nfrom sniffer.__main__ import main\nmain()\n"
    script.write_text(begin, encoding="utf-8")
    script.chmod(0o755)
    inside = "/" + str(site.relative_to(root))
    run("chroot", root, "python3", "-m", "compileall", "-q", "-j", "2", inside)


def finish(root: Path) -> None:
    """Make it boot quickly and obey; leave nothing of this machine's in it."""
    (root / "etc/fstab").write_text("", encoding="utf-8")
    (root / "etc/hostname").write_text("rig\n", encoding="utf-8")
    units = root / "etc/systemd/system"
    for name in MASKED:
        _link(units / (name if "." in name else f"{name}.service"), "/dev/null")
    (units / "rig-agent.service").write_text(AGENT_UNIT, encoding="utf-8")
    (units / "sysinit.target.wants").mkdir(exist_ok=True)
    _link(units / "sysinit.target.wants/rig-agent.service", "/etc/systemd/system/rig-agent.service")
    shutil.copy(HERE / "guest/init.sh", root / "opt/init")
    (root / "opt/init").chmod(0o755)
    run("chroot", root, "sh", "-c", "id -u tapper >/dev/null 2>&1 || useradd -m tapper")
    for path in (root / "etc/apt").glob("**/*"):
        if path.is_file() and not path.is_symlink():
            path.unlink()
    shutil.rmtree(root / "var/cache/apt", ignore_errors=True)
    shutil.rmtree(root / "var/lib/apt/lists", ignore_errors=True)


def _link(link: Path, target: str) -> None:
    link.parent.mkdir(parents=True, exist_ok=True)
    link.unlink(missing_ok=True)
    link.symlink_to(target)


def image(work: Path, root: Path) -> None:
    """Put it on a disk."""
    used = int(run("du", "-sm", root).split()[0])
    disk = work / "disk.img"
    disk.unlink(missing_ok=True)
    run("truncate", "-s", f"{used + SPARE_MB}M", disk)
    how = ("-q", "-O", "^has_journal", "-E", "lazy_itable_init=1,nodiscard", "-d", root)
    run("mkfs.ext4", *how, disk)


def build(work: Path) -> None:
    """Do what has not been done, or was made from something else; ask for root if need be."""
    root, stamps = work / "root", work / "stamps"
    steps: dict[str, tuple[Callable[[], None], str]] = {
        "packages": (host_packages, ",".join(HOST_PACKAGES)),
        "userland": (lambda: userland(root), ",".join(GUEST_PACKAGES)),
        "kernel": (lambda: kernel(work, root), ",".join((*BOOT_MODULES, *MODULES, INIT))),
        "sniffer": (lambda: sniffer(root), ",".join(needed())),
        "finish": (lambda: finish(root), AGENT_UNIT + (HERE / "guest/init.sh").read_text()),
        "image": (lambda: image(work, root), ""),
    }
    is_fresh = False
    for name, (step, made_from) in steps.items():
        stamp = stamps / name
        key = hashlib.sha256(made_from.encode()).hexdigest()
        if not is_fresh and stamp.exists() and stamp.read_text() == key:
            continue
        if os.geteuid():
            # -B: nothing of root's is left in the checkout
            work.mkdir(parents=True, exist_ok=True)
            again = (sys.executable, "-B", "-m", "rig.build", "--work", work)
            subprocess.run(["sudo", *map(str, again)], cwd=SOURCE, check=True)
            return
        stamps.mkdir(parents=True, exist_ok=True)
        is_fresh = is_fresh or name != "packages"
        began = time.monotonic()
        step()
        stamp.write_text(key)
        print(f"rig: {name} in {time.monotonic() - began:.0f} s", flush=True)
    if is_fresh and "SUDO_UID" in os.environ:  # logs and recordings will be theirs
        os.chown(work, int(os.environ["SUDO_UID"]), int(os.environ["SUDO_GID"]))


def main() -> None:
    """Build it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--work", type=Path, default=cache())
    build(parser.parse_args().work.resolve())


if __name__ == "__main__":
    main()
