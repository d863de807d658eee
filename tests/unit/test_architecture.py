"""The rules of the house, walked over the source: who may import whom, how long files are, what the core must not do.

The layers stand in docs/architecture.md, in the table under "Layers"; that table is read here, so that what the page
says and what the code does cannot drift apart.
"""

from __future__ import annotations

import ast
import os
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

import aeroskein

ROOT = Path(__file__).resolve().parents[2]
CORE = ROOT / "core" / "aeroskein"
SERVICE = ROOT / "service" / "aeroskein_service"

LONGEST_FILE = 400
LONGEST_FUNCTION = 60

# What the core may use besides itself: values in, values out. What tells the time, reads, writes or waits is not here.
ALLOWED_IN_CORE = {
    "__future__", "abc", "bisect", "collections", "dataclasses", "enum", "functools", "heapq", "itertools", "json",
    "math", "numpy", "operator", "re", "typing", "zlib",
}  # fmt: skip
# Linear assignment, for association alone.
ASSIGNMENT_LIBRARY = "lap"
BUILT_INS_WITH_EFFECTS = {"print", "input", "open", "breakpoint", "exec", "eval"}

TEXT_SUFFIXES = {
    ".css", ".html", ".js", ".json", ".json5", ".lock", ".md", ".py", ".svg", ".toml", ".txt", ".yaml", ".yml",
}  # fmt: skip
NOT_OURS = {".git", ".venv", "build", "dist", "__pycache__", "node_modules", "vendor", "state"}
# Written in two halves, so that this file does not find itself.
FORBIDDEN_TEXT = {
    "a claim of conformity": re.compile("compl" + r"iant|compl" + "iance", re.IGNORECASE),
    "a path of one machine": re.compile("/wo" + r"rk/|/ho" + r"me/[a-z]|/ro" + r"ot/|/Us" + "ers/"),
    "the address of a package index": re.compile("index" + r"-url +http|extra-index" + "-url|pythonhosted" + r"\.org"),
}


def sources(*folders: Path) -> list[Path]:
    return sorted(path for folder in folders for path in folder.rglob("*.py"))


@cache
def tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def imports(path: Path) -> Iterator[str]:
    """Full names of the modules a file imports; ``from aeroskein import fusion`` gives ``aeroskein.fusion``."""
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path.name}:{node.lineno}: imports are absolute"
            module = node.module or ""
            if module in ("aeroskein", "aeroskein_service"):
                yield from (f"{module}.{alias.name}" for alias in node.names)
            else:
                yield module


def unit_of(module: str) -> str:
    """The module or package of the core that a name lies in: ``aeroskein.registration.rows`` is in registration."""
    return module.split(".")[1] if "." in module else "__init__"


@cache
def units() -> dict[str, set[str]]:
    """Modules and packages of the core, and what each of them imports of the others."""
    found: dict[str, set[str]] = {}
    for path in sources(CORE):
        parts = path.relative_to(CORE).with_suffix("").parts
        name = parts[0]
        mine = found.setdefault(name, set())
        mine |= {unit_of(i) for i in imports(path) if i.split(".")[0] == "aeroskein"} - {name, "__init__"}
    del found["__init__"]
    return found


class Layer:
    """One row of the table: its strangers (each a module, or several that belong together), and what it may import."""

    def __init__(self, cells: list[str]) -> None:
        self.name = cells[0].strip("* ")
        groups = [group for group in cells[1].split(",") if group.strip()]
        self.groups = [set(re.findall(r"`([a-z_]+)`", group)) for group in groups]
        self.modules = {module for group in self.groups for module in group}
        self.below = [name.strip() for name in cells[2].split(",") if name.strip() not in ("", "itself")]
        self.among_themselves = "itself" in cells[2]


@cache
def layers() -> dict[str, Layer]:
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    section = page.split("## Layers", 1)[1].split("\n## ", 1)[0]
    rows = [line for line in section.splitlines() if line.startswith("|")][2:]
    made = [Layer(line.strip("|").split("|")) for line in rows]
    return {layer.name: layer for layer in made}


# -- who may import whom ---------------------------------------------------------------------------------------------
def test_every_module_of_the_core_stands_in_one_layer() -> None:
    listed = [module for layer in layers().values() for module in layer.modules]

    assert len(listed) == len(set(listed)), "a module stands in two layers of docs/architecture.md"
    assert set(listed) == set(units()), "docs/architecture.md, section Layers, must name exactly the modules there are"


@pytest.mark.parametrize("name", sorted(layers()))
def test_a_layer_imports_only_what_its_row_says(name: str) -> None:
    layer, wrong = layers()[name], []
    allowed = {module for below in layer.below for module in layers()[below].modules}
    for group in layer.groups:
        mine = allowed | (layer.modules if layer.among_themselves else group)
        wrong += [f"{module} -> {', '.join(bad)}" for module in group if (bad := sorted(units()[module] - mine))]

    assert not wrong, wrong


def test_stages_are_strangers_to_each_other() -> None:
    stages = layers()["stages"]

    assert not stages.among_themselves
    assert len(stages.groups) > 8


