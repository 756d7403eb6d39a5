"""What Slurm and Kubernetes are given: their parts are all of the captures, each once."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any, Final

import pytest

from tests.fleets import captures, content, serial

MANIFESTS: Final = Path(__file__).parents[1] / "docs" / "fleet"
SLURM: Final = MANIFESTS / "slurm.sbatch"
KUBERNETES: Final = MANIFESTS / "kubernetes.yaml"

TELLS: Final = """#!/bin/sh
for word in "$@"; do echo "$word"; done
exit "${STATUS:-0}"
"""
"""A program that says what it was called with."""


@pytest.fixture
def programs(tmp_path: Path) -> Path:
    """A folder of programs that is looked into first."""
    folder = tmp_path / "bin"
    folder.mkdir()
    return folder


def install(programs: Path, script: str) -> None:
    """Let ``sniffer`` be a script."""
    (programs / "sniffer").write_text(script, encoding="utf-8")
    (programs / "sniffer").chmod(0o755)


def pod() -> tuple[dict[str, Any], list[str], dict[str, str]]:
    """Return the job, the command of its pods, and their variables."""
    yaml: Any = pytest.importorskip("yaml", reason="PyYAML is not installed")
    job = yaml.safe_load(KUBERNETES.read_text(encoding="utf-8"))["spec"]
    (container,) = job["template"]["spec"]["containers"]
    return job, container["command"], {one["name"]: one["value"] for one in container["env"]}


def run(command: list[str], programs: Path, **variables: str) -> subprocess.Popen[str]:
    there = f"{programs}{os.pathsep}{os.environ['PATH']}"
    return subprocess.Popen(
        command, env={**os.environ, "PATH": there, **variables}, text=True, stdout=subprocess.PIPE
    )


def task(nth: int, of: int, programs: Path, **variables: str) -> subprocess.Popen[str]:
    """Run what Slurm runs, with the variables that it sets."""
    told = {
        "SLURM_ARRAY_TASK_ID": str(nth),
        "SLURM_ARRAY_TASK_COUNT": str(of),
        "SLURM_CPUS_PER_TASK": "1",
    }
    return run(["bash", str(SLURM)], programs, **told, **variables)


def shard(running: subprocess.Popen[str]) -> str:
    """Return the part that a run was told to do."""
    out, _ = running.communicate()
    words = out.splitlines()
    return words[words.index("--shard") + 1]


def test_the_parts_of_an_array_and_of_a_job_are_counted_as_shards_are(programs: Path) -> None:
    install(programs, TELLS)
    array = re.search(r"^#SBATCH --array=1-(\d+)$", SLURM.read_text(encoding="utf-8"), re.M)
    assert array is not None
    of = int(array[1])
    here = {"CAPTURES": "captures", "DATASET": "data"}
    parts = Counter(shard(task(nth + 1, of, programs, **here)) for nth in range(of))
    assert parts == Counter(f"{nth + 1}/{of}" for nth in range(of))

    job, command, variables = pod()
    of = job["completions"]
    assert job["completionMode"] == "Indexed"
    pods = [{**variables, "JOB_COMPLETION_INDEX": str(nth)} for nth in range(of)]
    parts = Counter(shard(run(command, programs, **told)) for told in pods)
    assert parts == Counter(f"{nth + 1}/{of}" for nth in range(of))


@pytest.mark.parametrize(("status", "ends"), [(0, 0), (1, 0), (2, 2), (3, 3)])
def test_a_pod_that_would_do_no_better_another_time_ends_well(
    status: int, ends: int, programs: Path
) -> None:
    install(programs, TELLS)
    _, command, variables = pod()
    told = {**variables, "JOB_COMPLETION_INDEX": "0", "STATUS": str(status)}
    running = run(command, programs, **told)
    running.communicate()
    assert running.returncode == ends


def test_a_task_of_slurm_and_a_pod_make_one_data_set(programs: Path, tmp_path: Path) -> None:
    install(programs, f'#!/bin/sh\nexec "{sys.executable}" -m sniffer "$@"\n')
    logs = captures(tmp_path / "captures")
    here = {"CAPTURES": str(logs), "DATASET": str(tmp_path / "data")}
    _, command, variables = pod()
    there = {**variables, **here, "SHARDS": "2", "WORKERS": "1", "TMPDIR": str(tmp_path)}
    both = (task(1, 2, programs, **here), run(command, programs, **there, JOB_COMPLETION_INDEX="1"))
    for one in both:
        one.communicate()
        assert one.returncode == 0
    assert serial(logs, tmp_path / "serial").is_whole
    assert content(tmp_path / "data") == content(tmp_path / "serial")
