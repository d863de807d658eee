"""``aeroskein config show`` and ``config schema``: what is in force, where it comes from, and all there is to set."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final, Literal

from aeroskein_service.config import Config, load_config
from aeroskein_service.config_keys import KeyPath, keys_of

__all__ = ["run"]

# Stands in place of a secret that is set.
HIDDEN: Final = "********"
_SECRETS: Final = (("zenoh", "password"),)
# Column of the origin behind a value.
_MARGIN: Final = 48


def run(*, action: Literal["show", "schema"], config: Path | None = None) -> int:
    """Print the configuration in force, or its schema."""
    loaded = load_config(config, sensors_required=False)
    if action == "schema":
        print(json.dumps(schema(), indent=2, ensure_ascii=False))
    else:
        print("\n".join(shown(loaded)))
    return 0


def schema() -> dict[str, Any]:
    """The JSON schema of the configuration, with a description of every key."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema"} | Config.model_json_schema()


def shown(config: Config) -> Iterator[str]:
    """The effective configuration as TOML, each value with its origin behind it; absent values are comments."""
    yield f"# configuration {config.fingerprint()}"
    for section in Config.model_fields:
        value = getattr(config, section)
        if isinstance(value, tuple):
            for index, item in enumerate(value):
                yield from _table(config, (section, index), item, f"[[{section}]]")
        else:
            yield from _table(config, (section,), value, f"[{section}]")


def _table(config: Config, path: KeyPath, section: Any, heading: str) -> Iterator[str]:
    yield ""
    yield heading
    inner: list[tuple[KeyPath, Any, str]] = []
    for name in keys_of(type(section)):
        value = getattr(section, name)
        here = (*path, name)
        if isinstance(value, tuple) and value and dataclasses.is_dataclass(value[0]):
            dotted = ".".join(part for part in here if isinstance(part, str))
            inner += [((*here, index), item, f"[[{dotted}]]") for index, item in enumerate(value)]
            continue
        if here in _SECRETS and value:
            value = HIDDEN
        line = f"# {name} =" if value is None else f"{name} = {_toml(value)}"
        yield f"{line:<{_MARGIN}} # {config.origin(*here)}"
    for item_path, item, item_heading in inner:
        yield from _table(config, item_path, item, item_heading)


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, tuple):
        return f"[{', '.join(_toml(item) for item in value)}]"
    return repr(value)