def test_only_the_engine_imports_the_engine() -> None:
    assert [module for module, others in units().items() if "engine" in others] == []


def test_modules_of_the_core_import_in_one_direction() -> None:
    waiting = {module: set(others) for module, others in units().items()}
    while free := {module for module, others in waiting.items() if not others}:
        waiting = {module: others - free for module, others in waiting.items() if module not in free}

    assert not waiting, f"these import each other in a circle: {sorted(waiting)}"


def test_the_core_never_imports_the_service() -> None:
    assert [path.name for path in sources(CORE) if any(i.startswith("aeroskein_service") for i in imports(path))] == []


def test_only_transport_imports_zenoh() -> None:
    who = [path.name for path in sources(CORE, SERVICE) if any(i.split(".")[0] == "zenoh" for i in imports(path))]

    assert who == ["transport.py"]


def test_commands_do_not_import_each_other() -> None:
    commands = SERVICE / "commands"
    wrong = [
        f"{path.name} -> {other}"
        for path in sources(commands)
        for other in imports(path)
        if other.startswith("aeroskein_service.commands.")
    ]

    assert not wrong, wrong


# -- what the core must not do ---------------------------------------------------------------------------------------
def test_the_core_uses_numpy_and_what_has_no_effects() -> None:
    wrong = []
    for path in sources(CORE):
        roots = {i.split(".")[0] for i in imports(path)} - ALLOWED_IN_CORE - {"aeroskein"}
        if path.name == "__init__.py":
            roots.discard("importlib")  # public names are imported when they are first used
        if path.relative_to(CORE).parts[0].startswith("association"):
            roots.discard(ASSIGNMENT_LIBRARY)
        wrong += [f"{path.relative_to(CORE)} imports {root}" for root in sorted(roots)]

    assert not wrong, wrong


def test_the_core_neither_prints_nor_opens_anything() -> None:
    wrong = [
        f"{path.relative_to(CORE)}:{node.lineno} {node.func.id}()"
        for path in sources(CORE)
        for node in ast.walk(tree(path))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in BUILT_INS_WITH_EFFECTS
    ]

    assert not wrong, wrong


def test_randomness_in_the_core_has_a_seed() -> None:
    wrong = [
        f"{path.relative_to(CORE)}:{node.lineno}"
        for path in sources(CORE)
        for node in ast.walk(tree(path))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and not (node.args or node.keywords)
        if node.func.attr in ("default_rng", "SeedSequence", "PCG64", "Philox")
    ]

    assert not wrong, wrong


def test_every_public_name_is_there_and_is_imported_late() -> None:
    checked = {
        alias.asname
        for node in ast.walk(tree(CORE / "__init__.py"))
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("aeroskein.")
        for alias in node.names
    }

    assert checked == set(aeroskein.__all__)
    assert all(getattr(aeroskein, name).__name__ == name for name in aeroskein.__all__ if name != "Event")
    assert aeroskein.Event
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = aeroskein.nothing


# -- size and shape --------------------------------------------------------------------------------------------------
def test_no_file_is_longer_than_four_hundred_lines() -> None:
    lengths = {
        str(p.relative_to(ROOT)): len(p.read_text(encoding="utf-8").splitlines()) for p in sources(CORE, SERVICE)
    }

    assert {name: n for name, n in lengths.items() if n > LONGEST_FILE} == {}


def test_every_function_fits_on_a_screen() -> None:
    long = {}
    for path in sources(CORE, SERVICE):
        for node in ast.walk(tree(path)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and node.end_lineno is not None:
                lines = node.end_lineno - node.lineno + 1
                if lines > LONGEST_FUNCTION:
                    long[f"{path.relative_to(ROOT)}:{node.name}"] = lines

    assert long == {}


def test_every_file_opens_with_what_it_makes() -> None:
    silent = [str(p.relative_to(ROOT)) for p in sources(CORE, SERVICE) if not ast.get_docstring(tree(p))]

    assert silent == []


def test_everything_public_in_the_core_says_what_it_is() -> None:
    silent = [
        f"{path.relative_to(CORE)}:{node.name}"
        for path in sources(CORE)
        for node in tree(path).body
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_")
        if not ast.get_docstring(node)
    ]

    assert silent == []


# -- what is written anywhere ----------------------------------------------------------------------------------------
def written() -> Iterator[Path]:
    """Files that people read: source, pages, configuration, locks."""
    for folder, folders, names in os.walk(ROOT):
        folders[:] = [name for name in folders if name not in NOT_OURS and (name == ".ci" or name[0] != ".")]
        for path in (Path(folder, name) for name in sorted(names)):
            if path.suffix in TEXT_SUFFIXES or path.name in ("Makefile", "Dockerfile", "run"):
                yield path


@pytest.mark.parametrize("what", FORBIDDEN_TEXT)
def test_nothing_written_holds(what: str) -> None:
    pattern = FORBIDDEN_TEXT[what]
    found = [
        f"{path.relative_to(ROOT)}:{number}"
        for path in written()
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        if pattern.search(line)
    ]

    assert not found, found
