"""Where Wireshark looks for what is the user's own: dissectors, profiles, capture interfaces."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Mapping

PROFILE: Final = "servo"
"""What the profile is called: ``wireshark -C servo``."""

_ASKED_S: Final = 10
"""How long tshark may take to say where its folders are."""

_FOLDER: Final = re.compile(r"([^:]+):\s+(\S.*)")


@dataclass(frozen=True, slots=True)
class Places:
    """The folders. ``program`` told them, or is empty where none is there to be asked.

    ``extcap`` are several where nobody knows the version: 4.0 and before look among the settings,
    4.2 and later beside the plug-ins (User's Guide, B.4; release notes 4.2).
    """

    plugins: Path
    profile: Path
    extcap: tuple[Path, ...]
    program: str = ""


def places(environment: Mapping[str, str] | None = None) -> Places:
    """Return the folders of this user: those that tshark names, else the usual ones."""
    env = dict(os.environ if environment is None else environment)
    program = shutil.which("tshark", path=env.get("PATH"))
    told = _told_by(program, env) if program is not None else {}
    settings, libraries = _usual(env)
    config = _folder(told, "Personal configuration") or settings
    plugins = _folder(told, "Personal Lua Plugins") or libraries / "plugins"
    own = _folder(told, "Personal Extcap path")
    if own is not None:
        extcap: tuple[Path, ...] = (own,)
    elif told:
        extcap = (config / "extcap",)
    else:
        extcap = (config / "extcap", libraries / "extcap")
    asked = program if told and program is not None else ""
    return Places(plugins, config / "profiles" / PROFILE, tuple(dict.fromkeys(extcap)), asked)


def _folder(told: Mapping[str, str], name: str) -> Path | None:
    return Path(told[name]) if name in told else None


def _usual(env: Mapping[str, str]) -> tuple[Path, Path]:
    """Return where settings and where plug-ins are by default.

    Source: Wireshark User's Guide, B.3, Configuration Files and Plugin Folders.
    """
    if sys.platform == "win32":
        roaming = Path(env.get("APPDATA") or Path.home() / "AppData" / "Roaming") / "Wireshark"
        return roaming, roaming
    home = Path(env.get("HOME") or Path.home())
    config = Path(env.get("XDG_CONFIG_HOME") or home / ".config")
    return config / "wireshark", home / ".local" / "lib" / "wireshark"


def _told_by(program: str, env: Mapping[str, str]) -> dict[str, str]:
    """Return what the program says of its folders; nothing where it does not answer."""
    try:
        ran = subprocess.run(
            [program, "-G", "folders"],
            capture_output=True,
            text=True,
            errors="replace",
            timeout=_ASKED_S,
            check=False,
            env=dict(env),
        )
    except (OSError, subprocess.TimeoutExpired):
        return {}
    found = (_FOLDER.fullmatch(line) for line in ran.stdout.splitlines())
    told = {m[1].strip(): m[2].strip() for m in found if m is not None}
    return told if "Personal configuration" in told else {}
