"""The floors of the house: imports go down only, and I/O stays at its edges."""

from __future__ import annotations

import ast
import re
from collections import Counter
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import TYPE_CHECKING, Final

import pytest

import sniffer
from sniffer.cli import cli

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

ROOT: Final = Path(__file__).parents[1] / "sniffer"
FILES: Final = sorted(
    path.relative_to(ROOT) for path in ROOT.rglob("*.py") if not path.name.endswith("_pb2.py")
)

ROOMS: Final = sorted({path.parts[0] for path in FILES})
"""Folders, and files beside them."""

DESIGN: Final = (ROOT.parent / "docs" / "design.md").read_text(encoding="utf-8")


def floors(heading: str) -> tuple[tuple[str, ...], ...]:
    """Return what stands on each floor of the table with this heading, from the ground up."""
    table = DESIGN.partition(f"\n| {heading} |")[2].partition("\n\n")[0].splitlines()[2:]
    return tuple(tuple(re.findall(r"`(\w+)/?`", line.split("|")[2])) for line in reversed(table))


FLOORS: Final = floors("floor")
"""Rooms, as the design draws them, from the ground up."""

DIAGNOSIS: Final = "diagnosis"

PARTS: Final = floors("floor of diagnosis")
"""Folders of the largest room, and files beside them."""

FACE: Final = "cli"

CORE: Final = ("ground", "protocols", "anomalies", "decoding", "diagnosis", "merging", "signals")
"""Bytes and times in, records out: nothing here opens, prints, sleeps or asks for the time."""

ONLY: Final[Mapping[str, tuple[str, ...]]] = {
    "construct": ("protocols/", "ground/plan.py", "ground/wire.py", "decoding/reference/"),
    "serial": ("ports/",),
    "mcap": ("mcapfile/", "jobs/compare.py"),
    "mcap_protobuf": ("mcapfile/",),
    "google": ("mcapfile/", "messages/"),
    "rerun": ("sinks/rerun/", "viewers/viewer.py"),
    "pyarrow": (
        *("sinks/tables.py", "sinks/relations.py", "sinks/wide.py", "sinks/rerun/"),
        *("sinks/dictionaries.py", "jobs/api.py", "jobs/batches.py", "jobs/query.py", "fleet/"),
    ),
    "duckdb": ("jobs/query.py",),
    "dask": ("fleet/engines/dask.py",),
    "distributed": ("fleet/engines/dask.py",),
    "ray": ("fleet/engines/ray.py",),
    "deltalake": ("fleet/delta.py",),
    "foxglove": ("sinks/foxglove.py",),
    "pandas": (),
    "textual": ("inside/",),
    "click": ("cli/",),
    "rich": (
        *("cli/", "inside/", "viewers/", "sinks/consoles.py"),
        *("sinks/bars.py", "sinks/text.py", "sinks/report.py", "sinks/stats.py", "sinks/story.py"),
        *("sinks/held.py", "sinks/tabulated.py"),
    ),
    "threading": (
        *("cli/", "ports/", "tap/", "viewers/", "sinks/rerun/", "simulation/play/", "inside/"),
        "jobs/crew.py",
    ),
    "socket": ("viewers/viewer.py",),
    "subprocess": ("viewers/", "inside/recorder.py", "wireshark/places.py"),
    "logging": (),
    "pytest": (),
    "hypothesis": (),
}
"""What may be imported in few places only."""

RUNS: Final = {"Decoder", "Pipeline", "open_outputs", "open_port", "open_sink", "open_source"}
"""What does the work of a command: the library calls it, so that a program can, too."""

LAZY: Final = (
    *(
        "dask",
        "distributed",
        "duckdb",
        "foxglove",
        "mcap",
        "mcap_protobuf",
        "google",
        "rerun",
        "pyarrow",
        "ray",
        "serial",
        "textual",
    ),
)
"""What starting the program may not draw in: files that import these are imported in functions."""


@cache
def tree(file: Path) -> ast.Module:
    return ast.parse((ROOT / file).read_text(encoding="utf-8"), str(file))


