"""The manual page and the completion, made from the commands, as their tools take them."""

from __future__ import annotations

import os
import shutil
import subprocess
from typing import TYPE_CHECKING

import click
import pytest

from sniffer.cli import COMMANDS, cli
from tests.commands import environment, install, within
from tests.lists import each_in_turn

if TYPE_CHECKING:
    from pathlib import Path

Capsys = pytest.CaptureFixture[str]


def test_the_manual_has_every_command_and_every_option(capsys: Capsys) -> None:
    page = within(capsys, "manual").out.replace(r"\-", "-")
    for name in COMMANDS:
        assert f"\n.SS sniffer {name} " in page
        for param in cli.commands[name].params:
            if isinstance(param, click.Option) and not param.hidden:
                assert all(option in page for option in param.opts)


@pytest.mark.skipif(shutil.which("groff") is None, reason="needs groff")
def test_the_manual_is_set_without_a_warning(capsys: Capsys) -> None:
    page = within(capsys, "manual").out
    command = ["groff", "-man", "-Tascii", "-ww", "-z"]
    done = subprocess.run(command, input=page, capture_output=True, text=True, check=True)
    assert done.stderr == ""


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_a_shell_is_told_how_to_complete(shell: str, capsys: Capsys) -> None:
    ran = within(capsys, "completion", shell)
    assert (ran.status, ran.err) == (0, "")
    assert f"_SNIFFER_COMPLETE={shell}_complete" in ran.out


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
@each_in_turn(
    2,
    ("words", "meant"),
    [
        ("sniffer deco", {"decode"}),
        ("sniffer decode --protocol m", {"mightyzap"}),
        ("sniffer completion z", {"zsh"}),
        ("sniffer explain no-resp", {"no-response"}),
        ("sniffer decode x --code noise,no-resp", {"noise,no-response"}),
        ("sniffer record x --until brown", {"brownout"}),
        ("sniffer registers mightyzap-", {"mightyzap-12lf", "mightyzap-l12"}),
        ("sniffer simulate wck --fault reset", {"reset-loop"}),
    ],
)
def test_bash_completes_commands_options_and_their_words(
    words: str, meant: set[str], tmp_path: Path, capsys: Capsys
) -> None:
    script = tmp_path / "completion"
    script.write_text(within(capsys, "completion", "bash").out, encoding="utf-8")
    install(tmp_path / "sniffer")
    asked = (
        f"source {script}; COMP_WORDS=({words}); COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1)); "
        '_sniffer_completion sniffer; printf "%s\\n" "${COMPREPLY[@]}"'
    )
    paths = (str(tmp_path), os.environ["PATH"])
    done = subprocess.run(
        ["bash", "-c", asked],
        env=environment(PATH=os.pathsep.join(paths)),
        capture_output=True,
        text=True,
        check=True,
    )
    assert set(done.stdout.split()) == meant
