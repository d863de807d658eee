"""Every key of deploy/fusion.toml is read, checked, and says what holds without it."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest

from aeroskein_service.commands.config import HIDDEN, schema, shown
from aeroskein_service.config import Config, ConfigError, load_config
from aeroskein_service.config_keys import known_keys
from aeroskein_service.config_layers import file_layer

FILE = Path(__file__).parents[2] / "deploy" / "fusion.toml"
LEAVES = file_layer(FILE).leaves
# What describes this one demo rather than a default.
OWN = ("area", "sensors")


def value_at(config: Any, path: tuple[str | int, ...]) -> Any:
    for part in path:
        config = config[part] if isinstance(part, int) else getattr(config, part)
    return config


def dotted(path: tuple[str | int, ...]) -> str:
    return ".".join(str(part) for part in path)


def plain(value: Any) -> Any:
    return [plain(item) for item in value] if isinstance(value, tuple) else value


@pytest.fixture(scope="module")
def config() -> Config:
    return load_config(FILE, environ={})


def test_demo_has_one_adsb_receiver_and_two_radars(config):
    assert [(sensor.id, sensor.is_radar) for sensor in config.sensors] == [
        ("adsb", False),
        ("radar1", True),
        ("radar2", True),
    ]


@pytest.mark.parametrize("path", list(LEAVES), ids=dotted)
def test_key_arrives_with_its_value_and_its_origin(config, path):
    assert plain(value_at(config, path)) == LEAVES[path]
    assert config.origin(*path) == f"file {FILE}"


@pytest.mark.parametrize("path", list(LEAVES), ids=dotted)
def test_key_of_a_wrong_type_is_refused_by_its_name(path, tmp_path):
    wrong = tmp_path / "wrong.toml"
    wrong.write_text(_with(path, "2026-01-01T00:00:00Z"))

    with pytest.raises(ConfigError) as caught:
        load_config(wrong, environ={})

    assert str(path[-1]) in str(caught.value) or path[0] == "sensors"
    assert str(caught.value).startswith(str(path[0]))


@pytest.mark.parametrize("path", [p for p in LEAVES if p[0] not in OWN and len(p) == 2], ids=dotted)
def test_key_in_the_file_is_the_default(path):
    assert plain(value_at(Config(), path)) == LEAVES[path]


def test_every_key_of_the_service_sections_stands_in_the_file():
    sections = (
        "fusion",
        "patent",
        "tracks",
        "registration",
        "association",
        "zenoh",
        "service",
        "output",
        "http",
        "log",
    )

    for key in known_keys(Config):
        section, _, name = key.partition(".")
        if section in sections and name and "." not in name:
            assert (section, name) in LEAVES, key


def test_shown_configuration_can_be_loaded_again_and_is_the_same(config, tmp_path):
    again = tmp_path / "again.toml"
    again.write_text("\n".join(shown(config)))

    assert load_config(again, environ={}).model_dump() == config.model_dump()


def test_shown_configuration_says_where_each_value_comes_from():
    config = load_config(FILE, environ={"AEROSKEIN_FUSION__MODE": "patent"}, overrides={"fusion.lookahead": 2})

    lines = {line.partition(" =")[0]: line.rpartition(" # ")[2] for line in shown(config) if " = " in line}

    assert lines["mode"] == "environment AEROSKEIN_FUSION__MODE"
    assert lines["lookahead"] == "command line"
    assert lines["series"] == f"file {FILE}"
    assert lines["flight_s"] == "default"


def test_shown_configuration_hides_the_password():
    text = "\n".join(shown(load_config(FILE, environ={"AEROSKEIN_ZENOH__PASSWORD": "secret"})))

    assert "secret" not in text
    assert HIDDEN in text


def test_schema_lists_every_key():
    found = schema()

    sections = {name: found["$defs"][_type(found, name)]["properties"] for name in found["properties"]}
    for key in known_keys(Config):
        section, _, name = key.partition(".")
        if name and "." not in name:
            assert name in sections[section], key


def _type(found: dict[str, Any], section: str) -> str:
    content = found["properties"][section]
    reference = content.get("$ref") or content["items"]["$ref"]
    return str(reference.rpartition("/")[2])


def _with(path: tuple[str | int, ...], literal: str) -> str:
    """The file with one value replaced."""
    content = tomllib.loads(FILE.read_text(encoding="utf-8"))
    here: Any = content
    for part in path[:-1]:
        here = here[part]
    here[path[-1]] = _Literal(literal)
    return "\n".join(_toml(content))


class _Literal(str):
    """Stands in TOML as it is."""


def _toml(content: dict[str, Any], prefix: str = "") -> Any:
    for key, value in content.items():
        if not isinstance(value, dict) and not _is_tables(value):
            yield f"{key} = {value if isinstance(value, _Literal) else _value(value)}"
    for key, value in content.items():
        if isinstance(value, dict):
            yield f"[{prefix}{key}]"
            yield from _toml(value, f"{prefix}{key}.")
        elif _is_tables(value):
            for item in value:
                yield f"[[{prefix}{key}]]"
                yield from _toml(item, f"{prefix}{key}.")


def _is_tables(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and isinstance(value[0], dict)


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return repr(value)
