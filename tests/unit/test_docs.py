"""The pages say what is there: every function and test they name exists, every link leads somewhere."""

from __future__ import annotations

import ast
import re
import tomllib
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
CORE = ROOT / "core" / "aeroskein"
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]

# `elements.py:division_points` or `tests/unit/test_ahp.py`; without a folder it is a module of the core.
NAMED = re.compile(r"`([A-Za-z_][\w/.-]*\.py)(?::([\w.]+))?`")
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")
PAGE_IN_SOURCE = re.compile(r"docs/[\w-]+\.md")
HEADING = re.compile(r"^#+ +(.+?) *$", re.MULTILINE)
CODE = re.compile(r"^```.*?^```", re.MULTILINE | re.DOTALL)


@cache
def files() -> tuple[Path, ...]:
    """Every Python file of ours."""
    return tuple(
        p for folder in ("core", "service", "tests", "benchmarks", "deploy") for p in (ROOT / folder).rglob("*.py")
    )


def file_named(name: str) -> Path:
    """Where a file named on a page is: from the top, in the core, or where a page says its files are."""
    places = [ROOT / name, CORE / name, *(p for p in files() if p.as_posix().endswith(f"/{name}"))]
    return next((place for place in places if place.is_file()), places[0])


@cache
def names_in(path: Path) -> frozenset[str]:
    """Functions, classes, their members, and constants of a file: ``Gate.judge``, ``GATE``."""
    found: set[str] = set()
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.FunctionDef):
            found.add(node.name)
        elif isinstance(node, ast.ClassDef):
            found.add(node.name)
            found |= {f"{node.name}.{member.name}" for member in node.body if isinstance(member, ast.FunctionDef)}
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            found.add(node.target.id)
        elif isinstance(node, ast.Assign):
            found |= {target.id for target in node.targets if isinstance(target, ast.Name)}
    return frozenset(found)


def anchors(page: Path) -> set[str]:
    """What a heading can be linked by, as code hosts make it."""
    text = CODE.sub("", page.read_text(encoding="utf-8"))
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in HEADING.findall(text)}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_file_and_name_on_a_page_exists(page: Path) -> None:
    missing = []
    for name, member in NAMED.findall(page.read_text(encoding="utf-8")):
        path = file_named(name)
        if not path.is_file():
            missing.append(name)
        elif member and member not in names_in(path):
            missing.append(f"{name}:{member}")

    assert not missing, missing


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_link_on_a_page_leads_somewhere(page: Path) -> None:
    broken = []
    for target in LINK.findall(CODE.sub("", page.read_text(encoding="utf-8"))):
        if re.match(r"[a-z]+:", target):
            continue
        name, _, anchor = target.partition("#")
        there = page if not name else (page.parent / name).resolve()
        if not there.exists() or (anchor and there.suffix == ".md" and anchor not in anchors(there)):
            broken.append(target)

    assert not broken, broken


@pytest.mark.parametrize("page", [p for p in PAGES if p.parent == ROOT / "docs"], ids=lambda page: page.name)
def test_every_page_is_linked_from_the_readme(page: Path) -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")

    assert f"docs/{page.name}" in readme


def test_every_page_that_the_source_names_exists() -> None:
    named = {(page, path.name) for path in files() for page in PAGE_IN_SOURCE.findall(path.read_text(encoding="utf-8"))}

    assert [(page, where) for page, where in sorted(named) if not (ROOT / page).is_file()] == []


def test_every_published_step_has_a_function_and_a_test() -> None:
    text = (ROOT / "docs" / "algorithm.md").read_text(encoding="utf-8")
    section = text.split("## Published steps", 1)[1].split("\n## ", 1)[0]
    rows = [re.split(r"(?<!\\)\|", line.strip("|")) for line in section.splitlines() if re.match(r"\| *\d+ *\|", line)]

    assert [int(row[0]) for row in rows] == [*range(1, 11), *range(1, 6), *range(8), *range(1, 6)]
    for row in rows:
        assert any(":" in name for name in re.findall(r"`([^`]+)`", row[2])), row[2]
        assert re.search(r"`tests/[^`]+\.py", row[3]), row[3]


def test_the_changelog_begins_with_the_version_of_the_project() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    changelog = (ROOT / "docs" / "changelog.md").read_text(encoding="utf-8")

    assert re.findall(r"^## (\S+)", changelog, re.MULTILINE)[0] == project["version"]
