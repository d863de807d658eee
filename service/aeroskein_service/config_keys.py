"""The keys that exist, read off the configuration model: their types, and the nearest one to a misspelt key."""

from __future__ import annotations

import dataclasses
import difflib
import typing
from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel

__all__ = ["KeyPath", "keys_of", "known_keys", "type_at", "unknown_key"]

KeyPath = tuple[str | int, ...]


def keys_of(kind: Any) -> dict[str, Any]:
    """Keys and their types of a section; empty where ``kind`` is no section."""
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        return {name: info.annotation for name, info in kind.model_fields.items()}
    if isinstance(kind, type) and dataclasses.is_dataclass(kind):
        hints = typing.get_type_hints(kind)
        return {item.name: hints[item.name] for item in dataclasses.fields(kind)}
    return {}


def type_at(kind: Any, path: KeyPath) -> Any:
    """The type of the value at a path, None where there is no such key."""
    for part in path:
        if isinstance(part, int):
            arguments = typing.get_args(kind)
            kind = arguments[0] if arguments else None
        else:
            kind = keys_of(kind).get(part)
    return kind


def known_keys(kind: Any, path: str = "") -> Iterator[str]:
    """Every dotted key below a section; an item of a list of tables has the path of the list."""
    for name, annotation in keys_of(kind).items():
        here = f"{path}.{name}" if path else name
        yield here
        item = type_at(annotation, (0,))
        yield from known_keys(item if keys_of(item) else annotation, here)


def unknown_key(model: type[BaseModel], path: KeyPath, shown: str) -> str:
    """Say that a key does not exist, with the nearest one that does.

    A key of the same section comes first, then one of the same name in another section, then a similar path.
    """
    known = list(known_keys(model))
    plain = ".".join(str(part) for part in path if not isinstance(part, int))
    section, _, name = plain.rpartition(".")
    beside = {key.rpartition(".")[2]: key for key in known if key.rpartition(".")[0] == section}
    near = [beside[key] for key in difflib.get_close_matches(name, beside, 1, 0.6)]
    near = near or [key for key in known if key.rpartition(".")[2] == name]
    near = near or difflib.get_close_matches(plain, known, 1, 0.8)
    if near:
        return f"{shown}: unknown key, did you mean {near[0]}?"
    return f"{shown}: unknown key" + (f", expected one of {', '.join(beside)}" if beside else "")