@cache
def imports(file: Path, *, lazy: bool = True, typing: bool = True) -> tuple[str, ...]:
    """Return what a file imports, by full name; not those in functions, or for types only."""

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

    return tuple(inside(tree(file).body))


@cache
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


def files_in(name: str) -> list[Path]:
    return [file for file in FILES if file.parts[0] == name]


def room(file: Path) -> str:
    """Return the folder, right under ``sniffer``, that a file stands in; the door's is the face."""
    return file.parts[0] if len(file.parts) > 1 else FACE


def floor(name: str, house: tuple[tuple[str, ...], ...] = FLOORS) -> int:
    found = [level for level, rooms in enumerate(house) if name in rooms]
    assert len(found) == 1, f"{name} stands on no floor: say in docs/design.md, 2, where it belongs"
    return found[0]


def test_the_design_draws_every_room_and_none_that_is_not_there() -> None:
    drawn = [name for rooms in FLOORS for name in rooms]
    assert sorted(drawn) == sorted({room(file) for file in FILES})


@pytest.mark.parametrize("name", ROOMS)
def test_imports_go_down_only(name: str) -> None:
    for file in files_in(name):
        here = room(file)
        for module in imports(file):
            there = file_named(module)
            if there is not None and module != "sniffer" and room(there) != here:
                assert floor(room(there)) < floor(here), f"{file} imports {module}"


def part(file: Path) -> str:
    """Return the folder or file, right under ``diagnosis``, that a file of it is."""
    return Path(file.parts[1]).stem


def rules_of(file: Path) -> str:
    """Return the folder of the rule that a file is; "" where it is none."""
    return file.parts[2] if part(file) == "rules" and len(file.parts) > 3 else ""


def parts_of_diagnosis() -> list[Path]:
    return [file for file in files_in(DIAGNOSIS) if len(file.parts) > 2 or file.stem != "__init__"]


def test_the_design_draws_every_part_of_the_diagnosis() -> None:
    drawn = [name for names in PARTS for name in names]
    assert sorted(drawn) == sorted({part(file) for file in parts_of_diagnosis()})


def test_inside_the_diagnosis_imports_go_down_as_well() -> None:
    for file in parts_of_diagnosis():
        for module in imports(file):
            there = file_named(module)
            if there is None or there.parts[0] != DIAGNOSIS or part(there) == part(file):
                continue
            assert floor(part(there), PARTS) <= floor(part(file), PARTS), f"{file} imports {module}"


def test_rules_about_different_things_do_not_know_each_other() -> None:
    for file in parts_of_diagnosis():
        for module in imports(file) if rules_of(file) and file.stem != "__init__" else ():
            there = file_named(module)
            of = rules_of(there) if there is not None and there.parts[0] == DIAGNOSIS else ""
            assert of in ("", rules_of(file)), f"{file} imports {module}"


@pytest.mark.parametrize("typing", [False, True])
def test_inside_a_room_nothing_goes_round_in_circles(typing: bool) -> None:
    arrows = {
        file: {
            there
            for module in imports(file, typing=typing)
            if (there := file_named(module)) is not None
            and there != file
            # for types a part of a package may name its face, which hands out what parts have
            and not (typing and there.name == "__init__.py")
        }
        for file in FILES
    }
    try:
        TopologicalSorter(arrows).prepare()
    except CycleError as error:
        pytest.fail(" <- ".join(str(file) for file in error.args[1]))


@pytest.mark.parametrize("name", CORE)
def test_the_core_knows_no_input_and_no_output(name: str) -> None:
    known = ("time", "threading", "socket", "subprocess", "logging", "signal")
    for file in files_in(name):
        if file == Path("ground/files.py"):
            continue  # opens outputs, for those above
        for module in imports(file):
            assert module not in known, f"{file} imports {module}"
            # one writes its own page, one imports what packages bring, one hides such a package
            allowed = ("catalogue.py", "plugins.py", "arrow.py")
            assert module != "sys" or file.name in allowed, file
            assert module != "sniffer.ground.files", file


