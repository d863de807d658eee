"""Where configuration values come from: a TOML file, the environment, the command line, each as one layer.

A layer is a nested dictionary and the origin of each of its leaves. Sensors are addressed by id in the environment
(``AEROSKEIN_SENSORS__RADAR1__RANGE_BIAS_M=80``), so that one variable changes one value of one sensor.
"""

from __future__ import annotations

import tomllib
import types
import typing
from collections.abc import Iterator, Mapping
from copy import deepcopy
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, NamedTuple

from pydantic import BaseModel, TypeAdapter, ValidationError

from aeroskein_service.config_errors import ConfigError
from aeroskein_service.config_keys import KeyPath, keys_of, type_at, unknown_key

__all__ = ["Layer", "environment_layer", "file_layer", "merge", "override_layer"]

PREFIX: Final = "AEROSKEIN_"
# Between section and key; a single underscore is part of a name.
SEPARATOR: Final = "__"


class Layer(NamedTuple):
    """Values by path; a path that starts with ``sensors`` and a text addresses a sensor of an earlier layer by id."""

    leaves: dict[KeyPath, Any]
    origins: dict[KeyPath, str]


def file_layer(path: Path) -> Layer:
    """Everything in a TOML file. Raises ``ConfigError``."""
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise ConfigError(f"no such configuration file: {path}") from None
    except OSError as error:
        raise ConfigError(f"cannot read the configuration file {path}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise ConfigError(f"{path} is not UTF-8 text") from None
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{path} is not valid TOML: {error}") from None
    leaves = dict(_flat(content))
    return Layer(leaves, dict.fromkeys(leaves, f"file {path}"))


def environment_layer(model: type[BaseModel], environ: Mapping[str, str]) -> Layer:
    """All variables ``AEROSKEIN_<SECTION>__<KEY>``. Raises ``ConfigError`` for a key that does not exist.

    Variables without the double underscore are left alone: orchestrators set such ones for their own purposes.
    """
    leaves: dict[KeyPath, Any] = {}
    origins: dict[KeyPath, str] = {}
    for name in sorted(environ):
        if not name.startswith(PREFIX) or SEPARATOR not in name:
            continue
        path: KeyPath = tuple(name[len(PREFIX) :].lower().split(SEPARATOR))
        wanted: KeyPath = ("sensors", 0, *path[2:]) if path[0] == "sensors" and len(path) > 2 else path
        annotation = type_at(model, wanted)
        if annotation is None or keys_of(annotation):
            raise ConfigError(
                f"{unknown_key(model, wanted, '.'.join(map(str, path)))} (in the environment variable {name})"
            )
        leaves[path] = _from_text(environ[name], annotation)
        origins[path] = f"environment {name}"
    return Layer(leaves, origins)


def override_layer(overrides: Mapping[str, Any]) -> Layer:
    """What the command line sets, by dotted key; None sets nothing."""
    leaves: dict[KeyPath, Any] = {tuple(k.split(".")): v for k, v in overrides.items() if v is not None}
    return Layer(leaves, dict.fromkeys(leaves, "command line"))


def merge(layers: list[Layer]) -> tuple[dict[str, Any], dict[KeyPath, str]]:
    """One nested dictionary of all layers, later ones winning, and where each leaf came from."""
    content: dict[str, Any] = {}
    origins: dict[KeyPath, str] = {}
    for layer in layers:
        for path, value in layer.leaves.items():
            where = layer.origins[path]
            path = _resolved(path, content, where)
            _set(content, path, deepcopy(value))
            for old in [known for known in origins if known[: len(path)] == path]:
                del origins[old]
            origins[path] = where
    return content, origins


def _flat(value: Any, path: KeyPath = ()) -> Iterator[tuple[KeyPath, Any]]:
    """Leaves of nested tables; lists of tables are entered, other lists are values."""
    if isinstance(value, dict) and (value or not path):
        for key, inner in value.items():
            yield from _flat(inner, (*path, key))
    elif isinstance(value, list) and value and all(isinstance(item, dict) for item in value):
        for index, inner in enumerate(value):
            yield from _flat(inner, (*path, index))
    else:
        yield path, value


def _set(content: dict[str, Any], path: KeyPath, value: Any) -> None:
    here: Any = content
    for part, following in pairwise(path):
        empty: Any = [] if isinstance(following, int) else {}
        if isinstance(here, list):
            assert isinstance(part, int)
            while len(here) <= part:
                here.append({})
            here = here[part]
        else:
            if not isinstance(here.get(part), dict | list):
                here[part] = empty
            here = here[part]
    if isinstance(here, list):
        here.append(value)
    else:
        here[path[-1]] = value


def _resolved(path: KeyPath, content: dict[str, Any], where: str) -> KeyPath:
    """A path whose sensor is given by id, with the sensor's index instead."""
    if len(path) < 3 or path[0] != "sensors" or not isinstance(path[1], str):
        return path
    wanted = _folded(path[1])
    sensors = content.get("sensors")
    for index, sensor in enumerate(sensors if isinstance(sensors, list) else []):
        if isinstance(sensor, dict) and _folded(str(sensor.get("id"))) == wanted:
            return ("sensors", index, *path[2:])
    raise ConfigError(f"sensors.{path[1]}: no sensor of this id in the configuration (in {where})")


def _folded(sensor_id: str) -> str:
    """Names of variables have no hyphens and are often in upper case."""
    return sensor_id.lower().replace("-", "_")


def _from_text(text: str, annotation: Any) -> Any:
    """The value that a variable's text means for a key of this type; the text itself where it means none."""
    optional = typing.get_origin(annotation) in (typing.Union, types.UnionType)
    options = [a for a in typing.get_args(annotation) if a is not type(None)] if optional else [annotation]
    adapter: TypeAdapter[Any] = TypeAdapter(options[0])
    try:
        if typing.get_origin(options[0]) is not tuple:
            return adapter.validate_strings(text)
        if not text.lstrip().startswith("["):
            return [part.strip() for part in text.split(",") if part.strip()]
        return adapter.dump_python(adapter.validate_json(text, strict=True), mode="json")
    except ValidationError:
        return text
