"""One sentence for whatever is wrong with a configuration: the key's path, what was expected, where it stands."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from aeroskein.errors import AeroskeinError, SettingsError
from aeroskein_service.config_keys import KeyPath, unknown_key

__all__ = ["ConfigError", "sentence"]

_EXPECTED: Final = {
    "float_type": "expected a number",
    "int_type": "expected an integer",
    "int_from_float": "expected an integer",
    "bool_type": "expected true or false",
    "string_type": "expected a text in quotes",
    "tuple_type": "expected a list",
    "dataclass_type": "expected a table",
    "dataclass_exact_type": "expected a table",
    "model_type": "expected a table",
    "model_attributes_type": "expected a table",
}
_UNKNOWN: Final = ("extra_forbidden", "unexpected_keyword_argument")
# Lists of tables whose items are named by one of their keys rather than by their place.
_NAMED_BY: Final = {"sensors": "id", "errors": "sensor"}


class ConfigError(AeroskeinError, ValueError):
    """A configuration that cannot work; the message is one sentence for the user."""

    exit_status: Final = 2


def sentence(
    error: ValidationError, model: type[BaseModel], content: Mapping[str, Any], origins: Mapping[KeyPath, str]
) -> str:
    """The first fault of a configuration, in the order of the file, as one sentence."""
    details = error.errors(include_url=False)
    # A misspelt key explains a missing one, so it comes first.
    first = next((d for d in details if d["type"] in _UNKNOWN), details[0])
    text = _describe(first, model, content)
    cause = first.get("ctx", {}).get("error")
    at = _location(cause.key, content) if isinstance(cause, SettingsError) else first["loc"]
    origin = _origin(at, origins)
    more = "" if len(details) == 1 else f"; {len(details) - 1} more after this"
    return f"{text}{f' (in {origin})' if origin else ''}{more}"


def _describe(detail: ErrorDetails, model: type[BaseModel], content: Mapping[str, Any]) -> str:
    location, kind = detail["loc"], detail["type"]
    shown = _shown(location, content)
    cause = detail.get("ctx", {}).get("error")
    if isinstance(cause, SettingsError):
        return str(cause)
    if kind in _UNKNOWN:
        return unknown_key(model, location, shown)
    if kind == "missing":
        return f"{shown}: missing, this key has no default"
    if kind == "literal_error":
        return f"{shown}: expected {detail['ctx']['expected']}, got {_got(detail['input'])}"
    expected = _EXPECTED.get(kind)
    if expected is None:
        return f"{shown}: {detail['msg'][:1].lower()}{detail['msg'][1:]}, got {_got(detail['input'])}"
    return f"{shown}: {expected}, got {_got(detail['input'])}"


def _got(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, dict):
        return "a date or time" if "date or time" in value else "a table"
    text = repr(list(value) if isinstance(value, tuple) else value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _shown(location: KeyPath, content: Any) -> str:
    """A path as the user thinks of it: ``sensors.radar1.period_s``, ``zenoh.connect[0]``."""
    text, here, before = "", content, ""
    for part in location:
        try:
            here = here[part]
        except (KeyError, IndexError, TypeError):
            here = None
        if isinstance(part, int):
            name = here.get(_NAMED_BY.get(before, "")) if isinstance(here, dict) else None
            text += f".{name}" if isinstance(name, str) else f"[{part}]"
        else:
            text += f".{part}" if text else part
            before = part
    return text


def _location(key: str, content: Mapping[str, Any]) -> KeyPath:
    """The path of a key that a check inside the settings named: sensors by their id."""
    path: list[str | int] = []
    here: Any = content
    for part in key.split("."):
        if isinstance(here, list):
            name = _NAMED_BY.get(str(path[-1]), "")
            index = next((i for i, item in enumerate(here) if isinstance(item, dict) and item.get(name) == part), None)
            if index is None:
                break
            path.append(index)
            here = here[index]
        else:
            path.append(part)
            here = here.get(part) if isinstance(here, dict) else None
    return tuple(path)


def _origin(location: KeyPath, origins: Mapping[KeyPath, str]) -> str:
    """Where the value at this path came from, or any value below it."""
    for length in range(len(location), 0, -1):
        head = location[:length]
        found = [where for path, where in origins.items() if path[:length] == head]
        if found:
            return found[-1].removeprefix("file ")
    return ""
