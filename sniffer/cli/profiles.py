"""Profiles: what is stated of one bus again and again, kept in a file and called by its name.

``--profile arm`` (or ``SNIFFER_PROFILE``) takes ``[profile.arm]`` of ``./sniffer.toml``, or of
``config.toml`` in the user's own folder. What a command line states wins. No file is opened unless
a profile is asked for.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

import click
from click.core import ParameterSource

from sniffer.ground.limits import OF_BUS
from sniffer.ground.wording import and_, nearly, offered

VARIABLE: Final = "SNIFFER_PROFILE"
HERE: Final = Path("sniffer.toml")
IN_USE: Final = "sniffer.profile"
"""Where a context keeps the profile that is in use."""

ALL: Final = "all"
"""Stands in place of a servo's id."""


class Profile(NamedTuple):
    """A profile: its name, its file with that file's text, and the values by key."""

    name: str
    file: Path
    text: str
    values: Mapping[str, Any]

    def place(self, key: str) -> str:
        """Return where a key stands, for a sentence: ``sniffer.toml:7: baud``."""
        return f"{self.file}:{self._line(key)}: {key}"

    def _line(self, key: str) -> int:
        begin = re.compile(rf"\s*\[\s*profile\s*\.\s*[\"']?{re.escape(self.name)}[\"']?\s*[\].]")
        spelled = rf"[\"']?{re.escape(key)}[\"']?"
        mine = re.compile(rf"\s*(?:{spelled}\s*[=.]|\[\s*profile\s*\..*\.\s*{spelled}\s*\])")
        lines = self.text.splitlines()
        head = next((n for n, line in enumerate(lines) if begin.match(line)), 0)
        found = (n for n in range(head, len(lines)) if mine.match(lines[n]))
        return next(found, head) + 1


def files() -> tuple[Path, Path]:
    """Return where profiles are looked for; the first one that has it wins."""
    home = os.environ.get("XDG_CONFIG_HOME") or str(Path.home() / ".config")
    return HERE, Path(home) / "sniffer" / "config.toml"


def read_profile(name: str) -> Profile:
    """Return the profile of a name.

    Raises:
        click.UsageError: there is none, or its file cannot be used; it says which and why.
    """
    known: dict[str, Path] = {}
    for file in files():
        text, profiles = _profiles_in(file)
        if name in profiles:
            profile = Profile(name, file, text, profiles[name])
            _check(profile)
            return profile
        known |= dict.fromkeys(profiles, file)
    looked = and_([str(file) for file in files()])
    if not known:
        advice = f"write [profile.{name[:40]}] into one of them (docs/profiles.md)"
        raise click.UsageError(f"no profile {name[:40]!r}: {looked} have none; {advice}")
    raise click.UsageError(f"no profile {name[:40]!r} in {looked}: {offered(name, known)}")


def _profiles_in(file: Path) -> tuple[str, Mapping[str, Any]]:
    import tomllib  # only who asks for a profile waits for it

    try:
        text = file.read_text(encoding="utf-8")
    except FileNotFoundError:
        return "", {}
    except (OSError, UnicodeDecodeError) as error:
        why = error.strerror if isinstance(error, OSError) else "it is no UTF-8"
        raise click.UsageError(f"{file}: cannot be read: {why}") from None
    try:
        told = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise click.UsageError(f"{file}: this is no TOML: {error}") from None
    for key in told:
        if key != "profile":
            raise click.UsageError(
                f"{file}: there is no key {key[:40]!r}: write settings below [profile.NAME]"
            )
    profiles = told.get("profile", {})
    if not isinstance(profiles, dict) or not all(isinstance(p, dict) for p in profiles.values()):
        raise click.UsageError(f"{file}: profile: write [profile.NAME], and settings below it")
    return text, profiles


def _texts(value: Any, profile: Profile) -> list[str]:
    given = [value] if isinstance(value, str) else value
    if not isinstance(given, list) or not all(isinstance(each, str) for each in given):
        raise ValueError('write a text, or a list of them: ["...", "..."]')
    return given


def _text(value: Any, profile: Profile) -> str:
    if not isinstance(value, str):
        raise ValueError('write a text: "..."')
    return value


def _protocol(value: Any, profile: Profile) -> str:
    text = _text(value, profile)
    return str(profile.file.parent / text) if text.endswith(".py") else text


def _number(value: Any, profile: Profile) -> str:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError("write a number")
    return str(value)


def _by_servo(value: Any, profile: Profile) -> list[str]:
    """Return ``ID=WHAT``, or ``WHAT`` for all."""
    told = {ALL: value} if isinstance(value, str) else value
    if not isinstance(told, dict) or not all(isinstance(each, str) for each in told.values()):
        raise ValueError(f'write ids and models: {{ 3 = "...", {ALL} = "..." }}')
    return [each if who == ALL else f"{who}={each}" for who, each in told.items()]


