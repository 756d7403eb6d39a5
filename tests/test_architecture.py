"""The floors of the house: imports go down only, and I/O stays at its edges."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Final

import pytest

import sniffer

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

ROOT: Final = Path(__file__).parents[1] / "sniffer"
FILES: Final = sorted(
    path.relative_to(ROOT) for path in ROOT.rglob("*.py") if not path.name.endswith("_pb2.py")
)

CORE: Final = (
    *("model", "limits", "registers", "checksums", "framing", "plan", "timing", "bus", "samples"),
    *("decoder", "reference", "reference_values", "diagnostics", "protocols", "rows"),
    *("summary", "remarks"),
    *("merging", "ordering", "lanes", "bare", "pacing", "pending", "matching", "echo", "torn"),
    *("clues", "evidence", "changes", "weighing", "staging"),
)
"""Bytes and times in, records out: nothing here opens, prints, sleeps or asks for the time."""

FLOORS: Final = (
    ("model",),
    ("registers", "checksums", "limits", "clues", "cutting"),
    ("plan", "framing", "timing", "remarks"),
    ("protocols",),
    ("pending", "matching", "echo", "staging", "torn"),
    ("bus", "samples", "evidence", "changes", "weighing"),
    ("diagnostics",),
    ("decoder", "reference", "reference_values", "rows"),
    ("lanes",),
    ("ordering", "bare"),
    ("summary", "detect", "pacing", "messages", "simulation", "merging", "status"),
    ("sources", "sinks"),
    ("pipeline", "wires", "replaying", "explaining", "doctoring", "playing"),
    ("api", "recovery", "comparing", "viewing", "recording", "parcels"),
    ("watching", "watcher"),
    ("__init__",),
    ("cli", "__main__"),
)
"""Modules and packages from the ground up; each imports from its own floor and those below."""

ONLY: Final[Mapping[str, tuple[str, ...]]] = {
    "construct": ("protocols/", "plan.py", "reference.py"),
    "serial": ("sources/",),
    "mcap": ("sinks/mcap", "sources/mcap", "recovery.py", "comparing.py"),
    "mcap_protobuf": ("sinks/mcap", "sources/mcap"),
    "google": ("sinks/mcap", "sources/mcap", "messages/"),
    "rerun": ("sinks/rerun", "viewing.py"),
    "pyarrow": ("sinks/tables.py", "sinks/rerun", "api.py"),
    "pandas": (),
    "click": ("cli/",),
    "rich": ("cli/", "sinks/text.py", "sinks/report.py", "sinks/board"),
    "threading": ("cli/", "sources/", "viewing.py", "sinks/rerun", "playing/"),
    "socket": ("viewing.py",),
    "subprocess": ("viewing.py", "watching.py", "watcher.py"),
    "logging": (),
}
"""What may be imported in few places only."""

LAZY: Final = ("mcap", "mcap_protobuf", "google", "rerun", "pyarrow", "serial")
"""What starting the program may not draw in: files that import these are imported in functions."""


@cache
def tree(file: Path) -> ast.Module:
    return ast.parse((ROOT / file).read_text(encoding="utf-8"), str(file))


def imports(file: Path, *, lazy: bool = True, typing: bool = True) -> Iterator[str]:
    """Yield what a file imports, by full name; not those in functions, or for types only."""

    def inside(nodes: list[ast.stmt]) -> Iterator[str]:
        for node in nodes:
            if isinstance(node, ast.Import):
                yield from (name.name for name in node.names)
            elif isinstance(node, ast.ImportFrom):
                assert node.level == 0, f"{file}: relative import"
                assert node.module
                for name in node.names:
                    full = f"{node.module}.{name.name}"
                    is_module = file_named(full) is not None
                    yield full if is_module else node.module
            elif isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
                yield from inside(node.body) if typing else ()
                yield from inside(node.orelse)
            elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and not lazy:
                continue
            else:
                for field in ("body", "orelse", "finalbody"):
                    yield from inside(getattr(node, field, []))
                for handler in getattr(node, "handlers", []):
                    yield from inside(handler.body)

    yield from inside(tree(file).body)


def file_named(module: str) -> Path | None:
    """Return the file of one of our modules."""
    parts = module.split(".")
    if parts[0] != "sniffer":
        return None
    stem = ROOT.joinpath(*parts[1:])
    for path in (stem.with_suffix(".py"), stem / "__init__.py"):
        if path.is_file():
            return path.relative_to(ROOT)
    return None


def room(file: Path) -> str:
    """Return the module or package, right under ``sniffer``, that a file belongs to."""
    return file.parts[0].removesuffix(".py")


def floor(name: str) -> int:
    found = [level for level, rooms in enumerate(FLOORS) if name in rooms]
    assert found, f"{name} stands on no floor: say in FLOORS where it belongs"
    return found[0]


@pytest.mark.parametrize("file", FILES, ids=str)
def test_imports_go_down_only(file: Path) -> None:
    here = floor(room(file))
    for module in imports(file):
        there = file_named(module)
        if there is not None and module != "sniffer":
            assert floor(room(there)) <= here, f"{file} imports {module}"


@pytest.mark.parametrize("file", [f for f in FILES if room(f) in CORE], ids=str)
def test_the_core_knows_no_input_and_no_output(file: Path) -> None:
    outside = {"sources", "sinks", "cli", "pipeline", "api", "viewing", "recovery", "simulation"}
    for module in imports(file):
        there = file_named(module)
        assert there is None or room(there) not in outside, f"{file} imports {module}"
        assert module not in ("time", "threading", "socket", "subprocess", "logging", "signal")
        assert module != "sys" or file.name == "catalogue.py", file  # it writes its own page


@pytest.mark.parametrize("library", ONLY)
def test_a_library_is_imported_where_it_belongs_and_nowhere_else(library: str) -> None:
    for file in FILES:
        if library in {module.split(".")[0] for module in imports(file)}:
            allowed = any(file.as_posix().startswith(place) for place in ONLY[library])
            assert allowed, f"{file} imports {library}"


def loaded_with(*modules: str) -> set[Path]:
    """Return the files that importing these modules runs."""
    out: set[Path] = set()
    waiting = list(modules)
    while waiting:
        module = waiting.pop()
        parts = module.split(".")
        for n in range(1, len(parts) + 1):
            file = file_named(".".join(parts[:n]))
            if file is not None and file not in out:
                out.add(file)
                waiting += imports(file, lazy=False, typing=False)
    return out


def test_libraries_that_load_slowly_are_loaded_when_they_are_needed() -> None:
    rooms = {
        value.__module__
        for name in sniffer.__all__
        if hasattr(value := getattr(sniffer, name), "__module__")
    }
    files = loaded_with("sniffer", "sniffer.__main__", "sniffer.cli", *rooms)
    assert {Path("decoder.py"), Path("cli/decode.py"), Path("sinks/jsonl.py")} <= files
    for file in files:
        drawn = {m.split(".")[0] for m in imports(file, lazy=False, typing=False)} & {*LAZY}
        assert not drawn, f"{file} imports {drawn} before it is needed"


@pytest.mark.parametrize("file", [f for f in FILES if room(f) != "cli"], ids=str)
def test_only_the_command_line_prints(file: Path) -> None:
    for node in ast.walk(tree(file)):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            assert node.func.id not in ("print", "input", "exit", "quit"), f"{file}:{node.lineno}"


def test_the_protocols_do_not_know_each_other() -> None:
    names = {
        file.parts[1] for file in FILES if file.parts[0] == "protocols" and len(file.parts) > 2
    }
    assert len(names) >= 4
    for file in FILES:
        if file.parts[0] == "protocols" and len(file.parts) > 2:
            for module in imports(file):
                parts = module.split(".")
                if parts[:2] == ["sniffer", "protocols"] and len(parts) > 2:
                    assert parts[2] not in names - {file.parts[1]}, f"{file} imports {module}"


@pytest.mark.parametrize("file", [f for f in FILES if room(f) in CORE], ids=str)
def test_no_protocol_is_named_outside_its_folder(file: Path) -> None:
    if file.parts[0] == "protocols":
        return
    names = {f.parts[1] for f in FILES if f.parts[0] == "protocols" and len(f.parts) > 2}
    for node in ast.walk(tree(file)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            assert node.value not in names, f"{file}:{node.lineno} says {node.value!r}"
