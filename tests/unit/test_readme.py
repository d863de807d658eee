"""The commands in the README and on the pages are those of the program."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import Any

import pytest
import typer.main

from aeroskein_service.cli import app

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
SHELL = re.compile(r"^```sh\n(.*?)^```", re.MULTILINE | re.DOTALL)


def command_lines(page: Path) -> list[list[str]]:
    """Lines of shell blocks and indented lines that begin with ``aeroskein``, as words."""
    text = page.read_text(encoding="utf-8").replace("\\\n", " ")
    lines = [line for block in SHELL.findall(text) for line in block.splitlines()]
    lines += [line.strip() for line in text.splitlines() if re.match(r"    aeroskein ", line)]
    words = [shlex.split(line, comments=True) for line in lines]
    # What stands in brackets or capitals on a page is a description, not an argument.
    return [line for line in words if line and line[0] == "aeroskein"]


def command_of(words: list[str]) -> tuple[Any, list[str]]:
    """The command that the words call, and what is left of them."""
    command: Any = typer.main.get_command(app)
    rest = words[1:]
    while (known := getattr(command, "commands", None)) and rest and not rest[0].startswith("-"):
        assert rest[0] in known, f"aeroskein has no command {rest[0]}"
        command, rest = known[rest[0]], rest[1:]
    return command, rest


CALLED = [(page.name, words) for page in PAGES for words in command_lines(page)]


@pytest.mark.parametrize(("page", "words"), CALLED, ids=[f"{page}: {' '.join(words)[:60]}" for page, words in CALLED])
def test_a_command_on_a_page_has_these_options(page: str, words: list[str]) -> None:
    command, rest = command_of(words)
    known = {option for parameter in command.params for option in (*parameter.opts, *parameter.secondary_opts)}
    known.add("--help")

    asked = {re.split(r"[=\]]", word.lstrip("["))[0] for word in rest if word.lstrip("[").startswith("-")}

    assert asked <= known, f"{page}: {sorted(asked - known)}"


def test_the_readme_calls_the_commands_people_begin_with() -> None:
    called = {words[1] for page, words in CALLED if page == "README.md" and len(words) > 1}

    assert {"router", "run", "watch", "simulate", "fuse", "evaluate", "filter", "config"} <= called


def test_every_target_the_readme_makes_is_in_the_makefile_and_explained_by_make_help() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    targets = set(re.findall(r"^([a-z-]+):", makefile, re.MULTILINE))
    phony = set(re.search(r"^\.PHONY:(.*)$", makefile, re.MULTILINE)[1].split())  # type: ignore[index]
    explained = set(re.findall(r'@echo "make ([a-z-]+) ', makefile))

    asked = set(re.findall(r"\bmake ([a-z-]+)", (ROOT / "README.md").read_text(encoding="utf-8")))

    assert {"demo", "test"} <= asked <= targets
    assert phony == targets
    assert explained == targets - {"help"}