def flat_names(told: Mapping[str, Any]) -> dict[str, Any]:
    """Return a table of names with those of a bus, a table in it, as ``BUS:ID``."""
    out: dict[str, Any] = {}
    for who, name in told.items():
        of_bus = name.items() if isinstance(name, dict) else ()
        out |= {f"{who}{OF_BUS}{servo}": each for servo, each in of_bus} or {who: name}
    return out


def _names(value: Any, profile: Profile) -> list[str]:
    """Return ``ID=NAME`` and ``BUS:ID=NAME``."""
    told = flat_names(value) if isinstance(value, dict) else {"": None}
    if not all(isinstance(each, str) for each in told.values()):
        raise ValueError('write ids and names: { 3 = "left_knee" }')
    return [f"{who}={name}" for who, name in told.items()]


def _beside(value: Any, profile: Profile) -> list[str]:
    """Return paths, which count from the folder of the profile's file."""
    return [str(profile.file.parent / each) for each in _texts(value, profile)]


_KEYS: Final[Mapping[str, tuple[str, Callable[[Any, Profile], str | list[str]]]]] = {
    "ports": ("PORT", _texts),
    "protocol": ("--protocol", _protocol),
    "baud": ("--baud", _number),
    "latency": ("--latency", _number),
    "models": ("--model", _by_servo),
    "registers": ("--registers", _beside),
    "names": ("--name", _names),
    "alarms": ("--alarm", _texts),
}
"""Each key: the option (or argument) that it states, and how its value is read."""

KEYS: Final = tuple(_KEYS)


def _check(profile: Profile) -> None:
    for key in profile.values:
        if key not in _KEYS:
            meant = nearly(key, _KEYS) or f": one of {', '.join(_KEYS)}"
            raise click.UsageError(f"{profile.place(key)}: there is no such key{meant}")
    for key in profile.values:
        _stated(profile, key)


def _stated(profile: Profile, key: str) -> str | list[str]:
    try:
        return _KEYS[key][1](profile.values[key], profile)
    except ValueError as error:
        raise click.UsageError(f"{profile.place(key)}: {error}") from None


def _use(context: click.Context, parameter: click.Parameter, name: str | None) -> None:
    """Have the context take from the profile what the command line does not state."""
    if name is None or context.resilient_parsing:
        return
    profile = read_profile(name)
    context.meta[IN_USE] = profile
    stated: dict[str, Any] = {}
    for key in profile.values:
        option, _ = _KEYS[key]
        for param in context.command.params:
            if param.name and (option in param.opts or (option == "PORT" and _takes_ports(param))):
                stated[param.name] = _stated(profile, key)
    context.default_map = {**(context.default_map or {}), **stated}


class Ports(click.Argument):
    """One port or several; a profile may name them."""

    def consume_value(
        self, ctx: click.Context, opts: Mapping[str, Any]
    ) -> tuple[Any, ParameterSource]:
        """Return the ports of the command line, else those of the profile."""
        stated = opts.get(self.name or "")
        named = (ctx.default_map or {}).get(self.name or "")
        if not named or (isinstance(stated, str | tuple | list) and stated):
            return super().consume_value(ctx, opts)
        if self.nargs == 1 and len(named) > 1:
            raise click.UsageError(
                f"{ctx.meta[IN_USE].place('ports')}: {len(named)} ports: name the one that is meant"
            )
        return (named[0] if self.nargs == 1 else named), ParameterSource.DEFAULT_MAP


def _takes_ports(param: click.Parameter) -> bool:
    return isinstance(param, Ports)


with_profile = click.option(
    "--profile",
    callback=_use,
    is_eager=True,
    expose_value=False,
    envvar=VARIABLE,
    metavar="NAME",
    help="Take what is not stated here from [profile.NAME] in sniffer.toml (docs/profiles.md).",
)
"""Of every command that takes ports, protocols, models or rules."""


def blamed(error: click.ClickException, told: str) -> str:
    """Return what is wrong with a call; where a profile said it, by the profile's words."""
    context = error.ctx if isinstance(error, click.UsageError) else None
    param = error.param if isinstance(error, click.BadParameter) else None
    profile = context.meta.get(IN_USE) if context else None
    if not isinstance(profile, Profile) or context is None or param is None or not param.name:
        return told
    if context.get_parameter_source(param.name) != ParameterSource.DEFAULT_MAP:
        return told
    for key, (option, _) in _KEYS.items():
        if option in param.opts or (option == "PORT" and _takes_ports(param)):
            return f"{profile.place(key)}: {error.message}"
    return told