@pytest.mark.parametrize("file", [f for f in FILES if f.parts[0] == "cli"], ids=str)
def test_the_command_line_holds_arguments_and_runs_nothing_itself(file: Path) -> None:
    for node in ast.walk(tree(file)):
        if isinstance(node, ast.Import | ast.ImportFrom):
            assert not RUNS & {name.name for name in node.names}, f"{file}:{node.lineno}"
    assert not {"selectors", "tempfile", "time"} & {*imports(file)}, file


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


def test_no_room_is_called_like_a_public_name() -> None:
    # a room that is loaded becomes an attribute of the package: `sniffer.merge` was one, then
    rooms = {path.parent.name for path in ROOT.glob("*/__init__.py")}
    rooms |= {path.stem for path in ROOT.glob("*.py")}
    assert not rooms & set(sniffer.__all__)


def test_libraries_that_load_slowly_are_loaded_when_they_are_needed() -> None:
    rooms = {
        value.__module__
        for name in sniffer.__all__
        if hasattr(value := getattr(sniffer, name), "__module__")
    }
    commands = {c.callback.__module__ for c in cli.commands.values() if c.callback is not None}
    files = loaded_with("sniffer", "sniffer.__main__", "sniffer.cli", *commands, *rooms)
    assert {Path("decoding/decoder.py"), Path("cli/decode.py"), Path("cli/simulate.py")} <= files
    for file in files:
        drawn = {m.split(".")[0] for m in imports(file, lazy=False, typing=False)} & {*LAZY}
        assert not drawn, f"{file} imports {drawn} before it is needed"


@pytest.mark.parametrize(
    "name", [name for name in ROOMS if name != FACE and not name.endswith(".py")]
)
def test_only_the_command_line_prints(name: str) -> None:
    for file in files_in(name):
        for node in ast.walk(tree(file)):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
                said = f"{file}:{node.lineno}"
                assert node.func.id not in ("print", "input", "exit", "quit"), said


def test_no_two_classes_have_one_name() -> None:
    names = Counter(
        node.name
        for file in FILES
        for node in ast.walk(tree(file))
        if isinstance(node, ast.ClassDef)
    )
    assert not [name for name, count in names.items() if count > 1]


FAMILY: Final = "packets"
"""A folder among the protocols that is none: what members of one family have in common."""


def protocol_folders() -> set[str]:
    folders = {f.parts[1] for f in FILES if f.parts[0] == "protocols" and len(f.parts) > 2}
    return folders - {FAMILY}


def test_the_protocols_do_not_know_each_other() -> None:
    names = protocol_folders()
    assert len(names) >= 4
    for file in FILES:
        if file.parts[0] == "protocols" and len(file.parts) > 2:
            for module in imports(file):
                parts = module.split(".")
                if parts[:2] == ["sniffer", "protocols"] and len(parts) > 2:
                    assert parts[2] not in names - {file.parts[1]}, f"{file} imports {module}"


@pytest.mark.parametrize("file", [f for f in FILES if f.name == "slow.py"], ids=str)
def test_an_oracle_takes_nothing_from_the_columns_it_checks(file: Path) -> None:
    for module in imports(file):
        assert module.rpartition(".")[2] not in ("block", "columns"), f"{file} imports {module}"
        assert module != "sniffer.ground.framing", file


def test_only_the_reference_asks_the_oracle() -> None:
    for file in FILES:
        if room(file) == "protocols" or file.parts[:2] == ("decoding", "reference"):
            continue
        asked = [n.attr for n in ast.walk(tree(file)) if isinstance(n, ast.Attribute)]
        assert not [name for name in asked if name.startswith("slow_")], file


@pytest.mark.parametrize("name", [name for name in CORE if name != "protocols"])
def test_no_protocol_is_named_outside_its_folder(name: str) -> None:
    names = protocol_folders()
    for file in files_in(name):
        for node in ast.walk(tree(file)):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                assert node.value not in names, f"{file}:{node.lineno} says {node.value!r}"
